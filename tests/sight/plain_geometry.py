"""Half spaces, polygons, triangles and rays, said plainly: what the judges of sight are made of."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from sqrp_cli.geometry import Array, inverse, transform


def half_spaces(points: Array) -> list[tuple[Array, float]]:
    """Those of a convex hull: (n, o) of the points n . p <= o."""
    return [(one[:3], -one[3]) for one in ConvexHull(points).equations]


def near(triangles: Array, spaces: Sequence[tuple[Array, float]]) -> Array:
    """Those of triangles (f, 3, 3) that are not wholly beyond one plane."""
    for n, o in spaces:
        triangles = triangles[(triangles @ n <= o).any(axis=1)]
    return triangles


def cut(polygon: Sequence[Array], spaces: Sequence[tuple[Array, float]]) -> list[Array]:
    for n, o in spaces:
        rest: list[Array] = []
        for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
            p, q = a @ n - o, b @ n - o
            if p <= 0:
                rest.append(a)
            if (p > 0) != (q > 0):
                rest.append(a + p / (p - q) * (b - a))
        polygon = rest
    return list(polygon)


def hits(eye: Array, rays: Array, triangles: Array, begins: ArrayLike = 0.0, ends: ArrayLike = inf) -> Array:
    """The least factor of each ray (r, 3), from where it begins to where it ends, at which it meets a triangle, or inf.

    A ray meets the plane of a triangle in u a + v b + w c of the corners, seen from the eye, with u + v + w = 1, and
    the triangle if none of them is negative. They are in proportion to the ray's products with b x c, c x a and a x b.
    """
    a, b, c = np.moveaxis(triangles - eye, 1, 0)
    u, v, w = (rays @ np.cross(*two).T for two in ((b, c), (c, a), (a, b)))
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (a * np.cross(b, c)).sum(axis=1) / (u + v + w)
    low, high = (np.reshape(limit, (-1, 1)) for limit in (begins, ends))
    met = (u * v >= 0) & (u * w >= 0) & (v * w >= 0) & (u + v + w != 0) & (low < at) & (at < high)
    return np.where(met, at, inf).min(axis=1, initial=inf)


def through_box(eye: Array, rays: Array, X_WB: Array, half: Array, middle: Array) -> tuple[Array, Array]:
    """The factors of rays at which they enter and leave a box."""
    start = transform(inverse(X_WB), eye[None])[0] - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = [(s * half - start)[:, None] / (X_WB[:3, :3].T @ rays.T) for s in (-1, 1)]
    return np.fmax.reduce(np.fmin(low, high)), np.fmin.reduce(np.fmax(low, high))
