"""The limits of camera and detector that need no scene: range, image, distance, angle and size of a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.projection import Projection


@dataclass(frozen=True, eq=False)
class LimitVerdicts:
    """Which limit a box fails first, per state.

    cause: codes of `Cause`, shape (m,). side: index into `SIDES` where the cause is OUT_OF_IMAGE, else -1, shape (m,).
    figure: by how much the limit is missed, shape (m,): [m] for ranges and distances, [pixels] for image and size,
    [rad] for the angle; 0 where no limit fails.
    """

    cause: NDArray[np.int8]
    side: NDArray[np.int8]
    figure: Array


def check_limits(projection: Projection, detector: Detector, corners_C: Array, normal_C: Array | None) -> LimitVerdicts:
    """Check the limits of DESIGN order for boxes seen by one camera.

    corners_C: the box's 8 corners in the optical frame, shape (m, 8, 3) [m].
    normal_C: unit normal of the box in the optical frame, shape (m, 3), or None for a box without one.
    """
    camera = projection.camera
    depth = corners_C[..., 2]
    nearest, farthest = depth.min(axis=1), depth.max(axis=1)
    in_front = nearest > 0

    pixels, inside = projection.pixels(np.where(in_front[:, None, None], corners_C, (0.0, 0.0, 1.0)))
    u, v = pixels[..., 0], pixels[..., 1]
    beyond = np.stack([-0.5 - u, u - (camera.width - 0.5), -0.5 - v, v - (camera.height - 0.5)], axis=-1).max(axis=1)
    side = beyond.argmax(axis=1)
    outside = beyond.max(axis=1)

    center = corners_C.mean(axis=1)
    distance = np.linalg.norm(center, axis=1)
    size = np.sqrt(_hull_areas(pixels, detector.min_pixels**2))
    incidence = np.zeros(len(depth))
    if normal_C is not None:
        cosine = -np.einsum("mi,mi->m", normal_C, center) / np.maximum(distance, 1e-12)
        incidence = np.arccos(np.clip(cosine, -1.0, 1.0))

    fails = [
        (Cause.TOO_NEAR, ~in_front | (nearest < camera.near), camera.near - nearest),
        (Cause.TOO_FAR, farthest > camera.far, farthest - camera.far),
        (Cause.OUT_OF_IMAGE, (outside > 0) | ~inside.all(axis=1), np.maximum(outside, 0.0)),
        (Cause.DETECTOR_NEAR, distance < detector.distance[0], detector.distance[0] - distance),
        (Cause.DETECTOR_FAR, distance > detector.distance[1], distance - detector.distance[1]),
        (Cause.OBLIQUE, incidence > detector.max_incidence, incidence - detector.max_incidence),
        (Cause.TOO_SMALL, size < detector.min_pixels, detector.min_pixels - size),
    ]
    conditions = [failed for _, failed, _ in fails]
    cause = np.select(conditions, [np.int8(code) for code, _, _ in fails], np.int8(Cause.NONE))
    figure = np.select(conditions, [missed for _, _, missed in fails], 0.0)
    return LimitVerdicts(cause, np.where(cause == Cause.OUT_OF_IMAGE, side, -1).astype(np.int8), figure)


def _hull_areas(points: Array, enough: float) -> Array:
    """Areas of the convex hulls of point sets (m, n, 2), exact where below `enough`, elsewhere a lower bound above it.

    The four extreme points along the axes span a quadrilateral inside the hull, which settles nearly every box that is
    far from the limit.
    """
    extremes = np.stack(
        [points[..., 0].argmin(1), points[..., 1].argmin(1), points[..., 0].argmax(1), points[..., 1].argmax(1)], axis=1
    )
    quad = np.take_along_axis(points, extremes[..., None], axis=1)
    first, second = quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1]
    areas: Array = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    for row in np.flatnonzero(areas < enough):
        areas[row] = hull_area(points[row])
    return areas


def hull_area(points: Array) -> float:
    """Area of the convex hull of points (n, 2), by Andrew's monotone chain and the shoelace formula."""
    ordered = sorted(map(tuple, points.tolist()))
    hull: list[tuple[float, float]] = []
    for chain in (ordered, ordered[::-1]):
        start = len(hull)
        for point in chain:
            while len(hull) - start >= 2 and _cross(hull[-2], hull[-1], point) <= 0:
                hull.pop()
            hull.append(point)
        hull.pop()
    return 0.5 * abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(hull, hull[1:] + hull[:1], strict=True)))


def _cross(origin: tuple[float, float], first: tuple[float, float], second: tuple[float, float]) -> float:
    return (first[0] - origin[0]) * (second[1] - origin[1]) - (first[1] - origin[1]) * (second[0] - origin[0])
