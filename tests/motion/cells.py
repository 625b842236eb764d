"""Robots among things, to plan motions in and to check them independently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations, pairwise

import coal
import numpy as np
import pinocchio as pin
from pydantic import TypeAdapter

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, inverse, pose, ranges
from sqrp_cli.motion.collision import CollisionScene, pair
from sqrp_cli.motion.plan_motion import Motion, plan_motion
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.robot import Robot
from sqrp_cli.shapes import Box, Part
from sqrp_cli.skill.skill import Skill, SkillChoice, Waypoint
from sqrp_cli.trajectory import Trajectory

VALUES = {
    "approach_yaw": 0.3, "lift": 0.1, "speed": 1.0, "elbow": "any", "shoulder": "any", "wrist": "any", "via": "direct",
}  # fmt: skip


def thing(name: str, size: tuple[float, float, float], X_WO: Array | None, fixed: bool = True) -> SceneObject:
    part = Part(name, name, Box(size), np.eye(4))
    return SceneObject(name=name, type="thing", size=size, pose=X_WO, fixed=fixed, parts=(part,))


def read_waypoints(stated: Mapping[str, object]) -> dict[str, Waypoint]:
    """Waypoints as a skill file states them."""
    return TypeAdapter(dict[str, Waypoint]).validate_python(stated)


class Cell:
    """A robot among things, with the skills to try."""

    def __init__(
        self, robot: Robot, model: RobotModel, skill: Skill, things: tuple[SceneObject, ...], padding: float = 0.0
    ) -> None:
        self.robot, self.model, self.skill = robot, model, skill
        self.objects = {t.name: t for t in things}
        self.scene = CollisionScene(model, things, robot.disabled_pairs, padding)
        X_WO = {t.name: t.X_WO for t in things if t.X_WO is not None}
        self.world = World(frozenset(), X_WO, None, None, dict(zip(model.arm, model.home.tolist(), strict=True)))

    def plan(
        self,
        skill: Skill | None = None,
        world: World | None = None,
        seed: int = 0,
        vias: Mapping[str, Array] | None = None,
        **values: float,
    ) -> Motion | Infeasible:
        chosen = {**(skill or self.skill).defaults, **VALUES, **values}
        choice = SkillChoice(skill or self.skill, {"object": "cube"}, chosen, vias or {})
        return plan_motion(choice, world or self.world, self.scene, seed)


def among(tabletop: Workspace, ur5: RobotModel, *things: SceneObject, padding: float = 0.0) -> Cell:
    """The robot of the tabletop among things, to pick one up."""
    return Cell(tabletop.robot, ur5, tabletop.skills["pickup"], things, padding)


class PinocchioArm:
    """Arm, tool and things as Pinocchio and coal read the URDF, to check places and contacts independently."""

    def __init__(
        self,
        robot: Robot,
        model: RobotModel,
        link: str,
        X_LT: Array,
        tool: Iterable[tuple[Array, coal.CollisionGeometry]],
        things: Mapping[str, SceneObject],
        unchecked: Iterable[tuple[str, str]],
    ) -> None:
        """link, X_LT: what carries the tool frame, and where. tool: shapes on that link, each with its pose there."""
        self.robot_model, self.unchecked = model, model.adjacent_pairs | set(unchecked)
        self.model = pin.buildModelFromUrdf(str(robot.urdf.path))
        folders, kind = [str(root) for root in robot.package_roots], pin.GeometryType.COLLISION
        self.geometry = pin.buildGeomFromUrdf(self.model, str(robot.urdf.path), kind, package_dirs=folders)
        frame = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
        self.joint, self.X_JT = frame.parentJoint, frame.placement * pin.SE3(X_LT)
        self.names = {k: self.model.frames[g.parentFrame].name for k, g in enumerate(self.geometry.geometryObjects)}
        self.X_BW = pin.SE3(inverse(robot.X_WB))
        for X_LP, shape in tool:
            self._add("tool", self.joint, frame.placement * pin.SE3(X_LP), shape)
        self.things = {name: self._add(name, 0, pin.SE3.Identity(), coal.Box(*t.size)) for name, t in things.items()}

    def _add(self, name: str, joint: int, X: pin.SE3, shape: coal.CollisionGeometry) -> int:
        index = self.geometry.addGeometryObject(pin.GeometryObject(f"{name}{len(self.names)}", joint, X, shape))
        self.names[index] = name
        return int(index)

    def configuration(self, q: Array) -> Array:
        """Pinocchio's q: every joint's position, cosine and sine for joints without limits."""
        full = pin.neutral(self.model)
        for name, value in self.robot_model.joint_values(q).items():
            joint = self.model.joints[self.model.getJointId(name)]
            full[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return full

    def tool_pose(self, q: Array) -> Array:
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.configuration(q))
        return (self.X_BW.inverse() * data.oMi[self.joint] * self.X_JT).homogeneous

    def contacts(self, motion: Motion, index: int, t: Array, margin: float) -> set[tuple[str, str]]:
        """Pairs of names that come closer than a margin [m] at some instant t [s] of a primitive, from its start."""
        primitive, geometry = motion.primitives[index], self.geometry.copy()
        geometry.removeAllCollisionPairs()
        objects = geometry.geometryObjects
        for name, X_WO in primitive.X_WO.items():
            objects[self.things[name]].placement = self.X_BW * pin.SE3(np.asarray(X_WO))
        if primitive.held is not None:
            held = objects[self.things[primitive.held]]
            held.parentJoint, held.placement = self.joint, self.X_JT * pin.SE3(np.asarray(primitive.X_TO))
        absent = self.things.keys() - {*primitive.X_WO, primitive.held}
        for i, j in combinations(range(geometry.ngeoms), 2):
            names = pair(self.names[i], self.names[j])
            known = names in self.unchecked or {"tool", primitive.held} == {*names} or absent & {*names}
            if not known and objects[i].parentJoint != objects[j].parentJoint:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
        found, model_data, data = set[tuple[str, str]](), self.model.createData(), geometry.createData()
        for request in data.collisionRequests:
            request.security_margin = margin
        for q in primitive.trajectory.positions(t):
            pin.computeCollisions(self.model, model_data, geometry, data, self.configuration(q), False)
            for both, result in zip(geometry.collisionPairs, data.collisionResults, strict=True):
                if result.isCollision():
                    found.add(pair(self.names[both.first], self.names[both.second]))
        return found


SUCTION_CUP = [(0.01, 0.03, 0.02), (0.05, 0.01, 0.06), (0.09, 0.016, 0.02)]
"""Height of the middle, radius and length of its cylinders [m]."""


def pinocchio_arm(cell: Cell) -> PinocchioArm:
    """That of a UR with the suction cup."""
    tool = [(pose(position=(0, 0, z)), coal.Cylinder(radius, length)) for z, radius, length in SUCTION_CUP]
    X_LT = pose(position=(0, 0, 0.1))
    return PinocchioArm(cell.robot, cell.model, "tool0", X_LT, tool, cell.objects, cell.robot.disabled_pairs)


def even_steps(trajectory: Trajectory, step: float) -> Array:
    """Instants [s] between which all joints together move by no more than a step [rad or m]."""
    t = np.linspace(0, trajectory.duration, 4000)
    moved = np.abs(np.diff(trajectory.positions(t), axis=0)).sum(axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(moved)])
    return np.interp(np.linspace(0, travelled[-1], 2 + int(1.1 * travelled[-1] / step)), travelled, t)


def assert_keeps_limits(model: RobotModel, motion: Motion, step: float = 1e-3) -> None:
    """That position, velocity, acceleration and jerk of every joint of the arm stay within their limits at any time.

    So its primitives begin where the one before ends, at rest, and have no jolt where a law or a path breaks.
    """
    n = len(model.arm)
    for primitive in motion.primitives:
        trajectory = primitive.trajectory
        t = np.concatenate([np.arange(0, trajectory.duration, step), phase_samples(trajectory, 9)])
        for order, limit in ((1, model.velocity), (2, model.acceleration), (3, model.jerk)):
            over = np.abs(trajectory.motion(t, order)[order][:, :n]) <= limit * (1 + 1e-9)
            assert over.all(), (primitive.name, order)
        q = trajectory.positions(t)[:, :n]
        assert ((q >= model.lower - 2e-9) & (q <= model.upper + 2e-9)).all(), primitive.name
        joints = [trajectory.law.time_at(s) for s in trajectory.path.breaks[1:-1]]
        for instant in [*trajectory.law.breaks[1:-1], *joints]:
            sides = np.array([instant - 1e-7, instant + 1e-7])
            for order, limit in ((1, model.acceleration), (2, model.jerk)):
                jump = np.abs(np.diff(trajectory.motion(sides, order)[order][:, :n], axis=0))
                assert (jump <= 2.1e-7 * limit + 1e-9).all(), (primitive.name, instant)
        for order, close in ((1, 1e-9), (2, 1e-7)):
            edges = trajectory.motion([0.0, trajectory.duration], order)[order]
            np.testing.assert_allclose(edges[:, :n], 0, atol=close)
    for before, after in pairwise(motion.primitives):
        assert before.end == after.start
        ends = before.trajectory.positions([np.inf])[0], after.trajectory.positions([0.0])[0]
        np.testing.assert_allclose(*ends, atol=1e-9)


def phase_samples(trajectory: Trajectory, least: int, whole: int = 0) -> Array:
    """Instants [s] in each phase of a trajectory, both its ends included as seen from within, shape (m,).

    A phase lasts from one break of law or path to the next. Each gets `least` of them, 2 or more, and its share of
    another `whole`, by how much of the path it covers.
    """
    law, breaks = trajectory.law, trajectory.law.breaks
    if joints := [law.time_at(s) for s in trajectory.path.breaks[1:-1]]:
        breaks = np.unique(np.concatenate([breaks, joints]))
    counts = least + np.ceil(whole * np.diff(law.derivatives(breaks, 0)[0])).astype(int)
    starts, ends = breaks[:-1], np.nextafter(breaks[1:], 0.0)
    phase, number = ranges(np.zeros(len(counts)), counts)
    instants: Array = number * ((ends - starts) / (counts - 1))[phase] + starts[phase]
    instants[np.cumsum(counts) - 1] = ends
    return instants
