"""From pixels back to directions: the inverse of a camera's projection, distortion included."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.projection import ImagePoints, Projection

CLOSE = 1e-2
"""Greatest distance of a projected direction from its pixel [pixels]."""

_ITERATIONS = 25
_STEP = 1e-5


class SeenDirections(NamedTuple):
    """Where pixels look."""

    rays: Array
    """Unit vectors in the optical frame, shape (n, 3)."""
    shown: NDArray[np.bool_]
    """Whether the lens shows any direction there, shape (n,)."""


def directions(projection: Projection, pixels: Array) -> SeenDirections:
    """The directions that are seen at pixels of shape (n, 2).

    Found by Newton's method from the point without distortion.
    """
    K = projection.camera.matrix
    plane = (pixels - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T
    if projection.camera.distortion_model == "none":
        return SeenDirections(_unit(plane), np.ones(len(plane), dtype=bool))
    length = np.linalg.norm(plane, axis=1, keepdims=True)
    plane = plane * np.minimum(1.0, 0.98 * projection.radius / np.maximum(length, 1e-12))
    for _ in range(_ITERATIONS):
        error = _seen_at(projection, plane)[0] - pixels
        slopes = [(_seen_at(projection, plane + step)[0] - pixels - error) / _STEP for step in np.eye(2) * _STEP]
        (a, c), (b, d) = (slope.T for slope in slopes)
        determinant = a * d - b * c
        safe = np.where(np.abs(determinant) > 1e-9, determinant, np.inf)
        change = np.column_stack([d * error[:, 0] - b * error[:, 1], a * error[:, 1] - c * error[:, 0]]) / safe[:, None]
        plane = plane - change
        length = np.linalg.norm(plane, axis=1, keepdims=True)
        plane = plane * np.minimum(1.0, 0.9999 * projection.radius / np.maximum(length, 1e-12))
        if float(np.abs(change).max(initial=0.0)) < _STEP:
            break
    found, inside = _seen_at(projection, plane)
    return SeenDirections(_unit(plane), inside & (np.abs(found - pixels).max(axis=1, initial=0.0) < CLOSE))


def _seen_at(projection: Projection, plane: Array) -> ImagePoints:
    return projection.pixels(np.column_stack([plane, np.ones(len(plane))]))


def _unit(plane: Array) -> Array:
    points = np.column_stack([plane, np.ones(len(plane))])
    unit: Array = points / np.linalg.norm(points, axis=1, keepdims=True)
    return unit
