"""The limits of camera and detector that need no scene: range, image, distance, angle and size of a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.knowledge.projection import Projection
from sqrp_cli.programming.sensing.cause import Cause

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, eq=False)
class LimitVerdicts:
    """Which limit a box fails first, per camera and state, each array of shape (c, m).

    cause: codes of `Cause`. side: index into `SIDES` where the cause is OUT_OF_IMAGE, else -1. figure: by how much the
    limit is missed: [m] for ranges and distances, [pixels] for image and size, [rad] for the angle; 0 where none fails.
    """

    cause: NDArray[np.int8]
    side: NDArray[np.int8]
    figure: Array


def check_limits(
    projections: Sequence[Projection], detector: Detector, corners_C: Array, normal_C: Array | None
) -> LimitVerdicts:
    """Check the limits, in the order of `Cause`, for a box seen by c cameras in m states.

    corners_C: the box's corners in each optical frame, shape (c, m, 8, 3) [m]. normal_C: its unit normal there, shape
    (c, m, 3), or None for a box without one.
    """
    width, height, near, far = (
        np.array([[float(getattr(projection.camera, name))] for projection in projections])
        for name in ("width", "height", "near", "far")
    )
    # Corners first: NumPy is slow at reductions over short trailing axes.
    depth = _corners_first(corners_C[..., 2])
    nearest, farthest = depth.min(axis=0), depth.max(axis=0)
    in_front = nearest > 0

    ahead = np.where(in_front[..., None, None], corners_C, (0.0, 0.0, 1.0))
    seen = [projection.pixels(points) for projection, points in zip(projections, ahead, strict=True)]
    inside = _corners_first(np.stack([within for _, within in seen])).all(axis=0)
    pixels = np.stack([places for places, _ in seen])
    u, v = _corners_first(pixels[..., 0]), _corners_first(pixels[..., 1])
    beyond = np.stack(
        [-0.5 - u.min(axis=0), u.max(axis=0) - (width - 0.5), -0.5 - v.min(axis=0), v.max(axis=0) - (height - 0.5)]
    )
    outside = beyond.max(axis=0)

    center = corners_C.mean(axis=2)
    distance = np.sqrt(np.einsum("cmi,cmi->cm", center, center))
    size = np.sqrt(_hull_areas(u, v, detector.min_pixels**2))
    incidence = np.zeros_like(distance)
    if normal_C is not None:
        cosine = -np.einsum("cmi,cmi->cm", normal_C, center) / np.maximum(distance, 1e-12)
        incidence = np.arccos(np.clip(cosine, -1.0, 1.0))

    fails = [
        (Cause.TOO_NEAR, ~in_front | (nearest < near), near - nearest),
        (Cause.TOO_FAR, farthest > far, farthest - far),
        (Cause.OUT_OF_IMAGE, (outside > 0) | ~inside, np.maximum(outside, 0.0)),
        (Cause.DETECTOR_NEAR, distance < detector.distance[0], detector.distance[0] - distance),
        (Cause.DETECTOR_FAR, distance > detector.distance[1], distance - detector.distance[1]),
        (Cause.OBLIQUE, incidence > detector.max_incidence, incidence - detector.max_incidence),
        (Cause.TOO_SMALL, size < detector.min_pixels, detector.min_pixels - size),
    ]
    cause, figure = np.full(distance.shape, np.int8(Cause.NONE)), np.zeros(distance.shape)
    for code, failed, missed in reversed(fails):
        cause[failed], figure[failed] = code, missed[failed]
    side = np.where(cause == Cause.OUT_OF_IMAGE, beyond.argmax(axis=0), -1).astype(np.int8)
    return LimitVerdicts(cause, side, figure)


def _corners_first(values: NDArray[Scalar]) -> NDArray[Scalar]:
    """Values (c, m, 8) of corners as a contiguous array of shape (8, c, m)."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))


def _hull_areas(u: Array, v: Array, enough: float) -> Array:
    """Areas of the convex hulls of points (n, ...), exact where below `enough`, elsewhere a lower bound above it.

    The four extreme points along the axes span a quadrilateral inside the hull, which settles nearly every box that is
    far from the limit.
    """
    left, top, right, bottom = ([points.argmin(0), points.argmax(0)][end] for end in (0, 1) for points in (u, v))

    def span(values: Array, first: NDArray[np.intp], second: NDArray[np.intp]) -> Array:
        ends = [np.take_along_axis(values, corner[None], axis=0)[0] for corner in (first, second)]
        difference: Array = ends[1] - ends[0]
        return difference

    areas: Array = 0.5 * np.abs(
        span(u, left, right) * span(v, top, bottom) - span(v, left, right) * span(u, top, bottom)
    )
    for row in np.argwhere(areas < enough):
        at = (slice(None), *row)
        areas[at[1:]] = hull_area(np.column_stack([u[at], v[at]]))
    return areas


def hull_area(points: Array) -> float:
    """Area of the convex hull of points (n, 2), by the shoelace formula."""
    hull = convex_hull(points)
    return 0.5 * abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(hull, hull[1:] + hull[:1], strict=True)))


def convex_hull(points: Array) -> list[tuple[float, float]]:
    """The corners of the convex hull of points (n, 2) in order, by Andrew's monotone chain."""
    ordered = sorted(map(tuple, points.tolist()))
    hull: list[tuple[float, float]] = []
    for chain in (ordered, ordered[::-1]):
        start = len(hull)
        for point in chain:
            while len(hull) - start >= 2 and _cross(hull[-2], hull[-1], point) <= 0:
                hull.pop()
            hull.append(point)
        hull.pop()
    return hull


def _cross(origin: tuple[float, float], first: tuple[float, float], second: tuple[float, float]) -> float:
    return (first[0] - origin[0]) * (second[1] - origin[1]) - (first[1] - origin[1]) * (second[0] - origin[0])
