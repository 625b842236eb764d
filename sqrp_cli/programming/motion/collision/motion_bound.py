"""Upper bounds of the motion of the arm's points for small joint motions, and proofs of clearance from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array, Indices, Mask, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.solids import load_solid

JOINTS = 2
"""Bodies moved by at most this many joints, all turning, are low on the arm."""

MOST_CORNERS = 256
"""Bodies with more corners are checked by distances, which are then faster."""


class MotionBound:
    """Upper bounds of the motion of the arm's links against each other, from the axes of its joints.

    depth: for every link of robot and tool, how many of the arm's joints move it: the first `depth` ones.
    joints: index of each of the arm's joints among all of the robot, n of them.
    radii: distance [m] of the outermost link from each joint's axis at one configuration, shape (n,); 1 for a prismatic
    joint. A measure of size, not a bound.
    """

    def __init__(self, model: RobotModel) -> None:
        """Find the axes of the arm's joints.

        Raises InputError if a joint of the arm mimics another one, which the bound does not cover.
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
        self.joints = [tree.index(name) for name in model.arm]
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

    def between(self, X_WF: Array, variation: Array, centers: Array, radii: Array, depth: Indices) -> Array:
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


class LowBodies:
    """Proof that bodies low on the arm stay clear of its support, such as a table.

    Bodies that only the first joints carry are always near the support, so spheres around them prove nothing. But their
    lowest points are near the joints' axes and hardly move, mostly along the table's top and not towards it. Low bodies
    are stored as the V corners of their hulls.

    row: index of each body among the low ones, -1 if it is not, shape (S,).
    """

    def __init__(self, model: RobotModel, bound: MotionBound, bodies: Sequence[Body]) -> None:
        self._bound = bound
        low = [i for i, body in enumerate(bodies) if _is_low(model, bound.depth[body.name], body)]
        self.row = np.full(len(bodies), -1)
        self.row[low] = np.arange(len(low))
        mounts = [model.tree.mounts[bodies[i].name] for i in low]
        self._frame = np.array([mount.joint for mount in mounts], dtype=np.intp)
        most = max((len(bodies[i].corners) for i in low), default=0)
        self._corners = np.empty((len(low), 3, most))  # in the frames
        self._levers = np.zeros((len(low), JOINTS, most))  # upper bounds of the corners' distances from the axes [m]
        X_WF = model.frame_poses(model.with_fingers(model.home[None]))
        axes, origins = bound.axes(X_WF)[0], X_WF[0, bound.joints, :3, 3]
        for index, (i, mount) in enumerate(zip(low, mounts, strict=True)):
            corners = np.pad(bodies[i].corners, ((0, most - len(bodies[i].corners)), (0, 0)), mode="edge")
            corners = transform(mount.X_JL, corners)
            self._corners[index] = corners.T
            points, last = transform(X_WF[0, mount.joint], corners), bound.depth[bodies[i].name] - 1
            # The distance from the last axis is constant; that from the first is at most the sum by way of the last.
            self._levers[index, last] = np.linalg.norm(np.cross(points - origins[last], axes[last]), axis=1)
            if last > 0:
                by_last = np.linalg.norm(points - origins[last], axis=1)
                self._levers[index, 0] = by_last + np.linalg.norm(np.cross(origins[last] - origins[0], axes[0]))

    def stay_off(self, X_WF: Array, variation: Array, row: Indices, X_WB: Array, half: Array, margin: Array) -> Mask:
        """Whether bodies provably stay further than a margin from boxes at rest, in k cases, shape (k,).

        All corners must stay beyond one of the six faces, the one beyond which they are furthest. Joints turn one after
        the other, the outermost first, as in `MotionBound.between`; each moves a corner at right angles to its axis, so
        that only the sine of the angle between the axis and the face's normal counts.

        X_WF: frames, (k, N + 1, 4, 4), and variation: how much each joint may differ, (k, n), as of `MotionBound`.
        row: which body, (k,). X_WB, half: pose and half extents of the box, (k, 4, 4) and (k, 3). margin: (k,) [m].
        """
        cases, R_BW = np.arange(len(row)), X_WB[:, :3, :3].swapaxes(1, 2)
        X_WC = X_WF[cases, self._frame[row]]
        corners = (R_BW @ X_WC[:, :3, :3]) @ self._corners[row]
        corners += R_BW @ (X_WC[:, :3, 3:] - X_WB[:, :3, 3:])
        beyond = np.concatenate([corners.min(axis=2) - half, -corners.max(axis=2) - half], axis=1)
        face = beyond.argmax(axis=1)
        axis, sign = face % 3, np.where(face < 3, 1.0, -1.0)
        heights = sign[:, None] * corners[cases, axis] - half[cases, axis, None]
        cosines = (self._bound.axes(X_WF) @ R_BW[cases, axis, :, None])[..., 0]
        sines = np.sqrt(np.maximum(1.0 - cosines * cosines, 0.0))
        moved = 0.0
        for j in reversed(range(min(JOINTS, variation.shape[1]))):
            steps = variation[:, j, None] * (self._levers[row, j] + moved)
            heights -= sines[:, j, None] * steps
            moved = moved + steps
        stays: Mask = heights.min(axis=1) > margin
        return stays


def _is_low(model: RobotModel, depth: int, body: Body) -> bool:
    moves = 0 < depth <= JOINTS and bool(model.turns[:depth].all()) and body.name not in model.fingers.links
    return moves and len(body.corners) <= MOST_CORNERS


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
