"""Outlines of surfaces, as a camera sees them, in the grid of rays that run to a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.programming.ranges import ranges
from sqrp_cli.programming.sensing.ray_grid import COLUMNS, ROWS, SHIFT, first_row
from sqrp_cli.programming.sensing.sight_lines import Indices
from sqrp_cli.programming.sensing.surface import Surface

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
        bends = np.flatnonzero(left != right)
        edge = bends // len(layer)
        view = bends - edge * len(layer)
        # Vertex by vertex, so that edges which share an end give it the same row to the last bit.
        column, row, depth = (surface.homogeneous @ maps).reshape(3, -1)
        depth = np.maximum(depth, AHEAD)  # what lies behind the camera belongs to no triangle that counts
        ends = surface.ends.take(edge, axis=1) * len(layer) + view
        row = row.take(ends) / depth.take(ends)
        first, last = first_row(row)
        # Most edges are dropped before anything else is worked out for them.
        crossing = np.flatnonzero(first != last)
        ends = ends.take(crossing, axis=1)
        column = column.take(ends) / depth.take(ends)
        before = np.flatnonzero((column[0] > 0.0) | (column[1] > 0.0))
        crossing = crossing.take(before)
        bends, view = bends.take(crossing), view.take(crossing)
        weight = left.take(bends) - right.take(bends)
        return cls(layer.take(view), column.take(before, axis=1), row.take(crossing, axis=1), weight)

    def inside(self, layers: int) -> NDArray[np.bool_]:
        """Which rays the outlines of each layer wind around, shape (COLUMNS, layers, ROWS).

        How often that is is the sum of the edges that cross the ray's row beyond it, each with the sign of its
        direction.
        """
        whole_row = first_row(self.row)
        slope = (self.column[1] - self.column[0]) / (self.row[1] - self.row[0])
        edge, crossed = ranges(np.minimum(*whole_row), np.maximum(*whole_row))
        start = self.column[0] - self.row[0] * slope
        beyond = start[edge] + crossed * slope[edge] - SHIFT[crossed]
        beyond = np.ceil(np.minimum(np.maximum(beyond, 0.0), COLUMNS))
        weight = self.weight * np.sign(whole_row[1] - whole_row[0])
        # Each crossing counts for the rays on the one side of it: it is a step where the rays begin.
        rays = layers * ROWS
        winding = np.zeros((COLUMNS + 1, rays), dtype=np.int16)
        at = beyond.astype(np.int64) * rays + (self.layer * ROWS)[edge] + crossed
        np.add.at(winding.reshape(-1), at, weight[edge].astype(np.int16))
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
