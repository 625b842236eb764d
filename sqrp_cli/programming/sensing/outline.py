"""Outlines of surfaces, as a camera sees them, in the grid of rays that run to a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.programming.sensing.ray_grid import COLUMNS, ROWS, SHIFT, first_row
from sqrp_cli.programming.sensing.sight_lines import Indices
from sqrp_cli.programming.sensing.surface import Surface

Scalar = TypeVar("Scalar", bound=np.generic)

_ABOVE, _BELOW = np.uint8(2), np.uint8(4)
"""Marks of points beyond the first row of rays, or beyond the last one; 1 of those before the first column."""

AHEAD = 1e-6
"""Depth from which on a point counts as in front of the camera [m]."""


@dataclass(frozen=True, eq=False)
class Outline:
    """n edges in layers of rays, each layer a grid of its own.

    layer: of each edge, shape (n,). column, row: of its start and of its end (see `RayGrid.maps`), shape (2, n) each.
    weight: how often it counts, whole numbers, shape (n,). What is bounded by a closed outline is what it winds
    around; edges that cross no row of rays may be missing, and those that have no ray of the grid before them.
    """

    layer: Indices
    column: Array
    row: Array
    weight: NDArray[np.int8]

    @staticmethod
    def joined(outlines: Sequence[Outline]) -> Outline:
        """Several outlines as one."""
        return Outline(
            np.concatenate([outline.layer for outline in outlines]),
            np.concatenate([outline.column for outline in outlines], axis=1),
            np.concatenate([outline.row for outline in outlines], axis=1),
            np.concatenate([outline.weight for outline in outlines]),
        )

    @classmethod
    def of(cls, layer: Indices, maps: Array, surface: Surface, facing: NDArray[np.int8]) -> Outline:
        """The edges between triangles that face different ways, each triangle taken as if it faced the camera.

        layer: in which each of k views of the surface is drawn, shape (k,). maps: from the surface's frame into the
        grids, shape (3, 4, k). facing: see `facing`.
        """
        left, right = facing.take(surface.left, axis=0), facing.take(surface.right, axis=0)
        # Vertex by vertex, so that edges which share an end give it the same row to the last bit.
        column, row, depth = surface.homogeneous @ maps
        # Most edges lie wholly beyond one side of the grid, and are dropped before anything is worked out for them.
        beyond = (column <= 0.0) | ((row <= 0.0) * _ABOVE) | ((row > (ROWS - 0.5) * depth) * _BELOW)
        start, end = beyond.take(surface.start, axis=0), beyond.take(surface.end, axis=0)
        bends = np.flatnonzero((left != right) & ((start & end) == 0))
        edge = bends // len(layer)
        view = bends - edge * len(layer)
        ends = surface.ends.take(edge, axis=1) * len(layer) + view
        depth = depth.take(ends)
        row = row.take(ends) / depth
        crossing = np.not_equal(*first_row(row)).nonzero()[0]
        bends, view = bends.take(crossing), view.take(crossing)
        column = column.take(ends.take(crossing, axis=1)) / depth.take(crossing, axis=1)
        return cls(layer.take(view), column, row.take(crossing, axis=1), left.take(bends) - right.take(bends))

    def inside(self, layers: int) -> NDArray[np.bool_]:
        """Which rays the outlines of each layer wind around, shape (COLUMNS, layers, ROWS).

        How often that is is the sum of the edges that cross the ray's row beyond it, each with the sign of its
        direction.
        """
        whole_row = first_row(self.row)
        crossings = np.abs(whole_row[1] - whole_row[0])

        def each(values: NDArray[Scalar]) -> NDArray[Scalar]:
            """The values of every crossing's edge."""
            return np.repeat(values, crossings)

        row = np.arange(crossings.sum()) + each(whole_row.min(axis=0) - np.cumsum(crossings) + crossings)
        slope = (self.column[1] - self.column[0]) / (self.row[1] - self.row[0])
        beyond = each(self.column[0] - self.row[0] * slope) + row * each(slope) - SHIFT.take(row)
        beyond = np.ceil(np.minimum(np.maximum(beyond, 0.0), COLUMNS))
        weight = (self.weight * np.sign(whole_row[1] - whole_row[0])).astype(np.int16)
        # Each crossing counts for the rays on the one side of it: it is a step where the rays begin.
        rays = layers * ROWS
        winding = np.zeros((COLUMNS + 1, rays), dtype=np.int16)
        at = beyond.astype(np.int64) * rays + each(self.layer * ROWS) + row
        np.add.at(winding.reshape(-1), at, each(weight))
        for column in range(COLUMNS - 1, 0, -1):
            winding[column] += winding[column + 1]
        inside: NDArray[np.bool_] = (winding[1:] != 0).reshape(COLUMNS, -1, ROWS)
        return inside


def facing(surface: Surface, eye: Array) -> NDArray[np.int8]:
    """1 where an eye (k, 3) is in front of a triangle and -1 where not, shape (F + 1, k); 0 for no triangle."""
    return signs(surface.normals @ eye.T > surface.offsets[:, None])


def signs(in_front: NDArray[np.bool_]) -> NDArray[np.int8]:
    """The same from whether an eye is in front of each triangle, shape (F, k)."""
    found = np.zeros((len(in_front) + 1, in_front.shape[1]), dtype=np.int8)
    found[:-1] = 2 * in_front.view(np.int8) - 1
    return found
