"""Connectivity of the triangles of a solid: its silhouettes consist of their edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, cross, norms
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
