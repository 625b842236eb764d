"""What of triangles lies inside view hulls, and how near to the camera."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sqrp_cli.geometry import Array, cross
from sqrp_cli.programming.sensing.sight_lines import Indices
from sqrp_cli.programming.sensing.solids import BOX_TRIANGLES

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
