"""The directions in which a camera looks at a box, and which of them meet single triangles.

Rays (u, v, 1) in the optical frame, turned about its axis so that the box fills the grid, run through the plane z = 1
in `ROWS` rows of `COLUMNS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.programming.ranges import ranges
from sqrp_cli.programming.sensing.sight_lines import Indices

ROWS, COLUMNS = 64, 32
"""Rays across the bounding rectangle of a box's image."""

_USUAL_AXIS = 0.5
"""Direction in which the rows of rays follow each other, where an image is about as long as wide [rad].

Edges in a cell are often level or upright in the image; along a row of rays, a whole row would be decided at once.
"""

_LONG = 2.0
"""By how much longer than wide an image must be for the rows to follow each other along it."""

_COUNTS = np.array([[COLUMNS], [ROWS]])

SHIFT = (np.arange(ROWS) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
"""By which part of a column each row is shifted, so that the rays form no columns either."""


def turns(image: Array) -> Array:
    """Poses of the optical frames in those whose axes the grids follow, shape (l, 4, 4).

    image: u and v of the corners of each box, shape (2, l, k). A long image lies along the v axis.
    """
    u, v = image - image.mean(axis=-1, keepdims=True)
    along, across, mixed = (u * u).sum(axis=-1), (v * v).sum(axis=-1), (u * v).sum(axis=-1)
    spread = np.hypot(along - across, 2 * mixed)
    long = (along + across + spread) > _LONG**2 * (along + across - spread)
    angle = np.where(long, 0.5 * np.arctan2(2 * mixed, along - across), _USUAL_AXIS)
    turned = np.zeros((len(angle), 4, 4))
    turned[:, 0, 0] = turned[:, 1, 1] = np.sin(angle)
    turned[:, 1, 0] = np.cos(angle)
    turned[:, 0, 1] = -turned[:, 1, 0]
    turned[:, 2, 2] = turned[:, 3, 3] = 1.0
    return turned


@dataclass(frozen=True, eq=False)
class RayGrid:
    """The rays to the boxes of h view hulls.

    Row j is at v = low[1] + step[1] * (j + 1/2), and its ray i at u = low[0] + step[0] * (i + s), with the shift s of
    the row. low: least u and v, shape (2, h). step: size of a cell, shape (2, h).
    """

    low: Array
    step: Array

    @classmethod
    def over(cls, low: Array, high: Array) -> RayGrid:
        """The grid over rectangles of the plane z = 1 from `low` to `high`, shape (2, h) each."""
        return cls(low, (high - low) / _COUNTS)

    def maps(self, hull: Indices, X_CP: Array) -> Array:
        """From frames P (n) to column (without shift) and row, both times depth, and depth, shape (3, 4, n)."""
        x, y, depth = X_CP[:, :3].transpose(1, 2, 0)
        (low_u, low_v), (step_u, step_v) = self.low[:, hull], self.step[:, hull]
        return np.stack([(x - low_u * depth) / step_u, (y - low_v * depth) / step_v - 0.5 * depth, depth])

    def may_hold(self, hull: Indices, corners: Array) -> NDArray[np.bool_]:
        """Whether shapes may reach into the pyramid of the grid's rays, shape (n,); a no is certain.

        corners: shape (3, k, n), coordinate first; they may lie behind the camera.
        """
        low, high = self.low[:, hull], self.low[:, hull] + self.step[:, hull] * _COUNTS
        depth = corners[2]
        may: NDArray[np.bool_] = (depth > 0).any(axis=0)
        for axis in range(2):
            may &= (corners[axis] >= low[axis] * depth).any(axis=0) & (corners[axis] <= high[axis] * depth).any(axis=0)
        return may

    def inside(self, hull: Indices, v: Array, functions: Array) -> tuple[Indices, Indices, Indices]:
        """The rays at which all functions of a shape are positive: column, index of the shape and row of each.

        hull: to whose box the rays of each of n shapes run, shape (n,). v: least and greatest of each, shape (2, n).
        functions: a, b and c of a u + b v + c, shape (f, 3, n). Along a row each of them bounds u on one side.
        """
        shape, row = ranges(*first_row((v - self.low[1, hull]) / self.step[1, hull] - 0.5))
        (left, top), (across, down) = self.low[:, hull[shape]], self.step[:, hull[shape]]
        at = top + down * (row + 0.5)
        low, high = np.full(len(row), -np.inf), np.full(len(row), np.inf)
        for function in functions:
            a, b, c = function.take(shape, axis=1)
            rest = b * at + c
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = -rest / a
            low, high = np.where(a > 0, np.fmax(low, bound), low), np.where(a < 0, np.fmin(high, bound), high)
            high[(a == 0) & (rest < 0)] = -np.inf
        low, high = ((bound - left) / across - SHIFT[row] for bound in (low, high))
        within, column = ranges(np.ceil(np.clip(low, 0.0, COLUMNS)), np.ceil(np.clip(high, 0.0, COLUMNS)))
        return column, shape[within], row[within]


def first_row(v: Array) -> Indices:
    """The first row of rays at or beyond v, counted in rows.

    An edge crosses the rows from that of its one end, included, to that of the other, not included.
    """
    rows: Indices = np.ceil(np.minimum(np.maximum(v, 0.0), ROWS)).astype(np.int64)
    return rows
