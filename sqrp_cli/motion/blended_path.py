"""Joint moves along polylines with blended corners: smooth, without stops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.timing import STANDSTILL, MotionLimits, joint_move, time_path
from sqrp_cli.trajectory import JointPath, Trajectory

_LEAVING = np.array([45 / 128, 1 / 2, 5 / 32, 0.0, -1 / 128])

_ARRIVING = np.array([-45 / 128, 1 / 2, -5 / 32, 0.0, 1 / 128])
"""Chebyshev coefficients of the curve around a corner: its shares of the directions after and before it."""


def motion_through(q0: Array, vias: Array, q1: Array, limits: MotionLimits) -> Trajectory:
    """The motion from q0 to q1, shape (n,), from rest to rest, that bends without a stop around each of vias, (k, n).

    Each corner is cut by the widest curve that leaves room for its neighbours', see `blended_path`. The result depends
    only on the arguments, never on the surroundings. A corner where the one before it is counts once.
    """
    kept = [q0]
    for corner in [*vias, q1]:
        if np.abs(corner - kept[-1]).max() > STANDSTILL:
            kept.append(corner)
    if len(kept) < 3:
        return joint_move(q0, q1, limits)
    corners = np.stack([*kept[:-1], q1])
    lengths = piece_durations(corners, limits.velocity)
    return blended_motion(corners, lengths, longest_reaches(lengths), limits)


def piece_durations(corners: Array, velocity: Array) -> Array:
    """Duration of each piece at the velocity limits [s], shape (k - 1,)."""
    lengths: Array = (np.abs(np.diff(corners, axis=0)) / velocity).max(axis=1)
    return lengths


def longest_reaches(lengths: Array) -> list[float]:
    """The longest reach of the curve around each inner corner; neighbours share the piece between them."""
    room = 0.5 * lengths
    room[[0, -1]] = lengths[[0, -1]]  # the ends are for one corner alone
    reaches: list[float] = np.minimum(room[:-1], room[1:]).tolist()
    return reaches


def blended_motion(corners: Array, lengths: Array, reaches: Sequence[float], limits: MotionLimits) -> Trajectory:
    """The fastest motion, from rest to rest, along a polyline with curves at all its inner corners."""
    # A curve's slope lies between those of the pieces that it joins, so these bound all velocities.
    steepest = limits.along(np.diff(corners, axis=0) / lengths[:, None] * lengths.sum())
    slowest = MotionLimits(steepest.velocity.min(), steepest.acceleration.min(), steepest.jerk.min())
    return time_path(blended_path(corners, lengths, reaches), limits, slowest)


def blended_path(corners: Array, lengths: Array, reaches: Sequence[float]) -> JointPath:
    """The path along a polyline that leaves each inner corner to one side.

    corners: shape (k, n), ends included. lengths: of the k - 1 pieces, in any unit of length, shape (k - 1,); the
    parameter grows evenly with it. reaches: how far before and after each inner corner its curve begins and ends, in
    that unit, above 0, shape (k - 2,). Those of neighbouring corners together are at most as long as the piece between.

    With a and b the directions before and after the corner c, the curve is the Bezier polynomial with the control
    points c - r a, c - r a / 2, c, c + r b / 2, c + r b: its ends join the straight pieces in slope and, without
    curvature there, in the second derivative. It stays in the triangle of the corner and its ends.
    """
    slopes = np.diff(corners, axis=0) / lengths[:, None]
    around = np.array([0.0, *reaches, 0.0])
    widths: list[float] = []
    pieces: list[Array] = []
    for i, slope in enumerate(slopes):
        straight = float(lengths[i] - around[i] - around[i + 1])
        if straight > 1e-9 * lengths[i]:
            middle = corners[i] + slope * (around[i] + 0.5 * straight)
            widths.append(straight)
            pieces.append(np.stack([middle, 0.5 * straight * slope, *np.zeros((3, len(slope)))]))
        if i < len(reaches):
            widths.append(2 * around[i + 1])
            pieces.append(corner_curve(corners[i + 1], slope, slopes[i + 1], around[i + 1]))
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks /= breaks[-1]
    return JointPath(breaks, np.stack(pieces))


def corner_curve(corner: Array, before: Array, after: Array, reach: float) -> Array:
    """Chebyshev coefficients of the curve around a corner, shape (5, n); before, after: slopes, shape (n,)."""
    coefficients = reach * (_ARRIVING[:, None] * before + _LEAVING[:, None] * after)
    coefficients[0] += corner
    return coefficients
