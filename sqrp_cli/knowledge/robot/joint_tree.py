"""The joints and links of robot and tool as one tree of matrices, for many positions at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.urdf import UrdfJoint, UrdfModel


@dataclass(frozen=True, eq=False)
class Mount:
    """What a link is rigidly fixed to: a joint by its index, -1 for the world, with the link's pose in it, (4, 4)."""

    joint: int
    X_JL: Array

    def with_offset(self, X_LC: Array) -> Mount:
        """The mount of something fixed to the link at a pose X_LC, (4, 4)."""
        return Mount(self.joint, self.X_JL @ X_LC)


@dataclass(frozen=True, eq=False)
class JointTree:
    """N movable joints, parents first, and the links that they carry.

    A joint at position q has the pose `A + sin(q) B + (1 - cos(q)) C` in its parent if it turns (Rodrigues' formula),
    and `A + q B` if it slides.

    joints: as in the URDFs. parents: index of each joint's parent, -1 for the world.
    turns: whether each joint turns, (N,). axes: unit vectors in the joints' frames, (N, 3).
    terms: the matrices A, B and C of each joint, (N, 3, 4, 4).
    mounts: what carries each link of robot and tool.
    """

    joints: tuple[UrdfJoint, ...]
    parents: tuple[int, ...]
    turns: NDArray[np.bool_]
    axes: Array
    terms: Array
    mounts: dict[str, Mount]

    @staticmethod
    def of(robot: UrdfModel, X_WB: Array, tool: UrdfModel | None, link: str | None, X_LT: Array | None) -> JointTree:
        """The tree of a robot whose root is at X_WB, with a tool whose root is at X_LT in a link of the robot."""
        joints: list[UrdfJoint] = []
        seats: list[Mount] = []
        mounts: dict[str, Mount] = {}

        def grow(urdf: UrdfModel, root: Mount) -> None:
            mounts[urdf.root] = root
            for joint in urdf.joints.values():
                seat = mounts[joint.parent].with_offset(joint.X_PJ)
                if joint.movable:
                    joints.append(joint)
                    seats.append(seat)
                    seat = Mount(len(joints) - 1, np.eye(4))
                mounts[joint.child] = seat

        grow(robot, Mount(-1, X_WB))
        if tool is not None and link is not None and X_LT is not None:
            grow(tool, mounts[link].with_offset(X_LT))
        return JointTree._with_matrices(joints, seats, mounts)

    @staticmethod
    def _with_matrices(joints: Sequence[UrdfJoint], seats: Sequence[Mount], mounts: dict[str, Mount]) -> JointTree:
        turns = np.array([joint.type != "prismatic" for joint in joints], dtype=bool)
        axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
        still = np.array([seat.X_JL for seat in seats]).reshape(-1, 4, 4)
        motion = np.zeros_like(still)
        motion[turns, :3, :3] = np.cross(axes[turns, None, :], np.eye(3)).swapaxes(1, 2)
        motion[~turns, :3, 3] = axes[~turns]
        terms = np.stack([still, still @ motion, still @ motion @ motion], axis=1)
        return JointTree(tuple(joints), tuple(seat.joint for seat in seats), turns, axes, terms, mounts)

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

    @cached_property
    def sliding(self) -> NDArray[np.intp]:
        """Indices of the joints that slide."""
        return np.flatnonzero(~self.turns)

    def poses(self, positions: Array) -> Array:
        """World poses X_WJ of all joints, shape (m, N, 4, 4), at positions of shape (m, N) [rad or m]."""
        factors = np.empty((*positions.T.shape, 3))  # joints first, which is quicker
        factors[..., 0], factors[..., 1], factors[..., 2] = 1.0, np.sin(positions).T, 1.0 - np.cos(positions).T
        if len(self.sliding):
            factors[self.sliding, :, 1], factors[self.sliding, :, 2] = positions[:, self.sliding].T, 0.0
        by_joint: Array = (factors @ self.terms.reshape(-1, 3, 16)).reshape(*positions.T.shape, 4, 4)
        for index, parent in enumerate(self.parents):
            if parent >= 0:
                by_joint[index] = by_joint[parent] @ by_joint[index]
        return by_joint.swapaxes(0, 1)
