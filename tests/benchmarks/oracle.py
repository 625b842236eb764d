"""Exact line of sight by clipping triangles, written without any of the code that it judges."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sqrp_cli.geometry import BOX_SIGNS, Array
from tests.benchmarks.scene import BenchmarkScene

_TRIPLES = np.array(list(combinations(range(9), 3)))


def hidden(scene: BenchmarkScene, asked: Array) -> Array:
    """Whether any triangle reaches into the hull of camera centre and box, for `asked` (boxes, cameras, states)."""
    found = np.zeros(asked.shape, dtype=bool)
    for number, box in enumerate(scene.boxes):
        corners = scene.points(box, BOX_SIGNS)
        for camera in range(asked.shape[1]):
            for state in np.flatnonzero(asked[number, camera]):
                hull = np.concatenate([corners[state], scene.eye(camera)[None]])
                found[number, camera, state] = _any_inside(scene, int(state), hull)
    return found


def _any_inside(scene: BenchmarkScene, state: int, points: Array) -> bool:
    spaces = _half_spaces(points)
    for solid in scene.observer.solids:
        X_WP = scene.states.X_WF[solid.part.parent]
        X = X_WP[state if len(X_WP) > 1 else 0]
        heights = (solid.vertices @ X[:3, :3].T + X[:3, 3]) @ spaces[:, :3].T - spaces[:, 3]
        outside = (heights > 0)[solid.triangles]
        if not outside.any(axis=2).all():
            return True  # a corner of a triangle is inside
        for face in np.flatnonzero(~outside.all(axis=1).any(axis=1)):
            if _reaches(heights[solid.triangles[face]]):
                return True
    return False


def _half_spaces(points: Array) -> Array:
    """Rows (n, o) with n . p <= o inside the convex hull of points: planes of three with all on one side."""
    a, b, c = (points[_TRIPLES[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    normals, a = normals[lengths > 1e-12] / lengths[lengths > 1e-12, None], a[lengths > 1e-12]
    heights = normals @ points.T - np.einsum("ni,ni->n", normals, a)[:, None]
    below, above = (heights < 1e-9).all(axis=1), (heights > -1e-9).all(axis=1)
    outward = np.concatenate([normals[below], -normals[above]])
    return np.column_stack([outward, np.einsum("ni,ni->n", outward, np.concatenate([a[below], a[above]]))])


def _reaches(heights: Array) -> bool:
    """Whether a triangle, given by the heights (3, k) of its corners above k planes, has a part below all of them.

    Heights are affine, so the polygon is clipped in the space of heights itself.
    """
    polygon = list(heights)
    for plane in range(heights.shape[1]):
        kept = []
        for i, point in enumerate(polygon):
            before = polygon[i - 1]
            if (before[plane] > 0) != (point[plane] > 0):
                kept.append(before + (point - before) * before[plane] / (before[plane] - point[plane]))
            if point[plane] <= 0:
                kept.append(point)
        polygon = kept
    return bool(polygon)
