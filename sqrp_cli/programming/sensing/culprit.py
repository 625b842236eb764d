"""Which of several solids to name as the one that hides a box."""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross, inverse, transform
from sqrp_cli.programming.sensing.clipping import clipped_distances, distances_to_origin, hull_half_spaces
from sqrp_cli.programming.sensing.sight_lines import Indices, Pairs, SightLines, SolidPoses
from sqrp_cli.programming.solids import Solid

_PRODUCTS = 50_000
"""Pairs of ray and triangle that are compared at once: about what fits the cache."""

_CORNERS = 10_000_000
"""Corners of triangles that are held against half spaces at once, at most, to bound the memory."""

_FIRST = 4
"""Triangles of each line that are clipped first, to know how near the others must be to matter."""


def find_culprits(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> Indices:
    """Index of the solid that hides each sight line's box, shape (v,); -1 where no pair names the sight line.

    It is the solid whose first hit along the ray from the camera to the box's centre (v, 3) is nearest or, if none
    meets that ray, the one whose nearest point inside the view hull is closest to the camera. pairs: (sight line,
    solid) inside the view hulls, ordered by sight line.
    """
    culprits = np.full(len(lines.state), -1, dtype=np.int64)
    line, solid = pairs
    culprits[line] = solid
    several = np.bincount(line, minlength=len(culprits))[line] > 1
    line, solid = line[several], solid[several]
    along = _along_rays(lines, center, poses, (line, solid))
    met = np.full(len(culprits), np.inf)
    np.minimum.at(met, line, along)
    _name_least(culprits, (line, solid), along)
    missed = met[line] > 1.0
    if missed.any():
        line, solid = line[missed], solid[missed]
        _name_least(culprits, (line, solid), _nearest_inside(lines, poses, (line, solid)))
    return culprits


def _name_least(culprits: Indices, pairs: Pairs, values: Array) -> None:
    """Make the solid with the least value among the pairs of a line its culprit; the first of equals."""
    order = np.lexsort((values, pairs[0]))
    named, first = np.unique(pairs[0][order], return_index=True)
    culprits[named] = pairs[1][order][first]


def _along_rays(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> Array:
    """Smallest factor of the ray from the eye to the centre at which it meets the solid of each pair, shape (pairs,).

    It is infinite if it meets none of the solid's triangles. Rays and edges are compared by their Plücker coordinates.
    """
    line, solid = pairs
    factors = np.full(len(line), np.inf)
    X_PW = inverse(poses.at(solid, lines.state[line]))
    eye, ray = transform(X_PW, np.stack([lines.eyes[lines.hull[line]], center[line]], axis=1)).swapaxes(0, 1)
    ray = ray - eye
    for index in np.flatnonzero(np.bincount(solid)).tolist():
        here = np.flatnonzero(solid == index)
        factors[here] = _first_hits(eye[here], ray[here], poses.solids[index])
    return factors


def _first_hits(eye: Array, ray: Array, solid: Solid) -> Array:
    """Smallest factor of each ray (n, 3) from its eye (n, 3) at which it meets a triangle of a solid; shape (n,)."""
    edges, normal, offset = _lines_and_planes(solid)
    lines = np.concatenate([ray, cross(eye, ray)], axis=1)
    factors = np.full(len(eye), np.inf)
    for chunk in np.array_split(np.arange(len(eye)), 1 + len(eye) * len(offset) // _PRODUCTS):
        sides = [lines[chunk] @ edge for edge in edges]
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


def _lines_and_planes(solid: Solid) -> tuple[list[Array], Array, Array]:
    """The lines along the three edges of each triangle, (6, F) each, and the triangles' planes, (F, 3) and (F,)."""
    if solid in _known:
        return _known[solid]
    p = [solid.vertices[solid.triangles[:, k]] for k in range(3)]
    edges = [np.concatenate([cross(p[k], p[(k + 1) % 3]), p[(k + 1) % 3] - p[k]], axis=1).T for k in range(3)]
    normal = cross(p[1] - p[0], p[2] - p[0])
    _known[solid] = edges, normal, np.einsum("fi,fi->f", normal, p[0])
    return _known[solid]


_known: WeakKeyDictionary[Solid, tuple[list[Array], Array, Array]] = WeakKeyDictionary()
"""Lines and planes of solids that are still in use."""


def _nearest_inside(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Least distance from the eye to the part of each pair's solid inside the view hull, shape (pairs,).

    It may be too large, up to infinite, where another solid of the same line is nearer anyway.
    """
    nearest = np.full(len(pairs[0]), np.inf)
    hull_of = lines.hull[pairs[0]]
    hulls, hull = np.unique(hull_of, return_inverse=True)
    half_spaces = hull_half_spaces(lines.corners[hulls] - lines.eyes[hulls, None])
    X_EP = poses.at(pairs[1], lines.state[pairs[0]])  # E: at the eye, with the axes of the world
    X_EP[:, :3, 3] -= lines.eyes[hull_of]
    rows, polygons = [], []
    for row, solid in _by_solid(pairs[1], half_spaces.shape[1], poses):
        outside = _outside(solid.vertices, X_EP[row], half_spaces[hull[row]])
        points = transform(X_EP[row], solid.vertices)
        vertex, at = np.nonzero(outside == 0)
        inside = points[at, vertex]
        np.minimum.at(nearest, row[at], np.sqrt(np.einsum("ni,ni->n", inside, inside)))
        a, b, c = (outside[corner] for corner in solid.triangles.T)
        triangle, at = np.nonzero((a & b & c) == 0)
        rows.append(row[at])
        polygons.append(points[at[:, None], solid.triangles[triangle]])
    row, triangles = np.concatenate(rows), np.concatenate(polygons)
    least = np.full(int(pairs[0].max()) + 1, np.inf)
    np.minimum.at(least, pairs[0], nearest)
    near = np.flatnonzero(_lower_bounds(triangles) < least[pairs[0][row]])
    row, triangles = row[near], triangles[near]
    np.minimum.at(nearest, row, _least_distances(triangles, half_spaces[hull[row]], pairs[0][row], least))
    return nearest


def _by_solid(solids: Indices, spaces: int, poses: SolidPoses) -> Iterator[tuple[Indices, Solid]]:
    """The rows of the pairs (n,) of each solid, as many at once as fit the memory."""
    for index in np.flatnonzero(np.bincount(solids)).tolist():
        solid, rows = poses.solids[index], np.flatnonzero(solids == index)
        for row in np.array_split(rows, 1 + len(rows) * spaces * len(solid.triangles) // _CORNERS):
            yield row, solid


def _outside(vertices: Array, X_EP: Array, half_spaces: Array) -> NDArray[np.uint64]:
    """Which half spaces (n, k, 4) each vertex (V, 3) lies outside of, one bit each, shape (V, n).

    X_EP: from the frame of the vertices to that of the half spaces, shape (n, 4, 4).
    """
    normals, offsets = half_spaces[..., :3], half_spaces[..., 3]
    heights = (normals @ X_EP[:, :3, 3, None])[..., 0] - offsets
    directions = (normals @ X_EP[:, :3, :3]).reshape(-1, 3)
    outside = (vertices @ directions.T > -heights.reshape(-1)).reshape(len(vertices), *offsets.shape)
    bits = np.zeros((*outside.shape[:2], 8), dtype=np.uint8)  # a hull has at most 6 + 28 half spaces
    packed = np.packbits(outside, axis=2)
    bits[..., : packed.shape[2]] = packed
    found: NDArray[np.uint64] = bits.view(np.uint64)[..., 0]
    return found


def _lower_bounds(triangles: Array) -> Array:
    """Lower bounds of the distances of triangles (n, 3, 3) from the origin: of spheres around them, shape (n,)."""
    middle = triangles.mean(axis=1)
    reach = triangles - middle[:, None]
    radius = np.sqrt(np.einsum("nki,nki->nk", reach, reach).max(axis=1, initial=0.0))
    bounds: Array = np.sqrt(np.einsum("ni,ni->n", middle, middle)) - radius
    return bounds


def _least_distances(triangles: Array, spaces: Array, line: NDArray[np.int64], least: Array) -> Array:
    """Distance of each clipped triangle (n, 3, 3) where it can be the least of its line, else infinite; shape (n,).

    spaces: half spaces that each is clipped by, shape (n, k, 4). least: least distance known so far of each line.
    """
    normals = cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    whole = distances_to_origin(triangles, np.full(len(triangles), 3), normals)
    order = np.lexsort((whole, line))
    _, start, count = np.unique(line[order], return_index=True, return_counts=True)
    place = np.empty(len(line), dtype=np.int64)
    place[order] = np.arange(len(line)) - np.repeat(start, count)
    distances, least = np.full(len(line), np.inf), least.copy()
    for chosen in (place < _FIRST, place >= _FIRST):
        asked = np.flatnonzero(chosen & (whole < least[line]))
        distances[asked] = clipped_distances(triangles[asked], normals[asked], spaces[asked])
        np.minimum.at(least, line[asked], distances[asked])
    return distances
