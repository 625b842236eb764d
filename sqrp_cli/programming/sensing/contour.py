"""The image of a solid's vertices, and the contour edges between what faces the camera and what does not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross, inverse, transform
from sqrp_cli.programming.sensing.directions import GRID, TILE, DirectionGrid, Tile, take, tiles_of
from sqrp_cli.programming.sensing.image_triangles import SLACK
from sqrp_cli.programming.solids import Solid


@dataclass(frozen=True, eq=False)
class VertexImage:
    """The vertices of a solid as l sight lines see them.

    lines: index of each sight line in the grid. points: in the optical frames, shape (3, l, V). ahead: whether in front
    of the camera, shape (l, V). cells: image coordinates in cells of the grid, shape (2, l, V).
    """

    lines: NDArray[np.int64]
    points: Array
    ahead: NDArray[np.bool_]
    cells: Array

    @classmethod
    def of(cls, lines: NDArray[np.int64], X_CP: Array, solid: Solid, grid: DirectionGrid) -> VertexImage:
        """The image of a solid whose parent is at X_CP (l, 4, 4) in the optical frames."""
        points = np.ascontiguousarray(np.moveaxis(transform(X_CP, solid.vertices), -1, 0))
        ahead = points[2] > 1e-9
        plane = points[:2] / np.where(ahead, points[2], 1.0)
        low, step = grid.low[lines].T[..., None], grid.step[lines].T[..., None]
        return cls(lines, points, ahead, np.where(ahead, (plane - low) / step, -1.0))

    def near(
        self, corner: NDArray[np.int64], deepest: Array
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Sight line and shape of the pairs of which the bounding rectangle overlaps the grid, and that rectangle.

        corner: vertices of triangles or edges, shape (3 or 2, n). deepest: depth beyond which nothing matters, shape
        (l,). The rectangle is that of the tiles from (u, v) to (u, v), shape (4, pairs); it is everything for shapes
        that reach behind the camera, which have no bounded image.
        """
        nearest, farthest = _extremes(self.points[2], corner)
        close = (nearest < deepest[:, None]) & (farthest > 0)
        ahead = np.logical_and.reduce([self.ahead[:, vertices] for vertices in corner])
        bounds = []
        for cells in self.cells:
            least, most = _extremes(cells, corner)
            most = np.where(ahead, most, GRID)
            close &= (most >= 0) & (least < GRID)
            bounds.append((least, most))
        row, shape = np.nonzero(close)
        edges = np.stack([bounds[axis][end][row, shape] for end in (0, 1) for axis in (0, 1)])
        return row, shape, np.clip(edges, 0, GRID - 1).astype(np.int64) // TILE


def contour_tiles(image: VertexImage, solid: Solid, X_CP: Array, grid: DirectionGrid, deepest: Array) -> Tile:
    """Tiles that a contour edge may cross: one whose triangles face different ways, or that has not just two."""
    surface = Surface.of(solid)
    eye_P = inverse(X_CP)[:, :3, 3]
    facing = eye_P @ surface.normals.T > surface.offsets
    bends = facing[:, surface.faces[0]] != facing[:, surface.faces[1]]
    line, edge = np.nonzero(bends | surface.open)
    # One row per sight line and contour edge from here on.
    ends = surface.ends[:, edge]
    here = VertexImage(
        image.lines[line],
        np.stack([image.points[:, line, end] for end in ends], axis=-1),
        np.stack([image.ahead[line, end] for end in ends], axis=-1),
        np.stack([image.cells[:, line, end] for end in ends], axis=-1),
    )
    row, _, rectangle = here.near(np.array([[0], [1]]), deepest[line])
    shape, tile = tiles_of(here.lines[row], rectangle)
    a, b, c = cross(here.points[:, row, 0].T, here.points[:, row, 1].T)[shape].T
    u, v, half_u, half_v = grid.tile(tile)
    touches = np.abs(a * u + b * v + c) <= SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
    return take(tile, touches)


@dataclass(frozen=True, eq=False)
class Surface:
    """How the triangles of a solid hang together.

    normals, offsets: n . p > o for points p in front of each triangle, shapes (F, 3) and (F,). ends: vertices of each
    edge, shape (2, E). faces: the two triangles at each edge, shape (2, E). open: edges that do not join just two
    triangles of like orientation, shape (E,).
    """

    normals: Array
    offsets: Array
    ends: NDArray[np.int64]
    faces: NDArray[np.int64]
    open: NDArray[np.bool_]

    @staticmethod
    @cache
    def of(solid: Solid) -> Surface:
        """The surface of a solid; vertices in the same place count as one."""
        vertices, triangles = solid.vertices, solid.triangles
        rounded = np.round(vertices, 9)
        order = np.lexsort(rounded.T)
        place = np.empty(len(vertices), dtype=np.int64)
        place[order] = np.cumsum(np.any(np.diff(rounded[order], axis=0, prepend=np.nan) != 0, axis=1))
        start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
        first, second = place[start], place[end]
        key = np.minimum(first, second) * (len(vertices) + 1) + np.maximum(first, second)
        order = np.argsort(key, kind="stable")
        _, begin, count = np.unique(key[order], return_index=True, return_counts=True)
        one, other = order[begin], order[begin + count - 1]
        p = [vertices[triangles[:, k]] for k in range(3)]
        normals = cross(p[1] - p[0], p[2] - p[0])
        return Surface(
            normals,
            np.einsum("fi,fi->f", normals, p[0]),
            np.stack([start[one], end[one]]),
            np.stack([one // 3, other // 3]),
            (count != 2) | (first[one] == first[other]),
        )


def _extremes(values: Array, corner: NDArray[np.int64]) -> tuple[Array, Array]:
    """Least and greatest of a value (l, V) over the corners (k, n) of each shape, shape (l, n) each."""
    found = [values[:, vertices] for vertices in corner]
    return np.minimum.reduce(found), np.maximum.reduce(found)
