"""The joints and links of robot and tool as one tree of matrices, for many positions at once, and joint couplings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.kernel.kernel import joint_poses
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import Robot
from sqrp_cli.robot.urdf import UrdfJoint


@dataclass(frozen=True, eq=False)
class Mount:
    """What a link is rigidly fixed to."""

    joint: int  # its index, -1 for the world
    X_JL: Array  # pose of the link in it, shape (4, 4)

    def with_offset(self, X_LC: Array) -> Mount:
        """The mount of something fixed to the link at a pose X_LC, (4, 4)."""
        return Mount(self.joint, self.X_JL @ X_LC)


def driving_joints(chain: Sequence[UrdfJoint], joints: Iterable[UrdfJoint]) -> list[UrdfJoint]:
    """The joints that drive those of a chain, in its order: the arm's, where the chain leads to its tool.

    They are the movable ones that follow no other. Where a joint with independent ones after it follows one beside the
    chain, such as the motor of a parallel linkage, the arm is driven by that one. joints: all of the robot.
    """
    named = {joint.name: joint for joint in joints}
    moving = [joint for joint in chain if joint.movable]
    last = max((place for place, joint in enumerate(moving) if joint.mimic is None), default=-1)
    within = [joint if joint.mimic is None else named[joint.mimic.joint] for joint in moving[: last + 1]]
    return list(dict.fromkeys(within))


@dataclass(frozen=True, eq=False)
class JointTree:
    """N movable joints, parents first, and the links that they carry.

    A joint at position q has the pose `A + sin(q) B + (1 - cos(q)) C` in its parent if it turns (Rodrigues' formula),
    and `A + q B` if it slides.
    """

    joints: tuple[UrdfJoint, ...]  # as in the URDFs
    parents: tuple[int, ...]  # index of each joint's parent, -1 for the world
    turns: NDArray[np.bool_]  # whether each joint turns, shape (N,); the others slide
    axes: Array  # unit vectors in the joints' frames, shape (N, 3)
    terms: Array  # the matrices A, B and C of each joint, shape (N, 3, 4, 4)
    mounts: dict[str, Mount]  # what carries each link of robot and tool

    @staticmethod
    def of(robot: Robot) -> JointTree:
        """All movable joints and all links of a robot and its tool, placed in the world."""
        joints: list[UrdfJoint] = []
        seats: list[Mount] = []  # of the joints at position 0
        mounts: dict[str, Mount] = {}

        for urdf in robot.urdfs:
            mounts[urdf.root] = Mount(-1, robot.X_WB)
            if robot.tool is not None and urdf is robot.tool.urdf:
                mounts[urdf.root] = mounts[robot.tool.link].with_offset(robot.tool.X_LT)
            for joint in urdf.joints.values():
                seat = mounts[joint.parent].with_offset(joint.X_PJ)
                if joint.movable:
                    joints.append(joint)
                    seats.append(seat)
                    seat = Mount(len(joints) - 1, np.eye(4))
                mounts[joint.child] = seat
        axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
        still = np.array([seat.X_JL for seat in seats]).reshape(-1, 4, 4)
        turns = np.array([joint.type != "prismatic" for joint in joints], dtype=bool)
        motion = np.zeros_like(still)
        motion[turns, :3, :3] = np.cross(axes[turns, None, :], np.eye(3)).swapaxes(1, 2)
        motion[~turns, :3, 3] = axes[~turns]
        terms = np.stack([still, still @ motion, still @ motion @ motion], axis=1)
        return JointTree(tuple(joints), tuple(seat.joint for seat in seats), turns, axes, terms, mounts)

    def index(self, joint: str) -> int:
        """The index of a joint by its name."""
        return [one.name for one in self.joints].index(joint)

    def chain(self, link: str) -> list[int]:
        """Indices of the joints that carry a link, from the world outwards."""
        chain, joint = [], self.mounts[link].joint
        while joint >= 0:
            chain.append(joint)
            joint = self.parents[joint]
        return chain[::-1]

    def along(self, chain: Sequence[int]) -> JointTree:
        """A tree of the joints of a chain that begins at the world, without links."""
        rows = list(chain)
        joints, parents = tuple(self.joints[row] for row in rows), tuple(range(-1, len(rows) - 1))
        return JointTree(joints, parents, self.turns[rows], self.axes[rows], self.terms[rows], {})

    @property
    def still(self) -> Array:
        """Poses of the joints in their parents at position 0, shape (N, 4, 4)."""
        return self.terms[:, 0]

    def poses(self, positions: Array) -> Array:
        """World poses X_WJ of all joints, shape (m, N, 4, 4), at positions of shape (m, N) [rad or m]."""
        return joint_poses(np.array(self.parents), self.turns, self.terms, positions).swapaxes(0, 1)


@dataclass(frozen=True, eq=False)
class Couplings:
    """Positions of all N joints from those of the n driven ones: `q @ ratios.T + offsets`."""

    ratios: Array  # shape (N, n)
    offsets: Array  # shape (N,) [rad or m]

    @staticmethod
    def of(joints: Sequence[UrdfJoint], driven: Sequence[int], rest: Mapping[str, float]) -> Couplings:
        """Couplings of all joints of a robot to the driven ones, given by index.

        Joints that mimic another one follow it unless they are driven themselves. The others rest at their position in
        `rest`, else at their `UrdfJoint.rest`.
        """
        ratios = np.zeros((len(joints), len(driven)))
        offsets = np.zeros(len(joints))
        ratios[driven, range(len(driven))] = 1.0
        rows = {joint.name: row for row, joint in enumerate(joints)}
        for row, joint in sorted(enumerate(joints), key=lambda one: one[1].mimic is not None):  # leaders first
            if joint.mimic is None and row not in driven:
                offsets[row] = rest.get(joint.name, joint.rest)
            elif joint.mimic is not None and row not in driven:
                leader = rows[joint.mimic.joint]
                ratios[row] = joint.mimic.multiplier * ratios[leader]
                offsets[row] = joint.mimic.multiplier * offsets[leader] + joint.mimic.offset
        return Couplings(ratios, offsets)

    def along(self, chain: Sequence[int]) -> Couplings:
        """Those of some of the joints."""
        return Couplings(self.ratios[list(chain)], self.offsets[list(chain)])

    def positions(self, q: Array) -> Array:
        """Positions of all joints, shape (..., N), from those of the driven ones, shape (..., n)."""
        return q @ self.ratios.T + self.offsets
