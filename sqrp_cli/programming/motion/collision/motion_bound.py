"""How far points of the arm can move while its joints move a little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.programming.arm.kinematics import RobotModel


class MotionBound:
    """Upper bounds of the motion of the arm's links against each other, from the axes of its joints.

    depth: for every link of robot and tool, how many of the arm's joints move it: the first `depth` ones.
    joints: index of each of the arm's joints among all of the robot, n of them.
    radii: distance [m] of the outermost link from each joint's axis at one configuration, shape (n,); 1 for a prismatic
    joint. A measure of size, no bound.
    """

    def __init__(self, model: RobotModel) -> None:
        """Find the axes of the arm's joints.

        Raises InputError for an arm with coupled joints (one that mimics another one of the arm), which the bound does
        not cover.
        """
        if model.followers:
            joint = model.followers[0]
            leader = joint.mimic.joint if joint.mimic else ""
            message = (
                f"joint `{joint.name}` mimics `{leader}`, a joint of the arm, which collision checks do not support"
            )
            mend = f"if it is a rod of a linkage that does not matter here, make `{joint.name}` a fixed joint in a copy"
            raise InputError(Problem("coupled-arm", message, joint.place, mend=mend))
        tree, n = model.tree, len(model.arm)
        names = [joint.name for joint in tree.joints]
        self.joints = [names.index(name) for name in model.arm]
        self._axes = tree.axes[self.joints]
        self._turns = model.turns
        moved_by = {link: set(self.joints).intersection(tree.chain(link)) for link in tree.mounts}
        self.depth = {link: max((self.joints.index(j) + 1 for j in by), default=0) for link, by in moved_by.items()}
        q = np.asarray(model.home) + 0.1 * np.arange(1, n + 1)
        frames = model.frame_poses(model.with_fingers(q[None]))[0, self.joints]
        origins = np.stack([X_WL[0, :3, 3] for X_WL in model.link_poses(q[None]).values()])
        axes = (frames[:, :3, :3] @ self._axes[:, :, None])[..., 0]
        distances = np.linalg.norm(np.cross(origins - frames[:, None, :3, 3], axes[:, None]), axis=-1).max(axis=1)
        self.radii = np.where(self._turns, distances, 1.0)

    def axes(self, X_WF: Array) -> Array:
        """Unit vectors along the axes of the arm's joints in the world at m configurations, shape (m, n, 3).

        X_WF: frames, as of `RobotModel.frame_poses`.
        """
        axes: Array = (X_WF[:, self.joints, :3, :3] @ self._axes[:, :, None])[..., 0]
        return axes

    def between(self, X_WF: Array, variation: Array, centers: Array, radii: Array, depth: NDArray[np.intp]) -> Array:
        """How far any point of each of S spheres can move around m configurations [m], shape (m, S, n + 1).

        Entry k: against the links of depth k (0: against the world), for spheres no less deep.

        X_WF: at the configurations, as of `RobotModel.frame_poses`. variation: how much each joint may differ, (m, n).
        centers: of the spheres at the configurations, in the world, (m, S, 3) [m]; radii (S,) [m]. depth: of the link
        that carries each sphere, (S,).

        Turn the joints one after the other, the outermost first: joint j then still stands where it did, and moves a
        point by at most its angle times the point's distance from the axis, which is the distance at the configuration
        plus what the joints further out have moved the point. The motion of the whole is at most the sum.
        """
        n = len(self.joints)
        motion = np.zeros((n + 1, *centers.shape[:2]))
        if not variation.any():
            return motion.transpose(1, 2, 0)
        axes = self.axes(X_WF)[..., None]
        arms = centers[:, None] - X_WF[:, self.joints][:, :, None, :3, 3]
        along = (arms @ axes)[..., 0]
        levers = np.sqrt(np.maximum(np.einsum("...i,...i", arms, arms) - along * along, 0.0)) + radii
        steps = variation.T[:, :, None] * (depth > np.arange(n)[:, None, None])
        for j in reversed(range(n)):
            lever = levers[:, j] + motion[j + 1] if self._turns[j] else 1.0
            motion[j] = motion[j + 1] + steps[j] * lever
        return motion.transpose(1, 2, 0)
