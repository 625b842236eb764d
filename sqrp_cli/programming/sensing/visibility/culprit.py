"""The culprit: the solid that is named as hiding a box, of several.

If the whole box must be seen, any solid in its view hull hides it, and the nearest is named: the first that the ray to
the box's centre meets or, if it meets none, the one with the nearest point inside the hull. If a share of the box is
enough, the solid that hides the largest share is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, begins_run, cross, inverse, norms, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.solids import Solid
from sqrp_cli.shapes import BOX_TRIANGLES

_PRODUCTS = 50_000
"""Pairs of ray and triangle to compare at once: about the size of the cache."""

_CORNERS = 10_000_000
"""Most corners of triangles to compare with half spaces at once, to bound the memory."""

_CLIPPED = 100_000
"""Most triangles to clip at once, to bound the memory."""

_EDGES = np.array(list(combinations(range(8), 2))).T
"""Pairs of a box's corners, shape (2, 28)."""


def find_culprits(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Indices:
    """Index of the solid that hides each sight line's box, shape (v,); -1 where no pair names the sight line.

    It is the solid with the nearest hit along the ray from the camera to the box's centre or, if none meets that ray,
    the one with a point inside the view hull closest to the camera. pairs: of solids that reach into the view hulls.
    """
    culprits = np.full(len(lines.state), -1, dtype=np.int64)
    culprits[pairs.line] = pairs.solid
    rivals = pairs.some(np.bincount(pairs.line, minlength=len(culprits))[pairs.line] > 1)
    along = _along_rays(lines, poses, rivals)
    _name_least(culprits, rivals, along)
    missed = rivals.some(_least_of_lines(rivals.line, along) > 1.0)
    if len(missed):
        _name_least(culprits, missed, nearest_inside(lines, poses, missed))
    return culprits


def find_largest(lines: SightLines, poses: SolidPoses, pairs: Pairs, part: Indices) -> Indices:
    """Index of a solid of the part that hides the largest share of each sight line's box, shape (v,).

    -1 where no pair names the sight line. Each part counts all directions in which it lies in front of the box's far
    side, other parts ignored, on the rays that decide whether the box is visible. Of equals the first part is named.

    pairs: of solids that reach into the view hulls. part: of each solid, by rank, shape (s,).
    """
    largest = np.full(len(lines.state), -1, dtype=np.int64)
    largest[pairs.line] = pairs.solid
    pairs = pairs.some(np.lexsort((part[pairs.solid], pairs.line)))
    begins = begins_run(pairs.line) | begins_run(part[pairs.solid])
    several = np.bincount(pairs.line[begins], minlength=len(largest))[pairs.line] > 1
    pairs, begins = pairs.some(several), begins[several]
    # Each part by itself, as if it were alone in front of the box.
    of_part = pairs.some(begins)
    alone = replace(lines, state=lines.state[of_part.line], hull=lines.hull[of_part.line])
    seen = visible_shares(alone, poses, Pairs(np.cumsum(begins) - 1, pairs.solid))
    _name_least(largest, of_part, seen.share)
    return largest


def nearest_inside(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Least distance from the eye to the part of each pair's solid inside the view hull, shape (pairs,) [m].

    It may be too large where another solid of the same line is nearer.
    """
    hulls = _HullSpaces.of(lines, poses, pairs)
    nearest = np.full(len(pairs), np.inf)
    for solid, rows in _by_solid(poses, pairs.solid, hulls.spaces.shape[1]):
        facets, outside = _Facets.of(solid), hulls.outside(rows, solid.vertices)
        vertex, at = np.nonzero(outside == 0)
        np.minimum.at(nearest, rows[at], norms(solid.vertices[vertex] - hulls.eyes[rows[at]]))
        a, b, c = (outside[corner] for corner in solid.triangles.T)
        facet, at = np.nonzero((a & b & c) == 0)
        # Spheres around the triangles spare most of the exact distances.
        near = norms(facets.middles[facet] - hulls.eyes[rows[at]]) - facets.radii[facet]
        kept = np.flatnonzero(near < _least_of_lines(pairs.line, nearest)[rows[at]])
        facet, at = facet[kept], at[kept]
        for chunk in np.array_split(np.arange(len(facet)), 1 + len(facet) // _CLIPPED):
            some, row = facet[chunk], rows[at[chunk]]
            least = _least_of_lines(pairs.line, nearest)[row]
            distances = hulls.distances(row, facets.points[some], facets.normals[some], least)
            np.minimum.at(nearest, row, distances)
    return nearest


def _name_least(culprits: Indices, pairs: Pairs, values: Array) -> None:
    """Make the solid with the least value among the pairs of a line its culprit; the first of equals."""
    order = np.lexsort((values, pairs.line))
    named, first = np.unique(pairs.line[order], return_index=True)
    culprits[named] = pairs.solid[order][first]


def _least_of_lines(line: Indices, values: Array) -> Array:
    """The least value of all pairs of the same line, for each pair, shape (pairs,)."""
    least = np.full(int(line.max(initial=-1)) + 1, np.inf)
    np.minimum.at(least, line, values)
    return least[line]


def _along_rays(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Smallest factor of the ray from the eye to the box's centre at which it meets each pair's solid, shape (pairs,).

    Infinite if it meets none of the solid's triangles.
    """
    factors = np.full(len(pairs), np.inf)
    hull = lines.hull[pairs.line]
    X_PW = inverse(poses.at(pairs.solid, lines.state[pairs.line]))
    ends = np.stack([lines.eyes[hull], lines.X_WB[hull, :3, 3]], axis=1)
    eye, center = transform(X_PW, ends).swapaxes(0, 1)
    for solid, rows in _by_solid(poses, pairs.solid):
        factors[rows] = _first_hits(eye[rows], (center - eye)[rows], _Facets.of(solid))
    return factors


def _first_hits(eye: Array, ray: Array, facets: _Facets) -> Array:
    """Smallest factor of each ray (n, 3) from its eye (n, 3) at which it meets one of the facets; shape (n,).

    A line meets a triangle if its Plücker products with all three edges have one sign (K. Shoemake, 1998).
    """
    normal, offset = facets.normals, facets.offsets
    lines = np.concatenate([ray, cross(eye, ray)], axis=1)
    factors = np.full(len(eye), np.inf)
    for chunk in np.array_split(np.arange(len(eye)), 1 + len(eye) * len(offset) // _PRODUCTS):
        sides = [lines[chunk] @ edge for edge in facets.edges]
        inside = ((sides[0] >= 0) & (sides[1] >= 0) & (sides[2] >= 0)) | (
            (sides[0] <= 0) & (sides[1] <= 0) & (sides[2] <= 0)
        )
        row, face = np.nonzero(inside)
        at = chunk[row]
        slope = np.einsum("ni,ni->n", normal[face], ray[at])
        height = offset[face] - np.einsum("ni,ni->n", normal[face], eye[at])
        factor = height / np.where(slope == 0, np.inf, slope)
        np.minimum.at(factors, at, np.where(factor > 0, factor, np.inf))
    return factors


@dataclass(frozen=True, eq=False)
class _Facets:
    """The F triangles of a solid, in its parent's frame, prepared for comparison with rays and view hulls."""

    points: Array
    """Their corners, shape (F, 3, 3) [m]."""
    normals: Array
    """n of n . p = o for the points p of each one's plane, not of length 1, shape (F, 3)."""
    offsets: Array
    """o of the same, shape (F,)."""
    middles: Array
    """Centre of a sphere around each, shape (F, 3) [m]."""
    radii: Array
    """Its radius, shape (F,) [m]."""
    edges: tuple[Array, Array, Array]
    """Plücker coordinates of the line along each of the three edges, moment before direction, shape (6, F) each."""

    @staticmethod
    def of(solid: Solid) -> _Facets:
        """The facets of a solid; made once."""
        if solid not in _facets:
            points = solid.vertices[solid.triangles]
            a, b, c = points.swapaxes(0, 1)
            normals = cross(b - a, c - a)
            middles = points.mean(axis=1)
            reach = points - middles[:, None]
            _facets[solid] = _Facets(
                points=points,
                normals=normals,
                offsets=np.einsum("fi,fi->f", normals, a),
                middles=middles,
                radii=np.sqrt(np.einsum("fki,fki->fk", reach, reach).max(axis=1, initial=0.0)),
                edges=(_line(a, b), _line(b, c), _line(c, a)),
            )
        return _facets[solid]


def _line(start: Array, end: Array) -> Array:
    """Plücker coordinates of lines through points (F, 3), shape (6, F)."""
    return np.ascontiguousarray(np.concatenate([cross(start, end), end - start], axis=1).T)


_facets: WeakKeyDictionary[Solid, _Facets] = WeakKeyDictionary()
"""Cached results for solids still in use."""


@dataclass(frozen=True, eq=False)
class _HullSpaces:
    """The view hulls of n pairs as intersections of k half spaces, with the axes of each solid's parent."""

    spaces: Array
    """(n, o) of each half space: the points p with n . p <= o, the eye as origin, shape (n, k, 4)."""
    eyes: Array
    """Camera centres in the parent's frame, shape (n, 3)."""

    @staticmethod
    def of(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> _HullSpaces:
        hull_of = lines.hull[pairs.line]
        hulls, hull = np.unique(hull_of, return_inverse=True)
        spaces = _half_spaces(lines.corners[hulls] - lines.eyes[hulls, None])[hull]
        X_PW = inverse(poses.at(pairs.solid, lines.state[pairs.line]))
        eyes: Array = (X_PW[:, :3, :3] @ lines.eyes[hull_of, :, None])[..., 0] + X_PW[:, :3, 3]
        normals = spaces[..., :3] @ X_PW[:, :3, :3].swapaxes(1, 2)
        return _HullSpaces(np.concatenate([normals, spaces[..., 3:]], axis=2), eyes)

    def outside(self, rows: Indices, vertices: Array) -> NDArray[np.unsignedinteger]:
        """The half spaces of hulls (n,) that exclude each vertex (V, 3), one bit each, shape (V, n)."""
        normals = np.ascontiguousarray(self.spaces[rows, :, :3])
        reach = self.spaces[rows, :, 3] + (normals @ self.eyes[rows, :, None])[..., 0]
        outside = (vertices @ normals.reshape(-1, 3).T > reach.reshape(-1)).reshape(len(vertices), *reach.shape)
        packed = np.packbits(outside, axis=2)
        size = next(size for size in (1, 2, 4, 8) if size >= packed.shape[2])  # a hull has at most 6 + 28 half spaces
        bits = np.zeros((*packed.shape[:2], size), dtype=np.uint8)
        bits[..., : packed.shape[2]] = packed
        return bits.view(f"u{size}")[..., 0]

    def distances(self, rows: Indices, triangles: Array, normals: Array, least: Array) -> Array:
        """Distance from the eye to the part of each triangle (n, 3, 3) inside its hull (n,), shape (n,) [m].

        Infinite where no part of the triangle is both inside and nearer than `least`. normals: of the triangles, shape
        (n, 3).
        """
        triangles = triangles - self.eyes[rows, None]
        distances = _distances_to_origin(triangles, np.full(len(triangles), 3), normals)
        near = np.flatnonzero(distances < least)
        found = np.full(len(rows), np.inf)
        found[near] = _clipped_distances(triangles[near], normals[near], self.spaces[rows[near]])
        return found


def _by_solid(poses: SolidPoses, solids: Indices, spaces: int = 0) -> Iterator[tuple[Solid, Indices]]:
    """Each solid with its pairs, as many at once as fit the memory with that number of half spaces."""
    for index in np.flatnonzero(np.bincount(solids)).tolist():
        solid, rows = poses.solids[index], np.flatnonzero(solids == index)
        for some in np.array_split(rows, 1 + len(rows) * spaces * len(solid.triangles) // _CORNERS):
            yield solid, some


def _half_spaces(corners: Array) -> Array:
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


def _clipped_distances(triangles: Array, normals: Array, spaces: Array) -> Array:
    """Distance from the origin to the part of each triangle (n, 3, 3) inside its half spaces (n, k, 4); shape (n,).

    Infinite where nothing is left. The triangles are clipped side by side (Sutherland and Hodgman 1974).
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
    return _distances_to_origin(polygons[:, :width], counts, normals)


def _clipped(polygons: Array, counts: Indices, heights: Array) -> tuple[Array, Indices]:
    """The parts of polygons (n, p, 3) where the height is not above 0, and their numbers of points.

    counts: number of points of each, shape (n,). heights: of the points, shape (n, p).
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


def _distances_to_origin(polygons: Array, counts: Indices, normals: Array) -> Array:
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
