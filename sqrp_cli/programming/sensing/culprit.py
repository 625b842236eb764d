"""Which of several solids to name as the one that hides a box."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross, inverse, transform
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines, SolidPoses
from sqrp_cli.programming.solids import BOX_TRIANGLES, Solid

_PRODUCTS = 50_000
"""Pairs of ray and triangle that are compared at once: about what fits the cache."""

_FIRST = 4
"""Triangles of each line that are clipped first, to know how near the others must be to matter."""

_EDGES = np.array(list(combinations(range(8), 2))).T
"""Pairs of a box's corners, shape (2, 28)."""


def find_culprits(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> NDArray[np.int64]:
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


def _name_least(culprits: NDArray[np.int64], pairs: Pairs, values: Array) -> None:
    """Make the solid with the least value among the pairs of a line its culprit; the first of equals."""
    order = np.lexsort((values, pairs[0]))
    named, first = np.unique(pairs[0][order], return_index=True)
    culprits[named] = pairs[1][order][first]


def _along_rays(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> Array:
    """Smallest factor of the ray from the eye to the centre at which it meets the solid of each pair, shape (pairs,).

    It is infinite if it meets none of the solid's triangles. Rays and edges are compared by their Plücker coordinates.
    """
    factors = np.full(len(pairs[0]), np.inf)
    for index in np.unique(pairs[1]).tolist():
        here = np.flatnonzero(pairs[1] == index)
        line = pairs[0][here]
        X_PW = inverse(_at(poses.pose(index), lines.state[line]))
        ends = transform(X_PW, np.stack([lines.eyes[lines.hull[line]], center[line]], axis=1))
        factors[here] = _first_hits(ends[:, 0], ends[:, 1] - ends[:, 0], poses.solids[index])
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


@lru_cache(maxsize=512)
def _lines_and_planes(solid: Solid) -> tuple[list[Array], Array, Array]:
    """The lines along the three edges of each triangle, (6, F) each, and the triangles' planes, (F, 3) and (F,)."""
    p = [solid.vertices[solid.triangles[:, k]] for k in range(3)]
    edges = [np.concatenate([cross(p[k], p[(k + 1) % 3]), p[(k + 1) % 3] - p[k]], axis=1).T for k in range(3)]
    normal = cross(p[1] - p[0], p[2] - p[0])
    return edges, normal, np.einsum("fi,fi->f", normal, p[0])


def _nearest_inside(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Least distance from the eye to the part of each pair's solid inside the view hull, shape (pairs,).

    It may be too large, up to infinite, where another solid of the same line is nearer anyway.
    """
    nearest = np.full(len(pairs[0]), np.inf)
    polygons, of_pair = [], []
    hulls, hull_of = np.unique(lines.hull[pairs[0]], return_inverse=True)
    half_spaces = _hull_half_spaces(lines.corners[hulls] - lines.eyes[hulls, None])
    bits = 1 << np.arange(half_spaces.shape[1], dtype=np.int64)
    for number, (line, index) in enumerate(zip(*(side.tolist() for side in pairs), strict=True)):
        X_WP = _at(poses.pose(index), lines.state[line : line + 1])[0]
        vertices = transform(X_WP, poses.solids[index].vertices) - lines.eyes[lines.hull[line]]
        space = half_spaces[hull_of[number]]
        outside = (vertices @ space[:, :3].T > space[:, 3]) @ bits
        inside = vertices[outside == 0]
        nearest[number] = np.sqrt(np.einsum("vi,vi->v", inside, inside).min(initial=np.inf))
        a, b, c = outside[poses.solids[index].triangles].T
        kept = vertices[poses.solids[index].triangles[(a & b & c) == 0]]
        polygons.append(kept)
        of_pair.append(np.full(len(kept), number))
    row, triangles = np.concatenate(of_pair), np.concatenate(polygons)
    least = np.full(int(pairs[0].max()) + 1, np.inf)
    np.minimum.at(least, pairs[0], nearest)
    near = np.flatnonzero(_lower_bounds(triangles) < least[pairs[0][row]])
    row, triangles = row[near], triangles[near]
    np.minimum.at(nearest, row, _least_distances(triangles, half_spaces[hull_of[row]], pairs[0][row], least))
    return nearest


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
    whole = _distances_to_origin(triangles, np.full(len(triangles), 3), normals)
    order = np.lexsort((whole, line))
    _, start, count = np.unique(line[order], return_index=True, return_counts=True)
    place = np.empty(len(line), dtype=np.int64)
    place[order] = np.arange(len(line)) - np.repeat(start, count)
    distances, least = np.full(len(line), np.inf), least.copy()
    for chosen in (place < _FIRST, place >= _FIRST):
        asked = np.flatnonzero(chosen & (whole < least[line]))
        distances[asked] = _clipped_distances(triangles[asked], normals[asked], spaces[asked])
        np.minimum.at(least, line[asked], distances[asked])
    return distances


def _hull_half_spaces(corners: Array) -> Array:
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

    It is infinite where nothing is left. The triangles are clipped side by side (Sutherland and Hodgman 1974).
    """
    polygons, counts = triangles, np.full(len(triangles), 3)
    for space in np.swapaxes(spaces, 0, 1):
        width = polygons.shape[1]
        present = np.arange(width) < counts[:, None]
        heights = (polygons @ space[:, :3, None])[..., 0] - space[:, 3:]
        following = _following(counts, width)
        after = np.take_along_axis(heights, following, axis=1)
        ends = np.take_along_axis(polygons, following[..., None], axis=1)
        inside, crosses = present & (heights <= 0), present & ((heights > 0) != (after > 0))
        share = heights / np.where(crosses, heights - after, 1.0)
        points = np.stack([polygons, polygons + share[..., None] * (ends - polygons)], axis=2)
        kept = np.stack([inside, crosses], axis=2).reshape(len(polygons), 2 * width)
        counts = kept.sum(axis=1)
        order = np.argsort(~kept, axis=1, kind="stable")[:, : max(1, int(counts.max(initial=0)))]
        polygons = np.take_along_axis(points.reshape(len(polygons), 2 * width, 3), order[..., None], axis=1)
    return _distances_to_origin(polygons, counts, normals)


def _following(counts: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Index of the next point around polygons of `counts` points, shape (n, width)."""
    following = np.arange(1, width + 1)
    return np.where(following < counts[:, None], following, 0)


def _distances_to_origin(polygons: Array, counts: NDArray[np.int64], normals: Array) -> Array:
    """Distance from the origin to convex planar polygons (n, p, 3) of the first `counts` points; shape (n,)."""
    width = polygons.shape[1]
    present = np.arange(width) < counts[:, None]
    sides = np.take_along_axis(polygons, _following(counts, width)[..., None], axis=1) - polygons
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


def _at(X_WP: Array, state: NDArray[np.int64]) -> Array:
    return X_WP[state] if len(X_WP) > 1 else X_WP
