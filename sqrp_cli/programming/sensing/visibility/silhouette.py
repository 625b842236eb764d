"""Silhouettes of solids in the grid of rays that run from a camera to a box: edges of the triangles of each solid.

Rays (u, v, 1) in the optical frame, turned about its axis so that the box fills the grid, run through the plane z = 1
in `ROWS` rows of `COLUMNS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask, cross, norms, ranges
from sqrp_cli.programming.solids import Solid

_MOST_TRIED = 1_000_000
"""Largest product of the numbers of vertices and triangles for a test of convexity."""

_FLAT = 1e-9
"""Largest distance of a vertex in front of a triangle of a convex surface [m], from rounding."""


@dataclass(frozen=True, eq=False)
class Triangulation:
    """V vertices, F triangles and E edges.

    An edge that does not join exactly two triangles of equal orientation is stored once for each of its triangles, with
    F, no triangle, on its right.
    """

    vertices: Array
    """Shape (V, 3) [m]."""
    triangles: Indices
    """Vertices of each triangle, shape (F, 3)."""
    planes: NDArray[np.float32]
    """(n, d) of each triangle: n . p + d > 0 for the points p in front of it, shape (F, 4), in single precision."""
    start: Indices
    """Vertex at which each edge begins, shape (E,)."""
    end: Indices
    """Vertex at which it ends, shape (E,)."""
    left: Indices
    """The triangle that runs along it in its direction, shape (E,)."""
    right: Indices
    """The triangle that runs against it, shape (E,)."""

    @cached_property
    def ends(self) -> Indices:
        """The vertices of each edge, shape (2, E)."""
        return np.stack([self.start, self.end])

    @cached_property
    def is_convex(self) -> bool:
        """Whether no vertex lies in front of any triangle; False for surfaces too large for the test."""
        if len(self.vertices) * len(self.triangles) > _MOST_TRIED or np.any(self.right == len(self.triangles)):
            return False
        a, b, c = self.vertices[self.triangles].swapaxes(0, 1)
        normals = cross(b - a, c - a)
        beyond = normals @ self.vertices.T - np.einsum("fi,fi->f", normals, a)[:, None]
        return bool((beyond <= _FLAT * norms(normals)[:, None]).all())

    @cached_property
    def coordinates(self) -> Array:
        """The vertices, coordinate first, shape (3, V) [m]."""
        return np.ascontiguousarray(self.vertices.T)

    @cached_property
    def homogeneous(self) -> NDArray[np.float32]:
        """The vertices with a one as fourth coordinate, shape (V, 4)."""
        return np.column_stack([self.vertices, np.ones(len(self.vertices))]).astype(np.float32)

    @staticmethod
    def of(solid: Solid) -> Triangulation:
        """The surface of a solid, in its parent's frame; made once."""
        if solid not in _triangulations:
            _triangulations[solid] = Triangulation.of_triangles(solid.vertices, solid.triangles)
        return _triangulations[solid]

    @staticmethod
    def of_triangles(vertices: Array, triangles: Indices) -> Triangulation:
        """The surface of triangles (F, 3) over vertices (V, 3); vertices in the same place become one."""
        _, first, place = np.unique(np.round(vertices, 9), axis=0, return_index=True, return_inverse=True)
        vertices, triangles = vertices[first], place.reshape(-1)[triangles]
        p = [vertices[triangles[:, k]] for k in range(3)]
        normals = cross(p[1] - p[0], p[2] - p[0])
        planes = np.column_stack([normals, -np.einsum("fi,fi->f", normals, p[0])]).astype(np.float32)

        start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
        key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        _, begin, count = np.unique(key[order], return_index=True, return_counts=True)
        one, other = order[begin], order[begin + count - 1]
        joins = (count == 2) & (start[one] != start[other])
        alone = np.ones(len(order), dtype=bool)
        alone[one[joins]] = alone[other[joins]] = False
        side = np.concatenate([one[joins], np.flatnonzero(alone)])
        right = np.concatenate([other[joins] // 3, np.full(int(alone.sum()), len(triangles))])
        return Triangulation(
            vertices=vertices,
            triangles=triangles,
            planes=planes,
            start=start[side],
            end=end[side],
            left=side // 3,
            right=right,
        )


_triangulations: WeakKeyDictionary[Solid, Triangulation] = WeakKeyDictionary()
"""Cached results for solids still in use."""


AHEAD = 1e-6
"""Depth from which on a point counts as in front of the camera [m]."""

ROWS, COLUMNS = 64, 32
"""Rays across the bounding rectangle of a box's image."""

_USUAL_AXIS = 0.5
"""Direction in which the rows of rays follow each other, where an image is about as long as wide [rad].

Edges in a cell are often level or upright in the image; along a row of rays, a whole row would be decided at once.
"""

_LONG = 2.0
"""Least ratio of length to width of an image for rows across its length."""

_ROWS_AT_ONCE = 4096
"""Rows of rays, each of one shape, to compare with its functions at once: the data should fit the cache."""

_COUNTS = np.array([[COLUMNS], [ROWS]])

_ROUNDING = 1e-6
"""Bound of the single-precision error in the products of `beyond_sides`, as a share of the summed terms."""

Scalar = TypeVar("Scalar", bound=np.generic)

SHIFT = (np.arange(ROWS) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
"""Shift of each row as a share of a column, so that the rays form no columns."""


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


class MetRays(NamedTuple):
    """Rays of grids that meet shapes, n in all."""

    column: Indices
    """Of the ray in its grid, shape (n,)."""
    shape: Indices
    """Index of the shape that it meets, shape (n,)."""
    row: Indices
    """Of the ray in its grid, shape (n,)."""


@dataclass(frozen=True, eq=False)
class RayGrid:
    """The rays to the boxes of h view hulls.

    Row j is at v = low[1] + step[1] * (j + 1/2), and its ray i at u = low[0] + step[0] * (i + s), with the shift s of
    the row.
    """

    low: Array
    """Least u and v, shape (2, h)."""
    step: Array
    """Size of a cell along u and v, shape (2, h)."""

    @classmethod
    def over(cls, low: Array, high: Array) -> RayGrid:
        """The grid over rectangles of the plane z = 1 from `low` to `high`, shape (2, h) each."""
        return cls(low, (high - low) / _COUNTS)

    def maps(self, hull: Indices, X_CP: Array) -> Array:
        """From frames P (n) to column (without shift) and row, both times depth, and depth, shape (3, 4, n)."""
        x, y, depth = X_CP[:, :3].transpose(1, 2, 0)
        (low_u, low_v), (step_u, step_v) = self.low[:, hull], self.step[:, hull]
        return np.stack([(x - low_u * depth) / step_u, (y - low_v * depth) / step_v - 0.5 * depth, depth])

    def most_rays(self, maps: Array, corners_P: Array) -> Array:
        """How many rays may meet n shapes within corners (n, k, 3) at most, shape (n,); maps: see `maps`, (3, 4, n)."""
        into = np.moveaxis(maps, 2, 0)
        column, row, depth = np.moveaxis(corners_P @ into[:, :, :3].swapaxes(1, 2) + into[:, None, :, 3], 2, 0)
        ahead = (depth > AHEAD).all(axis=1)
        depth = np.where(ahead[:, None], depth, 1.0)
        column, row = column / depth, row / depth
        # The rays of a row stand up to one column to the right of their numbers.
        columns = np.clip(np.floor(column.max(axis=1)) + 1, 0, COLUMNS) - np.clip(
            np.ceil(column.min(axis=1)) - 1, 0, COLUMNS
        )
        rows = np.clip(np.floor(row.max(axis=1)) + 1, 0, ROWS) - np.clip(np.ceil(row.min(axis=1)), 0, ROWS)
        return np.where(ahead, columns * rows, COLUMNS * ROWS)

    def beside(self, hull: Indices, points_C: Array) -> list[Mask]:
        """Whether points (k, n, 3) seen in k of the views lie beyond each side of the pyramid of rays, (k, n) each."""
        low, high = self.low[:, hull, None], self.low[:, hull, None] + self.step[:, hull, None] * _COUNTS[:, None]
        depth = points_C[..., 2]
        return [points_C[..., axis] < low[axis] * depth for axis in range(2)] + [
            points_C[..., axis] > high[axis] * depth for axis in range(2)
        ]

    def inside(self, hull: Indices, v: Array, functions: Array) -> MetRays:
        """The rays at which all functions of a shape are positive.

        hull: to whose box the rays of each of n shapes run, shape (n,). v: least and greatest of each, shape (2, n).
        functions: a, b and c of a u + b v + c, shape (f, 3, n). Along a row each of them bounds u on one side.
        """
        shape, row = ranges(*first_row((v - self.low[1, hull]) / self.step[1, hull] - 0.5))
        (left, top), (across, down) = self.low[:, hull[shape]], self.step[:, hull[shape]]
        at = top + down * (row + 0.5)
        low, high = np.empty(len(row)), np.empty(len(row))
        for start in range(0, len(row), _ROWS_AT_ONCE):
            some = slice(start, start + _ROWS_AT_ONCE)
            a, b, c = functions.take(shape[some], axis=2).swapaxes(0, 1)
            rest = b * at[some] + c
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = -rest / a
            low[some] = np.where(a > 0, bound, -np.inf).max(axis=0)
            high[some] = np.where(a < 0, bound, np.inf).min(axis=0)
            high[some][((a == 0) & (rest < 0)).any(axis=0)] = -np.inf
        low, high = ((bound - left) / across - SHIFT[row] for bound in (low, high))
        within, column = ranges(np.ceil(np.clip(low, 0.0, COLUMNS)), np.ceil(np.clip(high, 0.0, COLUMNS)))
        return MetRays(column=column, shape=shape[within], row=row[within])


def first_row(v: Array) -> Indices:
    """The first row of rays at or beyond v, counted in rows.

    An edge crosses the rows from that of its one end, included, to that of the other, not included.
    """
    return np.ceil(np.minimum(np.maximum(v, 0.0), ROWS)).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Bends:
    """Edges of a surface between its front and its back: n of them, in several views."""

    ends: Array
    """Start and end of each, in the surface's frame, coordinate first, shape (3, 2, n) [m]."""
    view: Indices
    """Index of its view, shape (n,)."""
    weight: NDArray[np.int8]
    """Its multiplicity, an integer, shape (n,)."""

    @classmethod
    def of(cls, surface: Triangulation, turned: NDArray[np.int8], sides: NDArray[np.float32], views: Indices) -> Bends:
        """The edges between triangles that face different ways, each triangle taken as if it faced the camera.

        Edges wholly beyond one side of the rays are left out: they are the majority, and bound nothing there.

        turned: see `facing`, shape (F + 1, k). sides: see `beyond_sides`, shape (3, 4, k). views: indices of these
        views, shape (k,).
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
class Silhouette:
    """n edges in layers of rays, each layer with its own grid.

    A closed silhouette contains the rays that it winds around. Edges that cross no row of rays, or have no ray of the
    grid before them, may be missing.
    """

    layer: Indices
    """Of each edge, shape (n,)."""
    column: Array
    """Of each edge's start and end (see `RayGrid.maps`), shape (2, n)."""
    row: Array
    """Of each edge's start and end, shape (2, n)."""
    weight: NDArray[np.int8]
    """Multiplicity of each edge, an integer, shape (n,)."""

    @classmethod
    def of(cls, bends: Sequence[Bends], maps: Array, layers: Indices) -> Silhouette:
        """The silhouettes of several surfaces.

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
        row, weight = row.take(crossing, axis=1), weight.take(crossing)
        return cls(layer=layers.take(view), column=column, row=row, weight=weight)

    def inside(self, layers: int) -> Mask:
        """The rays that the silhouettes of each layer wind around, shape (COLUMNS, layers, ROWS).

        The winding number of a ray is the sum of the edges that cross its row beyond it, each with the sign of its
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
        # Each crossing counts for the rays on one side of it: it is a step at the first of them.
        rays = layers * ROWS
        winding = np.zeros((COLUMNS + 1, rays), dtype=np.int16)
        at = beyond.astype(np.int64) * rays + each(self.layer * ROWS) + row
        np.add.at(winding.reshape(-1), at, each(weight))
        for column in range(COLUMNS - 1, 0, -1):
            winding[column] += winding[column + 1]
        inside: Mask = (winding[1:] != 0).reshape(COLUMNS, -1, ROWS)
        return inside


def beyond_sides(maps: Array, reach: float) -> NDArray[np.float32]:
    """Products with points that are negative only beyond a side of the rays: the left, the first row, the last row.

    The points are homogeneous, with no coordinate larger than `reach` [m], in single precision, which is several times
    faster. maps: see `RayGrid.maps`, shape (3, 4, n), as the result.
    """
    column, row, depth = maps
    sides = np.stack([column, row, (ROWS - 0.5) * depth - row])
    sides[:, 3] += _ROUNDING * (reach * np.abs(sides[:, :3]).sum(axis=1) + np.abs(sides[:, 3]))
    return sides.astype(np.float32)


def facing(surface: Triangulation, eyes: NDArray[np.float32]) -> NDArray[np.int8]:
    """1 where an eye is in front of a triangle and -1 where not, shape (F + 1, k); 0 for no triangle.

    eyes: with a one as fourth coordinate, coordinate first, shape (4, k). In single precision: a triangle for which
    that is too coarse is seen edge-on, and hides nothing by itself.
    """
    return signs(surface.planes @ eyes > 0.0)


def signs(in_front: Mask) -> NDArray[np.int8]:
    """The same from whether an eye is in front of each triangle, shape (F, k)."""
    found = np.zeros((len(in_front) + 1, in_front.shape[1]), dtype=np.int8)
    found[:-1] = 2 * in_front.view(np.int8) - 1
    return found
