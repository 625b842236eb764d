"""What sight compares with a solid: its triangles one by one, how they hang together, and the box around it.

The triangles one by one meet rays and view hulls; where they hang together, silhouettes are made of their edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, cross, norms
from sqrp_cli.programming.sensing.sight_lines import TOUCH
from sqrp_cli.programming.sensing.solids import Solid

_MOST_TRIED = 1_000_000
"""Most products of numbers of vertices and triangles for which it is tried whether a surface is convex."""

_FLAT = 1e-9
"""How far vertices may lie in front of triangles of a convex surface [m]: so far places are rounded."""


@dataclass(frozen=True, eq=False)
class Triangulation:
    """V vertices, F triangles and E edges.

    vertices: shape (V, 3) [m]. triangles: shape (F, 3). planes: of each triangle, n . p + d > 0 for points p in
    front of it, the normal n before d, shape (F, 4), in single precision.
    start, end: vertices of each edge, shape (E,). left, right: the triangle that runs along it in its direction and the
    one that runs against it, shape (E,). An edge that does not join just two triangles of like orientation is there
    once for each of its triangles, with F, no triangle, on its right.
    """

    vertices: Array
    triangles: Indices
    planes: NDArray[np.float32]
    start: Indices
    end: Indices
    left: Indices
    right: Indices

    @cached_property
    def ends(self) -> Indices:
        """The vertices of each edge, shape (2, E)."""
        return np.stack([self.start, self.end])

    @cached_property
    def is_convex(self) -> bool:
        """Whether no vertex lies in front of any triangle; no for surfaces too large to try that."""
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
        return Triangulation(vertices, triangles, planes, start[side], end[side], side // 3, right)


_triangulations: WeakKeyDictionary[Solid, Triangulation] = WeakKeyDictionary()
"""What was made of solids that are still in use."""


@dataclass(frozen=True, eq=False)
class Facets:
    """F triangles of a solid in its parent's frame.

    points: their corners, shape (F, 3, 3) [m]. normals, offsets: n . p = o for the points p of each one's plane, shapes
    (F, 3), not of length 1, and (F,). edges: Plücker coordinates of the line along each of the three edges, moment
    before direction, shape (6, F) each. middles, radii: a sphere around each, shapes (F, 3) and (F,) [m].
    """

    points: Array
    normals: Array
    offsets: Array
    edges: tuple[Array, Array, Array]
    middles: Array
    radii: Array

    @staticmethod
    def of(solid: Solid) -> Facets:
        """The facets of a solid; made once."""
        if solid not in _facets:
            _facets[solid] = Facets._of_points(solid.vertices[solid.triangles])
        return _facets[solid]

    @staticmethod
    def _of_points(points: Array) -> Facets:
        a, b, c = points.swapaxes(0, 1)
        normals, middles = cross(b - a, c - a), points.mean(axis=1)
        reach = points - middles[:, None]
        return Facets(
            points=points,
            normals=normals,
            offsets=np.einsum("fi,fi->f", normals, a),
            edges=(_line(a, b), _line(b, c), _line(c, a)),
            middles=middles,
            radii=np.sqrt(np.einsum("fki,fki->fk", reach, reach).max(axis=1, initial=0.0)),
        )


def _line(start: Array, end: Array) -> Array:
    """Plücker coordinates of lines through points (F, 3), shape (6, F)."""
    return np.ascontiguousarray(np.concatenate([cross(start, end), end - start], axis=1).T)


_facets: WeakKeyDictionary[Solid, Facets] = WeakKeyDictionary()
"""What was made of solids that are still in use."""


def box_distances(solid: Solid, points: Array) -> tuple[Array, Array]:
    """Least and greatest distances of points (n, 3), in the parent's frame, from the box around a solid; (n,) [m]."""
    axes, lengths = _axes(solid)
    along = np.abs((points - solid.center) @ axes.T)
    return norms(np.maximum(along - lengths, 0.0)), norms(along + lengths)


def box_is_met(solid: Solid, points: Array, rays: Array) -> NDArray[np.bool_]:
    """Whether the way from each point (n, 3) to where its ray (n, 3) ends may touch the box around a solid; (n,).

    Both in the parent's frame. The box is met between where the ray enters the last of its three slabs and leaves the
    first (T. L. Kay, J. T. Kajiya, 1986).
    """
    axes, lengths = _axes(solid)
    start, step = (points - solid.center) @ axes.T, rays @ axes.T
    reach = lengths + TOUCH
    step = np.where(step == 0.0, 1e-300, step)
    with np.errstate(over="ignore"):
        one, other = (-reach - start) / step, (reach - start) / step
    enters, leaves = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    met: NDArray[np.bool_] = (enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)
    return met


def _axes(solid: Solid) -> tuple[Array, Array]:
    """Directions of a solid's box, one a row, shape (3, 3), and half its extents along them, (3,) [m]."""
    # The half axes are orthogonal; where the box is flat, one of them is zero and the factorization finds a direction.
    directions, lengths = np.linalg.qr(solid.half_axes.T)
    return directions.T, np.abs(np.diag(lengths))
