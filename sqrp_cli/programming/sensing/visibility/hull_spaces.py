"""View hulls as intersections of half spaces: which points lie in them, and how far the eye is from what does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask, cross, inverse, norms
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.shapes import BOX_TRIANGLES

BOX_FACES = np.array([[*first, second[2]] for first, second in BOX_TRIANGLES.reshape(6, 2, 3).tolist()])
"""Corners of each face of a box, in their order around it seen from outside, shape (6, 4)."""


def _edges() -> Indices:
    sides = {
        (start, end): face
        for face, corners in enumerate(BOX_FACES.tolist())
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True)
    }
    return np.array([(*edge, sides[edge], sides[edge[::-1]]) for edge in sides if edge < edge[::-1]]).T


_EDGES = _edges()
"""Start and end of each edge of a box, the face around which it runs so, and the other one, shape (4, 12)."""

_ROUNDING = 1e-9
"""Share by which a least depth may be too large."""

_SURE = 1e-6
"""Least depth of a witness below the faces of a view hull [m], well above rounding."""

_AT_ONCE = 4096
"""Most view hulls to compare with the witnesses of a solid at once, to bound the memory."""


def witnessed(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Mask:
    """Whether a witness of each pair's solid lies inside the view hull, shape (pairs,); then the solid meets it."""
    hulls, hull = np.unique(lines.hull[pairs.line], return_inverse=True)
    eyes, state = lines.eyes[hulls], lines.state[pairs.line]
    spaces = half_spaces(lines.corners[hulls] - eyes[:, None])
    limits = spaces[..., 3] - _SURE * np.sqrt(np.einsum("hki,hki->hk", spaces[..., :3], spaces[..., :3]))
    found = np.zeros(len(pairs), dtype=bool)
    for index in np.unique(pairs.solid).tolist():
        points_P, X_WP = poses.solids[index].witnesses.T, poses.pose(index)
        rows = np.flatnonzero(pairs.solid == index)
        for some in np.array_split(rows, 1 + len(rows) // _AT_ONCE):
            X, of = X_WP[state[some]] if len(X_WP) > 1 else X_WP, hull[some]
            points = X[:, :3, :3] @ points_P + (X[:, :3, 3] - eyes[of])[..., None]
            outside = (spaces[of, :, :3] @ points > limits[of, :, None]).any(axis=1)
            found[some] = ~outside.all(axis=1) & lines.finite[hulls[of]]
    return found


@dataclass(frozen=True, eq=False)
class HullSpaces:
    """The view hulls of n pairs as intersections of k half spaces, with the axes of each solid's parent."""

    spaces: Array
    """(n, o) of each half space: the points p with n . p <= o, the eye as origin, shape (n, k, 4)."""
    eyes: Array
    """Camera centres in the parent's frame, shape (n, 3)."""
    rays: Array
    """From the eye to the box's corners, those of a hull of one depth, shape (n, 8, 3)."""

    @staticmethod
    def of(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> HullSpaces:
        """The view hulls of pairs, each in the axes of its solid's parent."""
        hull_of = lines.hull[pairs.line]
        hulls, hull = np.unique(hull_of, return_inverse=True)
        rays = lines.corners[hulls] - lines.eyes[hulls, None]
        spaces = half_spaces(rays)[hull]
        rays /= rays @ (rays.mean(axis=1) / norms(rays.mean(axis=1))[:, None])[:, :, None]
        X_PW = inverse(poses.at(pairs.solid, lines.state[pairs.line]))
        eyes: Array = (X_PW[:, :3, :3] @ lines.eyes[hull_of, :, None])[..., 0] + X_PW[:, :3, 3]
        normals = spaces[..., :3] @ X_PW[:, :3, :3].swapaxes(1, 2)
        rays = rays[hull] @ X_PW[:, :3, :3].swapaxes(1, 2)
        return HullSpaces(np.concatenate([normals, spaces[..., 3:]], axis=2), eyes, rays)

    def least_depths(self, rows: Indices, normals: Array, offsets: Array) -> Array:
        """Least distance from the eye at which hulls (n,) can meet planes, see `_Facets`; shape (n,) [m]."""
        heights = offsets - np.einsum("ni,ni->n", normals, self.eyes[rows])
        slopes = (self.rays[rows] @ normals[:, :, None])[..., 0]
        steepest = np.where(heights < 0, -slopes.min(axis=1), slopes.max(axis=1))
        depths: Array = np.abs(heights) / np.maximum(steepest, 1e-300)
        return depths * (1 - _ROUNDING)

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


def half_spaces(corners: Array) -> Array:
    """Half spaces whose intersection is the hull of the eye (the origin) and a box's corners (h, 8, 3).

    Rows (n, o) of shape (h, k, 4) for the points p with n . p <= o; rows of zeros, which hold everything, come last.
    """
    a, b, c = (corners[:, BOX_FACES[:, k]] for k in range(3))
    normals = cross(b - a, c - a)
    offsets = np.einsum("hki,hki->hk", normals, a)
    turned = offsets > 0  # away from the eye
    behind = np.where(turned[..., None], np.concatenate([normals, offsets[..., None]], axis=2), 0.0)
    # Beside it, planes run through the eye and the edges between faces turned to it and away from it.
    start, end, face, neighbour = _EDGES
    side = turned[:, neighbour].astype(float) - turned[:, face]
    beside = np.zeros((*side.shape, 4))
    beside[..., :3] = side[..., None] * cross(corners[:, start], corners[:, end])
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
            clipped, counts[cut] = clipped_polygons(polygons[cut, :width], counts[cut], heights[cut])
            width = max(width, clipped.shape[1])
            polygons[cut, : clipped.shape[1]] = clipped
    return _distances_to_origin(polygons[:, :width], counts, normals)


def clipped_polygons(polygons: Array, counts: Indices, heights: Array) -> tuple[Array, Indices]:
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
