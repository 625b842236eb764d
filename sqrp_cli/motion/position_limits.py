"""The position limits of the joints, and the exact excess of motions over them, also between samples."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable
from sqrp_cli.trajectory import JointPath, JointSpan

LIMIT_SLACK = 1e-9  # tolerated excess of joint positions over a limit [rad or m], for rounding
WIDE = 4 * np.pi + 1e-6  # a joint with a wider range than this is treated as one without limits [rad]


def whole_turns(low: Array, high: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """The fewest and most whole turns that keep joints with positions from low to high within limits; they broadcast.

    Turns are signed; the fewest are above the most if there are none.
    """
    fewest = np.ceil((lower - LIMIT_SLACK - low) / (2 * np.pi))
    return fewest, np.floor((upper + LIMIT_SLACK - high) / (2 * np.pi))


def past_limits(path: JointPath, lower: Array, upper: Array, may_turn: Mask | None = None) -> Array:
    """Largest excess of a path of n joints over limits, shape (n,) each [rad or m], shape (n,); 0 within the slack.

    may_turn: joints that whole turns may bring within their limits, shape (n,); none by default.
    """
    low, high = path.range_bounds()
    excess = np.zeros(len(lower))
    for joint in np.flatnonzero((low < lower - LIMIT_SLACK) | (high > upper + LIMIT_SLACK)).tolist():
        least, greatest = path.extremes(joint)
        past = float(max(lower[joint] - least, greatest - upper[joint]))
        if past > LIMIT_SLACK and may_turn is not None and may_turn[joint]:
            fewest, most = whole_turns(np.array(least), np.array(greatest), lower[joint], upper[joint])
            past = past if fewest > most else 0.0
        excess[joint] = past if past > LIMIT_SLACK else 0.0
    return excess


def worst_past_limit(model: RobotModel, path: JointPath) -> Unreachable | None:
    """The joint that leaves its limits most on a path of the driven joints, n + f of them; None if none does."""
    excess = past_limits(path, *model.position_limits)
    if not excess.any():
        return None
    joint = int(excess.argmax())
    turns = bool(model.tree.turns[model.tree.index(model.joints[joint])])
    return Unreachable("past limit", float(excess[joint]), model.joints[joint], turns)


def near_limits(model: RobotModel, near: Array) -> JointSpan:
    """The joints' limits; where they are none or very wide, a turn beyond positions `near`, (m, n)."""
    far = model.turns & (model.upper - model.lower > WIDE) | np.isinf(model.lower) | np.isinf(model.upper)
    lower = np.where(far, np.maximum(model.lower, near.min(axis=0) - 2 * np.pi), model.lower)
    upper = np.where(far, np.minimum(model.upper, near.max(axis=0) + 2 * np.pi), model.upper)
    return JointSpan(lower, upper)
