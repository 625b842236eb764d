"""A sphere that an arm's outermost axis cannot leave: proof, without a search, that places are too far."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sqrp_cli.geometry import Array, inverse
from sqrp_cli.programming.arm.kinematics import RobotModel

ROUNDS = 100
"""Rounds in which the points on the axes are moved to where the chain of them is short."""

LEAST_DISTANCE = 1e-9
"""Added to distances from axes, so that they have shares where all are zero [m]."""


def beyond_reach(model: RobotModel, X_WT: Array) -> float:
    """How far [m] a tool pose X_WT, shape (4, 4), lies outside of a sphere that no pose of its orientation can leave.

    Positive: it cannot be reached, and lacks at least this. Otherwise it proves nothing; without a bound -infinite.

    A point on an axis stays where it is in both links that the axis joins. So the point chosen on the last axis is no
    further from the one on the first than all distances of points on neighbouring axes together, and the tool pose says
    where it has to be.
    """
    bound = _bound(model)
    if bound is None:
        return -np.inf
    center, radius, point_T = bound
    wrist = X_WT[:3, :3] @ point_T + X_WT[:3, 3]
    return float(np.linalg.norm(wrist - center)) - radius


@lru_cache(maxsize=8)
def _bound(model: RobotModel) -> tuple[Array, float, Array] | None:
    """Centre [m] and radius [m] of the sphere, and the point in the tool frame; None where a joint slides or follows.

    The points are those that make the chain short: one after the other moves to where the way over it between its
    neighbours is shortest, which lies between their heights along its axis as their distances from the axis share it.
    """
    if not model.turns.all() or not model.joints_move_alone:
        return None
    axes, points = model.jacobian(model.home)[3:].T, model.joint_origins(model.home)
    n = len(points)
    for _ in range(ROUNDS):
        for k in range(n):
            neighbours = points[[i for i in (k - 1, k + 1) if 0 <= i < n]] - points[k]
            heights = neighbours @ axes[k]
            # With both neighbours on the axis, as where axes meet in one point, any place between them does.
            distances = np.linalg.norm(neighbours - heights[:, None] * axes[k], axis=1) + LEAST_DISTANCE
            shares = distances[::-1] / distances.sum()
            points[k] += (heights * shares).sum() * axes[k]
    radius = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    X_TW = inverse(model.tool_pose(model.home))
    return points[0], radius, X_TW[:3, :3] @ points[-1] + X_TW[:3, 3]
