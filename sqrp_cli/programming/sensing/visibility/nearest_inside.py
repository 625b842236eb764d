"""How near to the camera the parts of solids inside view hulls are, as far as it tells which solid is the nearest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask, cross, inverse, norms
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.solids import Solid
from sqrp_cli.programming.sensing.visibility.triangulation import Facets, box_distances
from sqrp_cli.shapes import BOX_TRIANGLES

_CORNERS = 10_000_000
"""Corners of triangles that are held against half spaces at once, at most, to bound the memory."""

_FIRST = 4
"""Triangles of each line that are looked at first, to know how near the others must be to matter."""


def nearest_inside(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Least distance from the eye to the part of each pair's solid inside the view hull, shape (pairs,).

    Distances may be too large where that does not matter: which pair of each line has the least is exact. The solids of
    the pairs do reach into the hulls.
    """
    line, solids = pairs
    hulls = _HullSpaces.of(lines, poses, pairs)
    # What reaches into a hull is at least as near as the farthest corner of its box: boxes alone decide many lines.
    bounds, nearest = np.empty(len(line)), np.empty(len(line))
    for solid, rows in _by_solid(poses, solids, np.arange(len(line))):
        bounds[rows], nearest[rows] = box_distances(solid, hulls.eyes[rows])
    # What stands in front of the others comes first, as then few of the others may be nearer; so with its triangles.
    in_front = _least_of_each(line, bounds, 1)
    found = [_Pieces.none()]
    for chosen in (in_front, ~in_front):
        rows = np.flatnonzero(chosen & _undecided(np.arange(len(line)), bounds, line, nearest))
        for solid, some in _by_solid(poses, solids, rows, hulls.normals.shape[1]):
            outside = hulls.outside(some, solid.vertices)
            vertex, at = np.nonzero(outside == 0)
            np.minimum.at(nearest, some[at], norms(solid.vertices[vertex] - hulls.eyes[some[at]]))
            found.append(_Pieces.of(hulls, some, Facets.of(solid), *(outside[corner] for corner in solid.triangles.T)))
    pieces = _Pieces.joined(found)
    for count in (_FIRST, len(pieces.row)):
        pieces = pieces.some(_undecided(pieces.row, pieces.bounds, line, nearest))
        first = _least_of_each(line[pieces.row], pieces.bounds, count)
        asked = pieces.some(first)
        np.minimum.at(nearest, asked.row, asked.distances(hulls, _of_lines(line, nearest)[asked.row]))
        pieces = pieces.some(~first)
    return nearest


