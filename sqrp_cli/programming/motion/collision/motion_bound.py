"""Upper bounds of the motion of the arm's points for small joint motions, and proofs of clearance from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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

    The spine are the joints on the way to the tool frame, those included that follow others. Rods, as those of a
    parallel linkage, hang on joints beside it that follow joints of the arm.

    depth: for every link of robot and tool, how many joints of the spine move it: the first `depth` ones.
    rods: the joints beside the spine that move a link with the arm, from the spine outwards, by link; most have none.
    spine: index of each joint of the spine among all of the robot, s of them.
    radii: distance [m] of the outermost link from the axis of each of the arm's n joints at one configuration, shape
    (n,); 1 for a prismatic joint. A measure of size, not a bound.
    """

    def __init__(self, model: RobotModel) -> None:
        """Find the axes of the joints."""
        tree, n = model.tree, len(model.arm)
        ratios = np.abs(model.arm_ratios)
        chain = tree.chain(model.tool_frame)
        driven = set(np.flatnonzero(ratios.any(axis=1)).tolist())
        self.spine = [joint for joint in chain if joint in driven]
        self._axes, self._turns = tree.axes[self.spine], tree.turns[self.spine]
        self._ratios, self._all_axes, self._all_ratios = ratios[self.spine], tree.axes, ratios
        self._all_turn = tree.turns
        self._alone = np.array_equal(self._ratios, np.eye(n))
        moved_by = {link: [joint for joint in tree.chain(link) if joint in driven] for link in tree.mounts}
        self.depth = {link: sum(joint in self.spine for joint in by) for link, by in moved_by.items()}
        beside = {link: tuple(joint for joint in by if joint not in self.spine) for link, by in moved_by.items()}
        self.rods = {link: joints for link, joints in beside.items() if joints}
        q = np.asarray(model.home) + 0.1 * np.arange(1, n + 1)
        frames = model.frame_poses(model.with_fingers(q[None]))[0, self.spine]
        origins = np.stack([X_WL[0, :3, 3] for X_WL in model.link_poses(q[None]).values()])
        axes = (frames[:, :3, :3] @ self._axes[:, :, None])[..., 0]
        distances = np.linalg.norm(np.cross(origins - frames[:, None, :3, 3], axes[:, None]), axis=-1).max(axis=1)
        sizes = np.where(self._turns, distances, 1.0)
        self.radii = sizes if self._alone else self._ratios.T @ sizes

    def axes(self, X_WF: Array) -> Array:
        """Unit vectors along the axes of the joints of the spine in the world at m configurations, shape (m, s, 3).

        X_WF: frames, as of `RobotModel.frame_poses`.
        """
        return (X_WF[:, self.spine, :3, :3] @ self._axes[:, :, None])[..., 0]

    def along_spine(self, variation: Array) -> Array:
        """How much each joint of the spine may differ, (m, s), where those of the arm differ by a variation, (m, n)."""
        return variation if self._alone else variation @ self._ratios.T

    def between(
        self,
        X_WF: Array,
        variation: Array,
        centers: Array,
        radii: Array,
        depth: Indices,
        rods: Sequence[tuple[int, tuple[int, ...]]] = (),
    ) -> Array:
        """How far any point of each of S spheres can move around m configurations [m], shape (m, S, s + 1).

        Entry k: against the links of depth k (0: against the world), for spheres no less deep. The last entry: against
        the link of the spine that carries the sphere, 0 except for rods.

        X_WF: at the configurations, as of `RobotModel.frame_poses`. variation: how much each joint may differ, (m, n).
        centers: of the spheres at the configurations, in the world, (m, S, 3) [m]; radii (S,) [m]. depth: of the link
        that carries each sphere, (S,). rods: which spheres are on rods, and the joints beside the spine that move them.

        Turn the joints one after the other, the outermost first: joint j then still stands where it did, and moves a
        point by at most its angle times the point's distance from the axis, which is the distance at the configuration
        plus what the joints further out have moved the point. The motion of the whole is at most the sum.
        """
        s = len(self.spine)
        motion = np.zeros((s + 1, *centers.shape[:2]))
        if not variation.any():
            return motion.transpose(1, 2, 0)
        for sphere, joints in rods:
            motion[s, :, sphere] = self._beside(X_WF, variation, centers[:, sphere], float(radii[sphere]), joints)
        axes = self.axes(X_WF)[..., None]
        arms = centers[:, None] - X_WF[:, self.spine][:, :, None, :3, 3]
        along = (arms @ axes)[..., 0]
        levers = np.sqrt(np.maximum(np.einsum("...i,...i", arms, arms) - along * along, 0.0)) + radii
        steps = self.along_spine(variation).T[:, :, None] * (depth > np.arange(s)[:, None, None])
        for j in reversed(range(s)):
            lever = levers[:, j] + motion[j + 1] if self._turns[j] else 1.0
            motion[j] = motion[j + 1] + steps[j] * lever
        return motion.transpose(1, 2, 0)

    def _beside(self, X_WF: Array, variation: Array, center: Array, radius: float, joints: Sequence[int]) -> Array:
        """As `between` for one sphere of a rod with its centres (m, 3): against what carries the rod, shape (m,)."""
        moved = np.zeros(len(center))
        for joint in reversed(joints):
            steps = variation @ self._all_ratios[joint]
            arms, axes = center - X_WF[:, joint, :3, 3], X_WF[:, joint, :3, :3] @ self._all_axes[joint]
            levers = np.linalg.norm(np.cross(arms, axes), axis=1) + radius + moved
            moved = moved + steps * (levers if self._all_turn[joint] else 1.0)
        return moved


class LowBodies:
    """Proof that bodies low on the arm stay clear of its support, such as a table.

    Bodies that only the first joints carry are always near the support, so spheres around them prove nothing. But their
    lowest points are near the joints' axes and hardly move, mostly along the table's top and not towards it. Low bodies
    are stored as the V corners of their hulls.

    row: index of each body among the low ones, -1 if it is not, shape (S,).
    """

    def __init__(self, model: RobotModel, bound: MotionBound, bodies: Sequence[Body]) -> None:
        self._bound = bound
        low = [i for i, body in enumerate(bodies) if _is_low(model, bound, body)]
        self.row = np.full(len(bodies), -1)
        self.row[low] = np.arange(len(low))
        mounts = [model.tree.mounts[bodies[i].name] for i in low]
        self._frame = np.array([mount.joint for mount in mounts], dtype=np.intp)
        most = max((len(bodies[i].corners) for i in low), default=0)
        self._corners = np.empty((len(low), 3, most))  # in the frames
        self._levers = np.zeros((len(low), JOINTS, most))  # upper bounds of the corners' distances from the axes [m]
        X_WF = model.frame_poses(model.with_fingers(model.home[None]))
        axes, origins = bound.axes(X_WF)[0], X_WF[0, bound.spine, :3, 3]
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
        moved, variation = 0.0, self._bound.along_spine(variation)
        for j in reversed(range(min(JOINTS, variation.shape[1]))):
            steps = variation[:, j, None] * (self._levers[row, j] + moved)
            heights -= sines[:, j, None] * steps
            moved = moved + steps
        stays: Mask = heights.min(axis=1) > margin
        return stays


def _is_low(model: RobotModel, bound: MotionBound, body: Body) -> bool:
    depth = bound.depth[body.name]
    moves = 0 < depth <= JOINTS and bool(model.tree.turns[bound.spine[:depth]].all()) and body.name not in bound.rods
    return moves and body.name not in model.fingers.links and len(body.corners) <= MOST_CORNERS


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
