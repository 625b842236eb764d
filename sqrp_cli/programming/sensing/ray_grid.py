"""The directions in which a camera looks at a box, and which of them lie inside an outline.

Rays (u, v, 1) in the optical frame, turned about its axis so that the box fills the grid, run through the plane z = 1
in `ROWS` rows of `COLUMNS`. How often an outline winds around a ray is the sum of the outline's edges that cross the
ray's row beyond it, each with the sign of its direction: so every edge is looked at once per row that it crosses,
whatever lies inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross
from sqrp_cli.programming.ranges import ranges

ROWS, COLUMNS = 64, 32
"""Rays across the bounding rectangle of a box's image."""

_USUAL_AXIS = 0.5
"""Direction in which the rows of rays follow each other, where an image is about as long as wide [rad].

Edges in a cell are often level or upright in the image; along a row of rays, a whole row would be decided at once.
"""

_LONG = 2.0
"""By how much longer than wide an image must be for the rows to follow each other along it."""

_COUNTS = np.array([[COLUMNS], [ROWS]])

_SHIFT = (np.arange(ROWS) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
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
class Outline:
    """n edges in the grids of sight lines.

    line: sight line of each, shape (n,). start, end: column and row of its ends (see `RayGrid.maps`), shape (2, n)
    each. weight: how often it counts, whole numbers, shape (n,). What is bounded by a closed outline is what it winds
    around; edges that cross no row of rays may be missing, and those that have no ray of the grid before them.
    """

    line: NDArray[np.int64]
    start: Array
    end: Array
    weight: NDArray[np.int8]

    @staticmethod
    def joined(outlines: Sequence[Outline]) -> Outline:
        """Several outlines as one."""
        return Outline(
            np.concatenate([outline.line for outline in outlines]),
            np.concatenate([outline.start for outline in outlines], axis=1),
            np.concatenate([outline.end for outline in outlines], axis=1),
            np.concatenate([outline.weight for outline in outlines]),
        )


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays meet triangles, by index, and the depth [m] of each place; shape (n,) each."""

    triangle: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    depth: Array


@dataclass(frozen=True, eq=False)
class RayGrid:
    """The rays of l sight lines: in row j at v = low[1] + step[1] * (j + 1/2), ray i at u = low[0] + step[0] * (i + s).

    The shift s is that of the row. low: least u and v, shape (2, l). step: size of a cell, shape (2, l).
    """

    low: Array
    step: Array

    @classmethod
    def over(cls, low: Array, high: Array) -> RayGrid:
        """The grid over rectangles of the plane z = 1 from `low` to `high`, shape (2, l) each."""
        return cls(low, (high - low) / _COUNTS)

    def repeated(self, of: NDArray[np.int64]) -> RayGrid:
        """The rays of some sight lines, or of some more than once: those of the given indices, shape (n,)."""
        return RayGrid(self.low[:, of], self.step[:, of])

    def rays(self, line: NDArray[np.int64], row: NDArray[np.int64], column: NDArray[np.int64]) -> tuple[Array, Array]:
        """U and v of rays."""
        (low_u, low_v), (step_u, step_v) = self.low[:, line], self.step[:, line]
        return low_u + step_u * (column + _SHIFT[row]), low_v + step_v * (row + 0.5)

    def maps(self, line: NDArray[np.int64], X_CP: Array) -> Array:
        """From frames P (n) to column (without shift) and row, both times depth, and depth, shape (3, 4, n)."""
        x, y, depth = np.moveaxis(X_CP[:, :3], 0, -1)
        (low_u, low_v), (step_u, step_v) = self.low[:, line], self.step[:, line]
        return np.stack([(x - low_u * depth) / step_u, (y - low_v * depth) / step_v - 0.5 * depth, depth])

    def may_hold(self, line: NDArray[np.int64], corners: Array) -> NDArray[np.bool_]:
        """Whether shapes may reach into the pyramid of the grid's rays, shape (n,); a no is certain.

        corners: shape (3, k, n), coordinate first; they may lie behind the camera.
        """
        low, high = self.low[:, line], self.low[:, line] + self.step[:, line] * _COUNTS
        depth = corners[2]
        may: NDArray[np.bool_] = (depth > 0).any(axis=0)
        for axis in range(2):
            may &= (corners[axis] >= low[axis] * depth).any(axis=0) & (corners[axis] <= high[axis] * depth).any(axis=0)
        return may

    def inside(self, outline: Outline) -> NDArray[np.bool_]:
        """Which rays the outlines of each sight line wind around, shape (COLUMNS, l, ROWS)."""
        (u, v), (to_u, to_v) = outline.start, outline.end
        row, to_row = first_row(v), first_row(to_v)
        slope = (to_u - u) / (to_v - v)
        edge, crossed = ranges(np.minimum(row, to_row), np.maximum(row, to_row))
        beyond = np.ceil(np.clip(u[edge] + (crossed - v[edge]) * slope[edge] - _SHIFT[crossed], 0.0, COLUMNS))
        weight = outline.weight * np.sign(to_row - row)
        place = outline.line * ROWS
        # Each crossing counts for the rays on the one side of it: it is a step where the rays begin.
        rays = self.low.shape[1] * ROWS
        winding = np.zeros((COLUMNS + 1, rays), dtype=np.int16)
        at = beyond.astype(np.int64) * rays + place[edge] + crossed
        np.add.at(winding.reshape(-1), at, weight[edge].astype(np.int16))
        for column in range(COLUMNS - 1, 0, -1):
            winding[column] += winding[column + 1]
        inside: NDArray[np.bool_] = (winding[1:] != 0).reshape(COLUMNS, -1, ROWS)
        return inside

    def hits(self, line: NDArray[np.int64], corners: Array) -> Hits:
        """Every ray that meets one of n triangles.

        By homogeneous edge functions a u + b v + c, all positive inside (Olano and Greer 1997); along a row each of
        them bounds u on one side. corners: shape (3, 3, n), coordinate first; they may lie behind the camera.
        """
        edges = np.stack([cross(corners[:, k].T, corners[:, (k + 1) % 3].T).T for k in range(3)])
        volume = np.einsum("in,in->n", corners[:, 2], edges[0])
        edges, volume = edges * np.where(volume < 0, -1.0, 1.0), np.abs(volume)
        ahead = (corners[2] > 0).all(axis=0)
        low, step = self.low[1, line], self.step[1, line]
        v = (corners[1] / np.where(ahead, corners[2], 1.0) - low) / step - 0.5
        first, last = first_row(v.min(axis=0)), first_row(v.max(axis=0))
        triangle, row = ranges(np.where(ahead, first, 0), np.where(ahead, last, ROWS))
        low, high = np.full(len(row), -np.inf), np.full(len(row), np.inf)
        _, v = self.rays(line[triangle], row, row)
        for a, b, c in edges[:, :, triangle]:
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = -(b * v + c) / a
            low, high = np.where(a > 0, np.fmax(low, bound), low), np.where(a < 0, np.fmin(high, bound), high)
            high[(a == 0) & (b * v + c < 0)] = -np.inf
        (start, _), (step, _) = self.low[:, line[triangle]], self.step[:, line[triangle]]
        low, high = ((bound - start) / step - _SHIFT[row] for bound in (low, high))
        within, column = ranges(np.ceil(np.clip(low, 0.0, COLUMNS)), np.ceil(np.clip(high, 0.0, COLUMNS)))
        triangle, row = triangle[within], row[within]
        u, v = self.rays(line[triangle], row, column)
        a, b, c = edges.sum(axis=0)[:, triangle]
        total = a * u + b * v + c
        hit = (total > 0) & (volume[triangle] > 0)
        return Hits(triangle[hit], row[hit], column[hit], volume[triangle[hit]] / total[hit])


def first_row(v: Array) -> NDArray[np.int64]:
    """The first row of rays at or beyond v, counted in rows.

    An edge crosses the rows from that of its one end, included, to that of the other, not included.
    """
    rows: NDArray[np.int64] = np.ceil(np.clip(v, 0.0, ROWS)).astype(np.int64)
    return rows