@dataclass(frozen=True, eq=False)
class _HullSpaces:
    """The view hull of each of n pairs, with the axes of the solid's parent.

    normals, offsets: the points p with n . p <= o for all k half spaces, the eye as origin, shapes (n, k, 3) and
    (n, k). eyes: in the parent's frame, shape (n, 3).
    """

    normals: Array
    offsets: Array
    eyes: Array

    @staticmethod
    def of(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> _HullSpaces:
        hull_of = lines.hull[pairs[0]]
        hulls, hull = np.unique(hull_of, return_inverse=True)
        spaces = hull_half_spaces(lines.corners[hulls] - lines.eyes[hulls, None])[hull]
        X_PW = inverse(poses.at(pairs[1], lines.state[pairs[0]]))
        eyes: Array = (X_PW[:, :3, :3] @ lines.eyes[hull_of, :, None])[..., 0] + X_PW[:, :3, 3]
        return _HullSpaces(spaces[..., :3] @ X_PW[:, :3, :3].swapaxes(1, 2), spaces[..., 3], eyes)

    def outside(self, rows: Indices, vertices: Array) -> NDArray[np.unsignedinteger]:
        """Which half spaces of some hulls (n,) each vertex (V, 3) lies outside of, one bit each, shape (V, n)."""
        normals = self.normals[rows]
        reach = self.offsets[rows] + (normals @ self.eyes[rows, :, None])[..., 0]
        outside = (vertices @ normals.reshape(-1, 3).T > reach.reshape(-1)).reshape(len(vertices), *reach.shape)
        packed = np.packbits(outside, axis=2)
        size = next(size for size in (1, 2, 4, 8) if size >= packed.shape[2])  # a hull has at most 6 + 28 half spaces
        bits = np.zeros((*packed.shape[:2], size), dtype=np.uint8)
        bits[..., : packed.shape[2]] = packed
        return bits.view(f"u{size}")[..., 0]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Triangles that may reach into view hulls, seen from the eye, with the axes of their solid's parent.

    row: which pair, shape (n,). facet: which of the triangles, shape (n,). bounds: their distances are not below these,
    shape (n,). inside: whether all of the triangle is inside the hull. points, normals: corners and a normal of each
    triangle there is, in the parent's frame, shapes (F, 3, 3) and (F, 3).
    """

    row: Indices
    facet: Indices
    bounds: Array
    inside: Mask
    points: Array
    normals: Array

    @staticmethod
    def of(hulls: _HullSpaces, rows: Indices, facets: Facets, *outside: NDArray[np.unsignedinteger]) -> _Pieces:
        """Those of a solid's facets that may reach into some of the hulls, of index (n,).

        outside: the half spaces that the three corners of each facet lie outside of, shape (F, n) each.
        """
        a, b, c = outside
        facet, at = np.nonzero((a & b & c) == 0)
        row = rows[at]
        bounds = norms(facets.middles[facet] - hulls.eyes[row]) - facets.radii[facet]
        inside = (a[facet, at] | b[facet, at] | c[facet, at]) == 0
        return _Pieces(row, facet, bounds, inside, facets.points, facets.normals)

    @staticmethod
    def none() -> _Pieces:
        """No pieces."""
        nothing, indices = np.empty(0), np.empty(0, dtype=np.int64)
        return _Pieces(indices, indices, nothing, nothing > 0, np.empty((0, 3, 3)), np.empty((0, 3)))

    @staticmethod
    def joined(parts: Sequence[_Pieces]) -> _Pieces:
        """All pieces of several solids."""
        ends = np.cumsum([len(part.points) for part in parts])
        facet = [part.facet + end - len(part.points) for part, end in zip(parts, ends, strict=True)]
        row, bounds, inside, points, normals = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("row", "bounds", "inside", "points", "normals")
        )
        return _Pieces(row, np.concatenate(facet), bounds, inside, points, normals)

    def some(self, wanted: Mask) -> _Pieces:
        """Those that are wanted."""
        kept = np.flatnonzero(wanted)
        return replace(
            self, row=self.row[kept], facet=self.facet[kept], bounds=self.bounds[kept], inside=self.inside[kept]
        )

    def distances(self, hulls: _HullSpaces, least: Array) -> Array:
        """Distance of the part inside the hull from the eye, shape (n,); infinite where none is nearer than `least`."""
        triangles = self.points[self.facet] - hulls.eyes[self.row, None]
        normals = self.normals[self.facet]
        distances = distances_to_origin(triangles, np.full(len(triangles), 3), normals)
        distances[distances >= least] = np.inf
        cut = np.flatnonzero(~self.inside & (distances < least))
        spaces = np.concatenate([hulls.normals, hulls.offsets[..., None]], axis=2)[self.row[cut]]
        distances[cut] = clipped_distances(triangles[cut], normals[cut], spaces)
        return distances


def _undecided(row: Indices, bounds: Array, line: Indices, nearest: Array) -> Mask:
    """Which things of pairs, not nearer than their bounds, may change which pair of their line is the nearest.

    row: the pair of each, shape (n,). bounds: shape (n,). line, nearest: of each pair.
    """
    near = bounds < _of_lines(line, nearest)[row]
    rivals = near & ~_least_of_each(line, nearest, 1)[row]
    contested = np.zeros(int(line.max(initial=-1)) + 1, dtype=bool)
    contested[line[row[rivals]]] = True
    return near & contested[line[row]]


def _of_lines(line: Indices, nearest: Array) -> Array:
    """The least of all pairs of the same line, for each pair, shape (pairs,)."""
    least = np.full(int(line.max(initial=-1)) + 1, np.inf)
    np.minimum.at(least, line, nearest)
    return least[line]


def _least_of_each(line: Indices, values: Array, count: int) -> Mask:
    """Whether each of n values is among the least so many of its line."""
    order = np.lexsort((values, line))
    _, start, counts = np.unique(line[order], return_index=True, return_counts=True)
    place = np.empty(len(line), dtype=np.int64)
    place[order] = np.arange(len(line)) - np.repeat(start, counts)
    return place < count


def _by_solid(poses: SolidPoses, solids: Indices, rows: Indices, spaces: int = 0) -> Iterator[tuple[Solid, Indices]]:
    """Each solid with those of the rows that have it, as many at once as fit the memory with so many half spaces."""
    of_rows = solids[rows]
    for index in np.flatnonzero(np.bincount(of_rows)).tolist():
        solid, here = poses.solids[index], rows[of_rows == index]
        for some in np.array_split(here, 1 + len(here) * spaces * len(solid.triangles) // _CORNERS):
            yield solid, some


_EDGES = np.array(list(combinations(range(8), 2))).T
"""Pairs of a box's corners, shape (2, 28)."""


def hull_half_spaces(corners: Array) -> Array:
    """Half spaces whose intersection is the hull of the eye (the origin) and a box's corners (h, 8, 3).

    Rows (n, o) of shape (h, k, 4) for the points p with n . p <= o; rows of zeros, which hold everything, come last.
    """
    faces = [corners[:, BOX_TRIANGLES[::2, k]] for k in range(3)]
    normals = cross(faces[1] - faces[0], faces[2] - faces[0])
    offsets = np.einsum("hki,hki->hk", normals, faces[0])
    behind = np.where((offsets > 0)[..., None], np.concatenate([normals, offsets[..., None]], axis=2), 0.0)
    normals = cross(corners[:, _EDGES[0]], corners[:, _EDGES[1]])
    heights = normals @ np.swapaxes(corners, 1, 2)
    below, above = heights.max(axis=2) <= 1e-12, heights.min(axis=2) >= -1e-12
    beside = np.zeros((*normals.shape[:2], 4))
    beside[..., :3] = np.where(below[..., None], normals, np.where(above[..., None], -normals, 0.0))
    spaces = np.concatenate([behind, beside], axis=1)
    bounding = np.any(spaces != 0, axis=2)
    order = np.argsort(~bounding, axis=1, kind="stable")[:, : int(bounding.sum(axis=1).max(initial=0))]
    return np.take_along_axis(spaces, order[..., None], axis=1)


def clipped_distances(triangles: Array, normals: Array, spaces: Array) -> Array:
    """Distance from the origin to the part of each triangle (n, 3, 3) inside its half spaces (n, k, 4); shape (n,).

    It is infinite where nothing is left. The triangles are clipped side by side (Sutherland and Hodgman 1974).
    """
    polygons = np.zeros((len(triangles), 3 + spaces.shape[1], 3))
    polygons[:, :3] = triangles
    counts, width = np.full(len(triangles), 3), 3
    for space in np.swapaxes(spaces, 0, 1):
        heights = (polygons[:, :width] @ space[:, :3, None])[..., 0] - space[:, 3:]
        cut = np.flatnonzero(((heights > 0) & (np.arange(width) < counts[:, None])).any(axis=1))
        if len(cut):
            clipped, counts[cut] = _clipped(polygons[cut, :width], counts[cut], heights[cut])
            width = max(width, clipped.shape[1])
            polygons[cut, : clipped.shape[1]] = clipped
    return distances_to_origin(polygons[:, :width], counts, normals)


def _clipped(polygons: Array, counts: Indices, heights: Array) -> tuple[Array, Indices]:
    """What of polygons (n, p, 3) lies where the height is not above 0, and how many points they then have.

    counts: how many of the points each has, shape (n,). heights: of the points, shape (n, p).
    """
    width = polygons.shape[1]
    present, following = np.arange(width) < counts[:, None], _following(counts, width)
    row = np.arange(len(polygons))[:, None]
    after, ends = heights[row, following], polygons[row, following]
    inside, crosses = present & (heights <= 0), present & ((heights > 0) != (after > 0))
    share = heights / np.where(crosses, heights - after, 1.0)
    points = np.stack([polygons, polygons + share[..., None] * (ends - polygons)], axis=2)
    kept = np.stack([inside, crosses], axis=2).reshape(len(polygons), 2 * width)
    counts = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(1, int(counts.max(initial=0)))]
    return points.reshape(len(polygons), 2 * width, 3)[row, order], counts


