"""Outlines of surfaces, as a camera sees them, in the grid of rays that run to a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.programming.sensing.sight_lines import Indices
from sqrp_cli.programming.sensing.visibility.ray_grid import COLUMNS, ROWS, SHIFT, first_row
from sqrp_cli.programming.sensing.visibility.surface import Surface

Scalar = TypeVar("Scalar", bound=np.generic)

AHEAD = 1e-6
"""Depth from which on a point counts as in front of the camera [m]."""

_ROUNDING = 1e-6
"""More than single precision is wrong by in the products of `beyond_sides`, as a share of what is summed."""


@dataclass(frozen=True, eq=False)
class Bends:
    """Edges of a surface at which it turns away from where it is looked at from: n of them, in several views.

    ends: where each begins and ends, in the surface's frame, coordinate first, shape (3, 2, n) [m]. view: in which of
    the views, shape (n,). weight: how often it counts, whole numbers, shape (n,).
    """

    ends: Array
    view: Indices
    weight: NDArray[np.int8]

    @classmethod
    def of(cls, surface: Surface, turned: NDArray[np.int8], sides: NDArray[np.float32], views: Indices) -> Bends:
        """The edges between triangles that face different ways, each triangle taken as if it faced the camera.

        Those that lie wholly beyond one side of the rays are left out: they are most of them, and bound nothing there.

        turned: see `facing`, shape (F + 1, k). sides: see `beyond_sides`, shape (3, 4, k). views: which of all views
        these are, shape (k,).
        """
        left, right = turned.take(surface.left, axis=0), turned.take(surface.right, axis=0)
        first, second, third = (surface.homogeneous @ sides < 0.0).view(np.uint8)
        beyond = first | second << 1 | third << 2
        start, end = beyond.take(surface.start, axis=0), beyond.take(surface.end, axis=0)
        bends = np.flatnonzero((left != right) & ((start & end) == 0))
        edge = bends // len(views)
        ends = surface.coordinates.take(surface.ends.take(edge, axis=1), axis=1)
        return cls(ends, views.take(bends - edge * len(views)), left.take(bends) - right.take(bends))


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

    @classmethod
    def of(cls, bends: Sequence[Bends], maps: Array, layers: Indices) -> Outline:
        """The outlines of several surfaces.

        maps: from the surface's frame into the grid in each view, shape (3, 4, k). layers: in which each view is drawn,
        shape (k,).
        """
        view, weight = np.concatenate([bend.view for bend in bends]), np.concatenate([bend.weight for bend in bends])
        x, y, z = np.concatenate([bend.ends for bend in bends], axis=2)
        # Term by term, so that edges which share an end give it the same row to the last bit.
        (a, b, c, d), (e, f, g, h) = maps[1:].take(view, axis=2)
        depth = e * x + f * y + g * z + h
        row = (a * x + b * y + c * z + d) / depth
        crossing = np.not_equal(*first_row(row)).nonzero()[0]
        x, y, z, depth = (values.take(crossing, axis=1) for values in (x, y, z, depth))
        view = view.take(crossing)
        a, b, c, d = maps[0].take(view, axis=1)
        column = (a * x + b * y + c * z + d) / depth
        return cls(layers.take(view), column, row.take(crossing, axis=1), weight.take(crossing))

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


def beyond_sides(maps: Array, reach: float) -> NDArray[np.float32]:
    """Products with points that are negative only beyond a side of the rays: the left, the first row, the last row.

    They are to be taken of homogeneous points, no coordinate of which is larger than `reach` [m], in single precision,
    which is several times faster. maps: see `RayGrid.maps`, shape (3, 4, n), as the result.
    """
    column, row, depth = maps
    sides = np.stack([column, row, (ROWS - 0.5) * depth - row])
    sides[:, 3] += _ROUNDING * (reach * np.abs(sides[:, :3]).sum(axis=1) + np.abs(sides[:, 3]))
    return sides.astype(np.float32)


def facing(surface: Surface, eyes: NDArray[np.float32]) -> NDArray[np.int8]:
    """1 where an eye is in front of a triangle and -1 where not, shape (F + 1, k); 0 for no triangle.

    eyes: with a one as fourth coordinate, coordinate first, shape (4, k). In single precision: a triangle for which
    that is too coarse is seen edge-on, and hides nothing by itself.
    """
    return signs(surface.planes @ eyes > 0.0)


def signs(in_front: NDArray[np.bool_]) -> NDArray[np.int8]:
    """The same from whether an eye is in front of each triangle, shape (F, k)."""
    found = np.zeros((len(in_front) + 1, in_front.shape[1]), dtype=np.int8)
    found[:-1] = 2 * in_front.view(np.int8) - 1
    return found
