"""Which of several solids to name as the one that hides a box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, transform
from sqrp_cli.programming.sensing.occlusion import SightLines, SolidPoses
from sqrp_cli.programming.solids import BOX_TRIANGLES


def find_culprits(
    lines: SightLines,
    center: Array,
    poses: SolidPoses,
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> NDArray[np.int64]:
    """Index of the solid that hides each sight line's box, shape (v,); -1 where no pair names the sight line.

    It is the solid whose first hit along the ray from the camera to the box's centre (v, 3) is nearest or, if none
    meets that ray, the one whose nearest point inside the view hull is closest to the camera. pairs: (sight line,
    solid) inside the view hulls, ordered by sight line.
    """
    culprits = np.full(len(lines.state), -1, dtype=np.int64)
    _, first, counts = np.unique(pairs[0], return_index=True, return_counts=True)
    for start, count in zip(first.tolist(), counts.tolist(), strict=True):
        line, solids = int(pairs[0][start]), pairs[1][start : start + count]
        culprits[line] = solids[0] if count == 1 else _nearest_of(lines, line, center[line], poses, solids)
    return culprits


def _nearest_of(lines: SightLines, line: int, center: Array, poses: SolidPoses, solids: NDArray[np.int64]) -> int:
    hull = int(lines.hull[line])
    eye, corners, state = lines.eyes[hull], lines.corners[hull], int(lines.state[line])
    faces = []
    for index in solids.tolist():
        X_WP = poses.pose(index)
        vertices = transform(X_WP[state if len(X_WP) > 1 else 0], poses.solids[index].vertices) - eye
        faces.append(vertices[poses.solids[index].triangles])
    along = [_first_hit(triangles, center - eye) for triangles in faces]
    if min(along) <= 1.0:
        return int(solids[int(np.argmin(along))])
    spaces = _hull_half_spaces(corners - eye)
    return int(solids[int(np.argmin([_nearest_inside(triangles, spaces) for triangles in faces]))])


def _first_hit(triangles: Array, ray: Array) -> float:
    """Smallest factor of `ray` (3,) at which it meets a triangle (n, 3, 3), both from the eye.

    It is infinite if it meets none.
    """
    edges = np.stack([np.cross(triangles[:, i], triangles[:, (i + 1) % 3]) for i in range(3)], axis=1)
    sides = edges @ ray
    total = sides.sum(axis=1)
    met = ((sides >= 0).all(axis=1) | (sides <= 0).all(axis=1)) & (total != 0)
    factors = np.einsum("ni,ni->n", triangles[met, 2], edges[met, 0]) / total[met]
    return float(np.min(factors[factors > 0], initial=np.inf))


def _hull_half_spaces(corners: Array) -> Array:
    """Half spaces whose intersection is the hull of the eye (the origin) and the box's corners (8, 3).

    Rows (n, o) of shape (k, 4) for the points p with n . p <= o.
    """
    spaces = []
    for triangle in BOX_TRIANGLES[::2]:
        normal = np.cross(corners[triangle[1]] - corners[triangle[0]], corners[triangle[2]] - corners[triangle[0]])
        offset = float(normal @ corners[triangle[0]])
        if offset > 0:
            spaces.append([*normal, offset])
    for first in range(8):
        for second in range(first + 1, 8):
            normal = np.cross(corners[first], corners[second])
            heights = corners @ normal
            if np.linalg.norm(normal) > 0 and (heights.max() <= 1e-12 or heights.min() >= -1e-12):
                spaces.append([*(normal if heights.max() <= 1e-12 else -normal), 0.0])
    return np.array(spaces)


def _nearest_inside(triangles: Array, hull: Array) -> float:
    """Least distance from the eye (the origin) to the part of the triangles (n, 3, 3) inside the hull.

    It is infinite if none is.
    """
    outside = np.einsum("kj,nvj->nkv", hull[:, :3], triangles) > hull[:, 3][None, :, None]
    best = np.inf
    for triangle in triangles[~outside.all(axis=2).any(axis=1)]:
        polygon = list(triangle)
        for space in hull:
            polygon = _clip(polygon, space)
        if polygon:
            best = min(best, _distance_to_origin(np.array(polygon)))
    return best


def _clip(polygon: list[Array], space: Array) -> list[Array]:
    """The part of a convex polygon inside a half space (Sutherland and Hodgman 1974)."""
    heights = [float(space[:3] @ point - space[3]) for point in polygon]
    kept = []
    for i, point in enumerate(polygon):
        before = heights[i - 1]
        if (before > 0) != (heights[i] > 0):
            kept.append(polygon[i - 1] + (point - polygon[i - 1]) * before / (before - heights[i]))
        if heights[i] <= 0:
            kept.append(point)
    return kept


def _distance_to_origin(polygon: Array) -> float:
    """Distance from the origin to a convex planar polygon (n, 3), n >= 1."""
    following = np.roll(polygon, -1, axis=0)
    sides = following - polygon
    squares = np.maximum(np.einsum("ni,ni->n", sides, sides), 1e-300)
    share = np.clip(-np.einsum("ni,ni->n", polygon, sides) / squares, 0.0, 1.0)
    best = float(np.linalg.norm(polygon + share[:, None] * sides, axis=1).min())
    normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0]) if len(polygon) > 2 else np.zeros(3)
    length = np.linalg.norm(normal)
    if length > 1e-15:
        foot = normal * (polygon[0] @ normal) / length**2
        turns = np.cross(sides, foot - polygon) @ normal
        if (turns >= 0).all() or (turns <= 0).all():
            best = min(best, float(np.linalg.norm(foot)))
    return best
