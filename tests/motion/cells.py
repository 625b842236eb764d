"""Robots among things, to plan motions in and to check them independently."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
from pydantic import TypeAdapter

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, ranges
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


class PinocchioCell:
    """The same cell as Pinocchio reads it itself, to check contacts independently: its geometry, its kinematics."""

    def __init__(self, cell: Cell, margin: float) -> None:
        robot = cell.robot
        self.model = pin.buildModelFromUrdf(str(robot.urdf.path))
        folders = [str(root) for root in robot.package_roots]
        kind = pin.GeometryType.COLLISION
        self.geometry = pin.buildGeomFromUrdf(self.model, str(robot.urdf.path), kind, package_dirs=folders)
        flange = self.model.getFrameId("tool0")
        joint, X_JF = self.model.frames[flange].parentJoint, self.model.frames[flange].placement
        self.tool = [
            self._add(f"tool{k}", joint, X_JF * pin.SE3(np.eye(3), np.array([0, 0, z])), coal.Cylinder(radius, length))
            for k, (z, radius, length) in enumerate([(0.01, 0.03, 0.02), (0.05, 0.01, 0.06), (0.09, 0.016, 0.02)])
        ]
        self.X_JT = X_JF * pin.SE3(np.eye(3), np.array([0, 0, 0.1]))
        self.robot = range(self.geometry.ngeoms)
        self.things = {name: self._add(name, 0, pin.SE3(t.X_WO), coal.Box(*t.size)) for name, t in cell.objects.items()}
        self.held = {
            name: self._add(name + "@tool", joint, pin.SE3.Identity(), coal.Box(*t.size))
            for name, t in cell.objects.items()
        }
        self.last_joint, self.margin = joint, margin
        self.data = self.model.createData()

    def _add(self, name: str, joint: int, X: pin.SE3, shape: coal.CollisionGeometry) -> int:
        return self.geometry.addGeometryObject(pin.GeometryObject(name, joint, X, shape))

    def contacts(self, motion: Motion, index: int, touching: set[tuple[str, str]], t: Array) -> set[tuple[str, str]]:
        """Pairs of names that touch at some instant t [s] of a primitive, from its start, other than the ones named."""
        primitive = motion.primitives[index]
        geometry = self.geometry.copy()
        geometry.removeAllCollisionPairs()
        objects = geometry.geometryObjects
        for name, X in primitive.X_WO.items():
            objects[self.things[name]].placement = pin.SE3(np.asarray(X))
        if primitive.held is not None:
            objects[self.held[primitive.held]].placement = self.X_JT * pin.SE3(np.asarray(primitive.X_TO))
        solid = [*self.robot, *(self.things[name] for name in primitive.X_WO)]
        solid += [self.held[primitive.held]] if primitive.held is not None else []
        for i, j in combinations(solid, 2):
            a, b = objects[i], objects[j]
            near = a.parentJoint == b.parentJoint or abs(a.parentJoint - b.parentJoint) == 1
            both_robot = i in self.robot and j in self.robot
            fixed = a.parentJoint == 0 and b.parentJoint == 0
            taken = {i, j} & set(self.held.values()) and {i, j} & set(self.tool)
            named = pair(*("tool" if k in self.tool else objects[k].name.split("@")[0] for k in (i, j))) in touching
            if not (fixed or taken or named or (both_robot and near)):
                geometry.addCollisionPair(pin.CollisionPair(i, j))
        data = geometry.createData()
        for request in data.collisionRequests:
            request.security_margin = self.margin
        found = set()
        for q in primitive.trajectory.positions(t)[:, : self.model.nq]:
            pin.computeCollisions(self.model, self.data, geometry, data, q, False)
            for k, result in enumerate(data.collisionResults):
                if result.isCollision():
                    both = geometry.collisionPairs[k]
                    found.add(pair(objects[both.first].name, objects[both.second].name))
        return found


def phase_samples(trajectory: Trajectory, least: int, whole: int = 0) -> Array:
    """Instants [s] in each phase of a trajectory, both its ends included as seen from within, shape (m,).

    A phase lasts from one break of law or path to the next. Each gets `least` of them, 2 or more, and its share of
    another `whole`, by how much of the path it covers.
    """
    law, breaks = trajectory.law, trajectory.law.breaks
    if joints := [law.time_at(s) for s in trajectory.path.breaks[1:-1]]:
        breaks = np.unique(np.concatenate([breaks, joints]))
    counts = least + np.ceil(whole * np.diff(law.positions(breaks))).astype(int)
    starts, ends = breaks[:-1], np.nextafter(breaks[1:], 0.0)
    phase, number = ranges(np.zeros(len(counts)), counts)
    instants: Array = number * ((ends - starts) / (counts - 1))[phase] + starts[phase]
    instants[np.cumsum(counts) - 1] = ends
    return instants
