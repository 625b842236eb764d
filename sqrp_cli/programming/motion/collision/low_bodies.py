"""Proof without distances that what is low on the arm stays off what it stands on, such as a table.

What only the first joints carry is always near to that, so that spheres around it prove nothing. But its lowest points
are near to the joints' axes and hardly move, and most of their motion is along the table's top, not towards it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.motion.collision.motion_bound import MotionBound

JOINTS = 2
"""What no more than so many joints of the arm move is low on it, if these turn."""

MOST_CORNERS = 256
"""Bodies with more corners are left to distances, which then are quicker."""


class LowBodies:
    """The low ones among the bodies of robot and tool, as the V corners of their hulls.

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
            # The distance from the last axis never changes; that from the first is at most that by way of the last.
            self._levers[index, last] = np.linalg.norm(np.cross(points - origins[last], axes[last]), axis=1)
            if last > 0:
                by_last = np.linalg.norm(points - origins[last], axis=1)
                self._levers[index, 0] = by_last + np.linalg.norm(np.cross(origins[last] - origins[0], axes[0]))

    def stay_off(
        self, X_WF: Array, variation: Array, row: NDArray[np.intp], X_WB: Array, half: Array, margin: Array
    ) -> NDArray[np.bool_]:
        """Whether bodies are proven to stay further than a margin from boxes at rest, in k cases, shape (k,).

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
        stays: NDArray[np.bool_] = heights.min(axis=1) > margin
        return stays


def _is_low(model: RobotModel, depth: int, body: Body) -> bool:
    moves = 0 < depth <= JOINTS and bool(model.turns[:depth].all()) and body.name not in model.fingers.links
    return moves and len(body.corners) <= MOST_CORNERS