def _following(counts: Indices, width: int) -> Indices:
    """Index of the next point around polygons of `counts` points, shape (n, width)."""
    following = np.arange(1, width + 1)
    return np.where(following < counts[:, None], following, 0)


def distances_to_origin(polygons: Array, counts: Indices, normals: Array) -> Array:
    """Distance from the origin to convex planar polygons (n, p, 3) of the first `counts` points; shape (n,)."""
    width = polygons.shape[1]
    present = np.arange(width) < counts[:, None]
    sides = polygons[np.arange(len(polygons))[:, None], _following(counts, width)] - polygons
    squares = np.maximum(np.einsum("npi,npi->np", sides, sides), 1e-300)
    share = np.clip(-np.einsum("npi,npi->np", polygons, sides) / squares, 0.0, 1.0)
    to_sides = np.where(present, np.linalg.norm(polygons + share[..., None] * sides, axis=2), np.inf)
    lengths = np.maximum(np.einsum("ni,ni->n", normals, normals), 1e-300)
    feet = normals * (np.einsum("ni,ni->n", polygons[:, 0], normals) / lengths)[:, None]
    turns = (cross(sides, feet[:, None] - polygons) @ normals[:, :, None])[..., 0]
    surrounded = ((turns >= 0) | ~present).all(axis=1) | ((turns <= 0) | ~present).all(axis=1)
    surrounded &= (counts > 2) & (lengths > 1e-30)
    to_plane = np.where(surrounded, np.linalg.norm(feet, axis=1), np.inf)
    distances: Array = np.minimum(to_plane, to_sides.min(axis=1))
    return distances
