"""The robot as its encoders say it stands: link poses, frames of the cell and the outline of every solid part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.joint_tree import Couplings, JointTree
from sqrp_cli.knowledge.robot.robot import Fingers, Robot
from sqrp_cli.knowledge.text.packages import resolve_mesh
from sqrp_cli.runtime.surface import Surface

OPEN_SHARE = 0.25
"""Fingers count as open while they are closed by no more than this share of their way."""


@dataclass(frozen=True, eq=False)
class RobotBody:
    """A robot with its tool, placed in the world."""

    tree: JointTree
    rest: Mapping[str, float]
    """Position of joints that no encoder reports and that follow no other one [rad or m]."""
    surfaces: tuple[Surface, ...]
    tool_frame: str
    """The link that grasps."""
    fingers: Fingers | None
    """Of its gripper; None if it has none that move."""

    @classmethod
    def load(cls, robot: Robot) -> RobotBody:
        """Read the meshes. Raises InputError for those that cannot be used."""
        resolve = partial(resolve_mesh, robot.package_roots)
        parts = [part for urdf in robot.urdfs for part in urdf.parts(robot.geometry, resolve)]
        return cls(
            tree=JointTree.of(robot),
            rest=robot.rest,
            surfaces=tuple(Surface.of(part) for part in parts),
            tool_frame=robot.tool_frame,
            fingers=robot.fingers,
        )

    def link_poses(self, joints: Mapping[str, float]) -> dict[str, Array]:
        """World pose X_WL of every link, shape (4, 4), at joint positions [rad or m]; others are at rest."""
        return {link: X[0] for link, X in self.poses_over({name: np.array([q]) for name, q in joints.items()}).items()}

    def with_fingers(self, joints: Mapping[str, float], fingers: Mapping[str, float]) -> dict[str, float]:
        """Positions of the joints with others for the fingers, and for what mimics them."""
        leading = {joint.name for joint in self.tree.joints if joint.mimic is None}
        return {**{name: q for name, q in joints.items() if name in leading}, **fingers}

    def closure(self, joints: Mapping[str, float]) -> float:
        """How far the fingers are closed: 0 open, 1 closed; 0 without fingers."""
        if self.fingers is None:
            return 0.0
        opened, closed = self.fingers.open, self.fingers.closed
        shares = [(joints[name] - opened[name]) / (closed[name] - opened[name]) for name in opened if name in joints]
        return float(np.mean(shares)) if shares else 0.0

    def poses_over(self, joints: Mapping[str, Array]) -> dict[str, Array]:
        """World poses X_WL of every link, shape (m, 4, 4), for m positions of each joint, shape (m,)."""
        count = max((len(values) for values in joints.values()), default=1)
        known = [index for index, joint in enumerate(self.tree.joints) if joint.name in joints]
        q = np.array([joints[self.tree.joints[index].name] for index in known]).reshape(len(known), count).T
        X_WJ = self.tree.poses(Couplings.of(self.tree.joints, known, self.rest).positions(q))
        return {
            link: X_WJ[:, mount.joint] @ mount.X_JL if mount.joint >= 0 else np.tile(mount.X_JL, (count, 1, 1))
            for link, mount in self.tree.mounts.items()
        }
