"""How far points of the arm can move while its joints move a little."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array, inverse, transform
from sqrp_cli.programming.arm.kinematics import RobotModel


class MotionBound:
    """Upper bounds of the motion of the arm's links against each other, from the axes of its joints.

    depth: for every link of robot and tool, how many of the arm's joints move it: the first `depth` ones.
    radii: distance [m] of the outermost link from each joint's axis at one configuration, shape (n,); 1 for a prismatic
    joint. A measure of size, no bound.
    """

    def __init__(self, model: RobotModel) -> None:
        """Find the axes of the arm's joints, in the frames of links that they move.

        Raises InputError for an arm with coupled joints (one that mimics another one of the arm), which the bound does
        not cover.
        """
        n = len(model.arm)
        self._turns = model.turns
        q = np.asarray(model.home) + 0.1 * np.arange(1, n + 1)
        poses = model.link_poses(np.stack([q, *(q + 0.3 * np.eye(n))]))
        moves = {link: np.abs(X_WL[1:] - X_WL[0]).max(axis=(1, 2)) > 1e-9 for link, X_WL in poses.items()}
        self.depth = {link: int(np.flatnonzero(by)[-1]) + 1 if by.any() else 0 for link, by in moves.items()}
        linear, angular = (rows.T for rows in np.split(model.jacobian(q), 2))
        points = model.tool_pose(q)[:3, 3] + np.cross(angular, linear)
        self._links = [next(link for link in poses if self.depth[link] == j + 1) for j in range(n)]
        X_LW = np.stack([inverse(poses[link][0]) for link in self._links])
        self._points = transform(X_LW, points[:, None])[:, 0]
        self._axes = (X_LW[:, :3, :3] @ angular[..., None])[..., 0]
        origins = np.stack([X_WL[0, :3, 3] for X_WL in poses.values()])
        distances = np.linalg.norm(np.cross(origins - points[:, None], angular[:, None]), axis=-1).max(axis=1)
        self.radii = np.where(self._turns, distances, 1.0)
        self._check_uncoupled(model, q)

    def _check_uncoupled(self, model: RobotModel, q: Array) -> None:
        """Links of equal depth must be rigidly connected, and the axes found must give the Jacobian everywhere."""
        other = q + 0.3 + 0.1 * np.arange(len(q))
        poses = model.link_poses(np.stack([q, other]))
        rigid = [inverse(poses[self._links[d - 1]]) @ poses[link] for link, d in self.depth.items() if d > 0]
        frames = np.stack([poses[link][1] for link in self._links])
        axes = (frames[:, :3, :3] @ self._axes[..., None])[..., 0]
        arms = model.tool_pose(other)[:3, 3] - transform(frames, self._points[:, None])[:, 0]
        expected = np.concatenate([np.cross(axes, arms), axes], axis=1)[self._turns]
        off = np.abs(model.jacobian(other).T[self._turns] - expected).max(initial=0.0)
        if max(off, *(np.abs(X[1] - X[0]).max() for X in rigid)) > 1e-6:
            message = "a joint of the arm mimics another joint of the arm, which collision checks do not support"
            raise InputError(Problem("coupled-arm", message))

    def between(
        self, link_poses: Mapping[str, Array], variation: Array, centers: Array, radii: Array, depth: NDArray[np.intp]
    ) -> Array:
        """How far any point of each of S spheres can move around m configurations [m], shape (S, m, n + 1).

        Entry k: against the links of depth k (0: against the world), for spheres no less deep.

        link_poses: at the configurations, shape (m, 4, 4) each. variation: how much each joint may differ, (m, n).
        centers: of the spheres at the configurations, in the world, (S, m, 3) [m]; radii (S,) [m]. depth: of the link
        that carries each sphere, (S,).

        Turn the joints one after the other, the outermost first: joint j then still stands where it did, and moves a
        point by at most its angle times the point's distance from the axis, which is the distance at the configuration
        plus what the joints further out have moved the point. The motion of the whole is at most the sum.
        """
        count, n = len(radii), len(self._links)
        motion = np.zeros((count, len(variation), n + 1))
        for j in reversed(range(n)):
            carried = depth > j
            X_WL = link_poses[self._links[j]]
            step = np.broadcast_to(variation[:, j], (int(carried.sum()), len(variation)))
            if self._turns[j]:
                axis = X_WL[:, :3, :3] @ self._axes[j]
                arms = centers[carried] - transform(X_WL, self._points[j][None])[:, 0]
                along = (arms * axis).sum(axis=-1)
                distance = np.sqrt(np.maximum((arms * arms).sum(axis=-1) - along * along, 0.0))
                step = step * (distance + radii[carried][:, None] + motion[carried, :, j + 1])
            motion[carried, :, j] = motion[carried, :, j + 1] + step
        return motion
