"""The joints that move the links of an arm, for bounds of their motion, and steps of its fingers."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.solids import load_solid


class MotionBound:
    """What moves each link, from the axes of the joints; the kernel computes the bounds themselves (`Places::bound`).

    The spine are the joints on the way to the tool frame, those included that follow others. Rods, as those of a
    parallel linkage, hang on joints beside it that follow joints of the arm.

    spine: index of each joint of the spine among all of the robot, s of them.
    depth: for every link of robot and tool, how many joints of the spine move it: the first `depth` ones.
    rods: the joints beside the spine that move a link with the arm, from the spine outwards, by link; most have none.
    radii: distance [m] of the outermost link from the axis of each of the arm's n joints at one configuration, shape
    (n,); 1 for a prismatic joint. A measure of size, not a bound.
    """

    def __init__(self, model: RobotModel) -> None:
        """Find the axes of the joints."""
        tree, n = model.tree, len(model.arm)
        ratios = np.abs(model.arm_ratios)
        driven = set(np.flatnonzero(ratios.any(axis=1)).tolist())
        self.spine = [joint for joint in tree.chain(model.tool_frame) if joint in driven]
        moved_by = {link: [joint for joint in tree.chain(link) if joint in driven] for link in tree.mounts}
        self.depth = {link: sum(joint in self.spine for joint in by) for link, by in moved_by.items()}
        beside = {link: tuple(joint for joint in by if joint not in self.spine) for link, by in moved_by.items()}
        self.rods = {link: joints for link, joints in beside.items() if joints}
        q = np.asarray(model.home) + 0.1 * np.arange(1, n + 1)
        frames = model.frame_poses(model.with_fingers(q[None]))[0, self.spine]
        origins = np.stack([X_WL[0, :3, 3] for X_WL in model.link_poses(q[None]).values()])
        axes = (frames[:, :3, :3] @ tree.axes[self.spine][:, :, None])[..., 0]
        distances = np.linalg.norm(np.cross(origins - frames[:, None, :3, 3], axes[:, None]), axis=-1).max(axis=1)
        self.radii: Array = ratios[self.spine].T @ np.where(tree.turns[self.spine], distances, 1.0)


def finger_steps(model: RobotModel, start: Array, end: Array, step: float) -> int:
    """Number of equal steps of the fingers from start to end, (f,) each, so that no point moves over `step` [m].

    At least 1. Measured at the boxes around the solids, along 33 positions.
    """
    share = np.linspace(0.0, 1.0, 33)[:, None]
    poses = model.link_poses(
        np.concatenate([np.broadcast_to(model.home, (33, len(model.home))), start + share * (end - start)], axis=1)
    )
    corners = [
        transform(poses[part.parent], load_solid(part).corners)
        for part in model.parts
        if part.parent in model.fingers.links
    ]
    longest = max((float(np.linalg.norm(np.diff(c, axis=0), axis=-1).max()) for c in corners), default=0.0)
    return max(1, int(np.ceil(32 * longest / step)))
