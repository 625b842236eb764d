"""Smooth joint paths along a polyline: straight pieces, and curves that cut its corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.trajectory import Path

_LEAVING = np.array([45 / 128, 1 / 2, 5 / 32, 0.0, -1 / 128])
_ARRIVING = np.array([-45 / 128, 1 / 2, -5 / 32, 0.0, 1 / 128])
"""Chebyshev coefficients of the curve around a corner: what it takes of the directions after and before it."""


def blended_path(corners: Array, lengths: Array, reaches: Sequence[float]) -> Path:
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
    return Path(breaks, np.stack(pieces))


def corner_curve(corner: Array, before: Array, after: Array, reach: float) -> Array:
    """Chebyshev coefficients of the curve around a corner, shape (5, n); before, after: slopes, shape (n,)."""
    coefficients = reach * (_ARRIVING[:, None] * before + _LEAVING[:, None] * after)
    coefficients[0] += corner
    return coefficients
