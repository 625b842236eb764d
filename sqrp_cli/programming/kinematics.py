"""Where the links of a robot are at given joint positions. The only module that knows Pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Place, Problem, expected_names
from sqrp_cli.geometry import Array, inverse, pose, read_only, transform
from sqrp_cli.knowledge.packages import resolve
from sqrp_cli.knowledge.robot import Robot, Tool
from sqrp_cli.knowledge.scene import Part
from sqrp_cli.knowledge.urdf import UrdfJoint, UrdfModel, link_parts, read_urdf

WORLD_JOINT = 0
"""Pinocchio's joint that carries what never moves; its pose is the world's."""


@dataclass(frozen=True, eq=False)
class BoundingSphere:
    """A sphere around something solid that moves with a link: center (3,) in the link's frame [m], radius [m]."""

    link: str
    center: Array
    radius: float


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of a tree as matrices, for many positions at once.

    A joint at position q has the pose `still + sin(q) sine + (1 - cos(q)) versine` in its parent if it turns (Rodrigues'
    formula), and `still + q sine` if it slides; the matrices have shape (N, 4, 4).

    parent: index of each joint's parent in this list, -1 for the world; parents come first. turns: whether each joint
    turns, (N,). axes: unit vectors in the joints' frames, (N, 3).
    """

    parent: tuple[int, ...]
    turns: NDArray[np.bool_]
    axes: Array
    still: Array
    sine: Array
    versine: Array

    @staticmethod
    def of(X_PJ: Sequence[Array], joints: Sequence[UrdfJoint], parent: Sequence[int]) -> Joints:
        """Joints at poses X_PJ (4, 4) in their parents when at 0, with the types and axes of URDF joints."""
        still = np.stack(X_PJ)
        turns = np.array([joint.type != "prismatic" for joint in joints])
        axes = np.stack([joint.axis for joint in joints])
        motion = np.zeros_like(still)
        motion[turns, :3, :3] = _cross_matrices(axes[turns])
        motion[~turns, :3, 3] = axes[~turns]
        sine = still @ motion
        return Joints(tuple(parent), turns, axes, still, sine, sine @ np.where(turns[:, None, None], motion, 0.0))

    def chain(self, last: int) -> list[int]:
        """Indices of the joints from the world to joint `last`, which may be -1."""
        chain = []
        while last >= 0:
            chain.append(last)
            last = self.parent[last]
        return chain[::-1]

    def only(self, chain: Sequence[int]) -> Joints:
        """The joints of a chain that begins at the world."""
        rows = list(chain)
        parent = tuple(range(-1, len(rows) - 1))
        return Joints(parent, self.turns[rows], self.axes[rows], self.still[rows], self.sine[rows], self.versine[rows])

    def poses(self, positions: Array) -> Array:
        """World poses X_WJ of all joints, shape (m, N, 4, 4), at positions of shape (m, N) [rad or m]."""
        a = np.where(self.turns, np.sin(positions), positions)[..., None, None]
        b = np.where(self.turns, 1.0 - np.cos(positions), 0.0)[..., None, None]
        X_WJ = self.still + a * self.sine + b * self.versine
        for index, parent in enumerate(self.parent):
            if parent >= 0:
                X_WJ[:, index] = X_WJ[:, parent] @ X_WJ[:, index]
        return X_WJ


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot with its tool, placed in the world, that moves with the joints of its arm.

    The arm's joints are the movable ones from the robot's root to the tool frame, n of them. Joints off that way rest at
    their home position, or at 0, or at the limit nearest to it; joints that mimic another one follow it.

    arm: names of the arm's joints, from the root outwards. lower, upper, velocity, acceleration, jerk: their limits [rad or
    m, and s], shape (n,). home: their positions at the start of a program, (n,). turns: which of them turn, the others
    slide, (n,).
    links: every link of robot and tool. tool_links: those of the tool. tool_frame: the link that grasps.
    parts: the solid parts of robot and tool.
    adjacent_pairs: pairs of links with parts, each in alphabetical order, that are rigidly connected or meet at one joint.
    """

    arm: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    home: Array
    turns: NDArray[np.bool_]
    links: tuple[str, ...]
    tool_links: frozenset[str]
    tool_frame: str
    parts: tuple[Part, ...]
    adjacent_pairs: frozenset[tuple[str, str]]
    _joint_names: tuple[str, ...]
    _joints: Joints
    _ratios: Array
    _offsets: Array
    _carriers: NDArray[np.intp]
    _X_JL: Array
    _tool_chain: tuple[int, ...]
    _chain_joints: Joints
    _model: Any
    _data: Any

    @staticmethod
    def load(robot: Robot) -> RobotModel:
        """Read the URDFs of robot and tool and put them together.

        Raises InputError for a URDF or mesh reference that cannot be used, a name that robot and tool share, an unknown
        link or joint, or a tool frame that no joint moves.
        """
        urdf = read_urdf(robot.urdf)
        tool_urdf = read_urdf(robot.tool.urdf) if robot.tool else None
        urdfs = [urdf] if tool_urdf is None else [urdf, tool_urdf]
        _check_names(robot, urdfs)
        model = _assemble(robot, tool_urdf)

        names = tuple(model.names)[WORLD_JOINT + 1 :]
        urdf_joints = {name: joint for description in urdfs for name, joint in description.joints.items()}
        ordered = [urdf_joints[name] for name in names]
        parent = [int(index) - 1 for index in list(model.parents)[1:]]
        joints = Joints.of([X.homogeneous for X in list(model.jointPlacements)[1:]], ordered, parent)

        links = tuple(name for description in urdfs for name in description.links)
        frames = [model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in links]
        carriers = np.array([frame.parentJoint - 1 for frame in frames])
        chain = joints.chain(carriers[links.index(robot.tool_frame)])
        arm = [index for index in chain if ordered[index].mimic is None]
        if not arm:
            message = f"no joint moves the tool frame `{robot.tool_frame}`"
            raise InputError(Problem("no-arm", message, Place(robot.urdf)))
        limits = [_of_joint(robot.limits, names[index], robot) for index in arm]
        ratios, offsets = _couplings(ordered, arm, robot.home)
        parts = tuple(part for description in urdfs for part in _parts(description, robot))
        return RobotModel(
            arm=tuple(names[index] for index in arm),
            lower=read_only([limit.lower for limit in limits]),
            upper=read_only([limit.upper for limit in limits]),
            velocity=read_only([limit.velocity for limit in limits]),
            acceleration=read_only([limit.acceleration for limit in limits]),
            jerk=read_only([limit.jerk for limit in limits]),
            home=read_only([_rest(ordered[index], robot.home) for index in arm]),
            turns=joints.turns[arm],
            links=links,
            tool_links=frozenset(tool_urdf.links if tool_urdf else ()),
            tool_frame=robot.tool_frame,
            parts=parts,
            adjacent_pairs=_adjacent_pairs(parts, dict(zip(links, carriers.tolist(), strict=True)), joints),
            _joint_names=names,
            _joints=joints,
            _ratios=ratios,
            _offsets=offsets,
            _carriers=carriers,
            _X_JL=np.stack([frame.placement.homogeneous for frame in frames]),
            _tool_chain=tuple(chain),
            _chain_joints=joints.only(chain),
            _model=model,
            _data=model.createData(),
        )

    def link_poses(self, q: Array) -> Mapping[str, Array]:
        """World pose X_WL of every link, shape (m, 4, 4) each, at arm positions of shape (m, n)."""
        X_WJ = self._joints.poses(self._positions(q))
        moved = self._carriers >= 0
        X_WL = iter(np.moveaxis(X_WJ[:, self._carriers[moved]] @ self._X_JL[moved], 1, 0))
        still = (len(q), 4, 4)
        return {
            name: next(X_WL) if moves else np.broadcast_to(X_JL, still)
            for name, moves, X_JL in zip(self.links, moved, self._X_JL, strict=True)
        }

    def tool_pose(self, q: Array) -> Array:
        """World pose X_WT of the tool frame, shape (4, 4), at arm positions of shape (n,)."""
        pin.forwardKinematics(self._model, self._data, self._configuration(q))
        X_WT: Array = pin.updateFramePlacement(self._model, self._data, self._tool_frame_id).homogeneous
        return X_WT

    def jacobian(self, q: Array) -> Array:
        """Velocity of the tool frame's origin over its angular velocity, in world axes, per joint velocity; (6, n)."""
        frame, axes = self._tool_frame_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        full = pin.computeFrameJacobian(self._model, self._data, self._configuration(q), frame, axes)
        jacobian: Array = full @ self._ratios
        return jacobian

    def tool_poses_and_jacobians(self, q: Array) -> tuple[Array, Array]:
        """As `tool_pose` and `jacobian` at m positions of shape (m, n): shapes (m, 4, 4) and (m, 6, n)."""
        joints, rows = self._chain_joints, list(self._tool_chain)
        X_WJ = joints.poses(q @ self._ratios[rows].T + self._offsets[rows])
        X_WT = X_WJ[:, -1] @ self._X_JL[self.links.index(self.tool_frame)]
        axes = (X_WJ[:, :, :3, :3] @ joints.axes[:, :, None])[..., 0]
        arms = X_WT[:, None, :3, 3] - X_WJ[:, :, :3, 3]
        columns = np.zeros((len(q), len(rows), 6))
        columns[:, :, :3] = np.where(joints.turns[:, None], _cross(axes, arms), axes)
        columns[:, :, 3:] = np.where(joints.turns[:, None], axes, 0.0)
        return X_WT, np.swapaxes(columns, 1, 2) @ self._ratios[rows]

    def joint_values(self, q: Array) -> dict[str, float]:
        """Position [rad or m] of every movable joint of robot and tool, at arm positions of shape (n,)."""
        return dict(zip(self._joint_names, self._positions(q).tolist(), strict=True))

    def joint_radii(self, spheres: Iterable[BoundingSphere]) -> Array:
        """How far a unit of each arm joint's motion can move any point of the spheres, in any configuration; (n,).

        For a joint that turns: an upper bound of the distance from its axis [m]; for one that slides: 1. A point moves by
        at most the sum over the joints of |change of position| * radius. A held object is one more sphere, on the tool frame.

        The bound: from a sphere's center inwards, drop the perpendicular onto the axis of the joint that carries it, which
        leaves the foot unmoved by that joint, from the foot onto the next axis, and so on; add up the perpendiculars.
        """
        radii = np.zeros(len(self.arm))
        for sphere in spheres:
            link = self.links.index(sphere.link)
            point = transform(self._X_JL[link], sphere.center[None])[0]
            reach, radius = sphere.radius, np.zeros(len(self.arm))
            for joint in reversed(self._joints.chain(self._carriers[link])):
                axis = self._joints.axes[joint]
                if self._joints.turns[joint]:
                    foot = (point @ axis) * axis
                    reach += float(np.linalg.norm(point - foot))
                    radius += np.abs(self._ratios[joint]) * reach
                    point = foot
                else:
                    ends = self._ratios[joint] * np.stack([self.lower, self.upper])
                    ends = np.where(self._ratios[joint] == 0.0, 0.0, ends).sum(axis=1) + self._offsets[joint]
                    reach += float(abs(ends[1] - ends[0])) / 2
                    radius += np.abs(self._ratios[joint])
                    point = point + axis * ends.mean()
                point = transform(self._joints.still[joint], point[None])[0]
            radii = np.maximum(radii, radius)
        return radii

    def _positions(self, q: Array) -> Array:
        """Positions of all movable joints, shape (..., N), at arm positions of shape (..., n)."""
        positions: Array = q @ self._ratios.T + self._offsets
        return positions

    def _configuration(self, q: Array) -> Array:
        """Pinocchio's configuration vector: cosine and sine in place of the angle of a joint without limits."""
        positions = self._positions(q)
        if self._model.nq == len(positions):
            return positions
        configuration = np.empty(self._model.nq)
        for joint, start, size, position in zip(
            self._joint_names, list(self._model.idx_qs)[1:], list(self._model.nqs)[1:], positions, strict=True
        ):
            if size not in (1, 2):
                raise RuntimeError(f"Pinocchio gives joint {joint} {size} coordinates")
            configuration[start : start + size] = position if size == 1 else (np.cos(position), np.sin(position))
        return configuration

    @property
    def _tool_frame_id(self) -> int:
        return int(self._model.getFrameId(self.tool_frame, pin.FrameType.BODY))
