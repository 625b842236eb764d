"""Why a camera does not cover a box; the limits of camera and detector that do not depend on the scene.

The viewing frustum (range of depth and image), and the detector's limits on distance, incidence and size of a box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.knowledge.camera.detector import Detector
from sqrp_cli.knowledge.camera.projection import Projection


class Cause(IntEnum):
    """The first limit that fails, in the order in which the limits are checked; NONE where the box is covered."""

    NONE = 0
    BEHIND = 1
    TOO_NEAR = 2
    TOO_FAR = 3
    OUT_OF_IMAGE = 4
    DETECTOR_NEAR = 5
    DETECTOR_FAR = 6
    OBLIQUE = 7
    TOO_SMALL = 8
    HIDDEN = 9
    SAME_COLOUR = 10
    TOO_DARK = 11
    TOO_BRIGHT = 12

    @property
    def label(self) -> CauseLabel | None:
        """Name in the output, None for a covered box."""
        return None if self is Cause.NONE else cast("CauseLabel", self.name.lower())

    @property
    def words(self) -> str:
        """The cause in words, for sentences and tables."""
        if self is Cause.BEHIND:
            return "behind the camera"
        detector = " for its detector" if self in (Cause.DETECTOR_NEAR, Cause.DETECTOR_FAR) else ""
        return self.name.lower().replace("detector", "too").replace("_", " ") + detector

    def by(self, culprit: str | None) -> str:
        """The cause in words, with the culprit if there is one, or the side of the image."""
        patterns = {
            Cause.HIDDEN: "{} by {}",
            Cause.OUT_OF_IMAGE: "{} ({})",
            Cause.SAME_COLOUR: "{} as {} behind it",
            Cause.TOO_BRIGHT: "{} in the light of {}",
        }
        if culprit is not None:
            patterns[Cause.TOO_DARK] = "{} in the shadow of {}"
        return patterns.get(self, "{}").format(self.words, culprit)


CauseLabel = Literal[
    "behind", "too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small", "hidden",
    "same_colour", "too_dark", "too_bright",
]  # fmt: skip
"""The labels of all causes."""

SIDES = ("left", "right", "top", "bottom")
"""Sides of an image, in the order of their codes."""


@dataclass(frozen=True, eq=False)
class LimitVerdicts:
    """Which limit each of n boxes fails first, for each of c cameras."""

    cause: NDArray[np.int8]
    """Codes of `Cause`, shape (c, n)."""
    side: NDArray[np.int8]
    """Index into `SIDES` where the cause is OUT_OF_IMAGE, else -1, shape (c, n)."""
    figure: Array
    """Amount by which the limit is missed, 0 where none fails, shape (c, n).

    [m] for what lies behind the camera, ranges and distances, [pixels] for image and size, [rad] for the incidence.
    """


class Aspects(NamedTuple):
    """How c cameras face n boxes."""

    distance: Array
    """To the centre of each box, shape (c, n) [m]."""
    incidence: Array
    """Angle between its normal and the direction to the camera, 0 for a box without one, shape (c, n) [rad]."""


def check_limits(
    projections: Sequence[Projection],
    detectors: Sequence[Detector],
    *,
    detector: Indices,
    corners_C: Array,
    normal_C: Array,
) -> LimitVerdicts:
    """Check the limits, in the order of `Cause`, for n boxes, each seen by c cameras.

    Incidence is the angle between a box's normal and the direction from its centre to the camera; size the square root
    of the area of the convex hull of its projected corners.

    detector: which of the detectors looks for each box, shape (n,). corners_C: the boxes' corners in each optical
    frame, shape (3, 8, c, n), coordinate first [m]. normal_C: their unit normals there, shape (3, c, n), zero for a
    box without one.
    """
    # Coordinates and corners first: NumPy is slow at reductions over short trailing axes.
    ranges = [(projection.camera.near, projection.camera.far) for projection in projections]
    near, far = np.array(ranges, dtype=float).T[:, :, None]
    columns = [(*entry.distance, entry.max_incidence) for entry in detectors]
    closest, remotest, widest = np.array(columns, dtype=float).T[:, detector]
    nearest, farthest = corners_C[2].min(axis=0), corners_C[2].max(axis=0)
    in_front = nearest > 0
    image = _images(projections, corners_C, in_front)
    distance, incidence = aspects(corners_C, normal_C)
    smallest = _smallest(projections, detectors, detector, incidence)
    # Each condition is true within the limit, so NaN counts as outside.
    inside = image.inside & (image.outside <= 0)
    rest = np.array([entry.min_visible if entry.judges_rest else np.inf for entry in detectors])[detector]
    cut = image.inside & in_front & (image.outside > 0) & (rest <= 1)
    if cut.any():
        inside[cut] = _within_image(projections, image.uv, cut) >= np.broadcast_to(rest, cut.shape)[cut]
    limits = [
        (Cause.BEHIND, in_front, -nearest),
        (Cause.TOO_NEAR, nearest >= near, near - nearest),
        (Cause.TOO_FAR, farthest <= far, farthest - far),
        (Cause.OUT_OF_IMAGE, inside, np.maximum(image.outside, 0.0)),
        (Cause.DETECTOR_NEAR, distance >= closest, closest - distance),
        (Cause.DETECTOR_FAR, distance <= remotest, distance - remotest),
        (Cause.OBLIQUE, incidence <= widest, incidence - widest),
    ]
    kept = np.logical_and.reduce([within for _, within, _ in limits])
    size = np.sqrt(hull_areas(image.uv[0], image.uv[1], image.extremes, smallest * smallest, kept))
    limits.append((Cause.TOO_SMALL, size >= smallest, smallest - size))
    cause, figure = np.full(distance.shape, np.int8(Cause.NONE)), np.zeros(distance.shape)
    for code, within, missed in reversed(limits):
        cause[~within], figure[~within] = code, missed[~within]
    side = np.where(cause == Cause.OUT_OF_IMAGE, image.beyond.argmax(axis=0), -1).astype(np.int8)
    return LimitVerdicts(cause=cause, side=side, figure=figure)


def _smallest(
    projections: Sequence[Projection], detectors: Sequence[Detector], detector: Indices, incidence: Array
) -> Array:
    """The least sizes of boxes seen by cameras at angles, shape (c, n) or (n,) [pixels]."""
    if not any(entry.is_usual for entry in detectors):
        return np.array([entry.min_pixels for entry in detectors])[detector]
    found = np.empty_like(incidence)
    for index, entry in enumerate(detectors):
        own = detector == index
        for row, projection in enumerate(projections):
            found[row, own] = entry.smallest(projection.camera, incidence[row, own])
    return found


class _Images(NamedTuple):
    """The images of n boxes in c cameras."""

    uv: Array
    """Pixels of the corners, shape (2, 8, c, n)."""
    extremes: Array
    """Those of the corners at the left, right, top and bottom, shape (2, 4, c, n)."""
    beyond: Array
    """By how much these are outside their side of the image, shape (4, c, n) [pixels]."""
    inside: Mask
    """Whether the lens shows all corners, shape (c, n)."""
    outside: Array
    """By how much the furthest of them is outside, negative if it is inside, shape (c, n) [pixels]."""


def _images(projections: Sequence[Projection], corners_C: Array, in_front: Mask) -> _Images:
    """The images of boxes with corners (3, 8, c, n); of those that are not in front, of a point instead."""
    plane = np.where(in_front, corners_C[:2] / np.where(in_front, corners_C[2], 1.0), 0.0)
    inside = bend(projections, plane)
    uv = to_pixels(projections, plane)
    u, v = uv[0], uv[1]
    extremes = entries_at((u, v), (u.argmin(axis=0), u.argmax(axis=0), v.argmin(axis=0), v.argmax(axis=0)))
    sizes = [(projection.camera.width, projection.camera.height) for projection in projections]
    width, height = np.array(sizes, dtype=float).T[:, :, None]
    beyond = np.stack(
        [-0.5 - extremes[0, 0], extremes[0, 1] - (width - 0.5), -0.5 - extremes[1, 2], extremes[1, 3] - (height - 0.5)]
    )
    return _Images(uv, extremes, beyond, inside, beyond.max(axis=0))


def cut_by_image(projection: Projection, corners_C: Array) -> Array:
    """The shares of the images of boxes with corners (3, 8, n) in front of a camera that its edges cut off, (n,)."""
    image = _images([projection], corners_C[:, :, None], np.ones((1, corners_C.shape[2]), dtype=bool))
    found, cut = np.zeros(corners_C.shape[2]), image.outside > 0
    found[cut[0]] = 1.0 - _within_image([projection], image.uv, cut)
    return found


def _within_image(projections: Sequence[Projection], uv: Array, some: Mask) -> Array:
    """The shares of the images of some of the boxes (c, n), k in all, that cameras show, shape (k,).

    uv: pixels of the corners of all, shape (2, 8, c, n).
    """
    sizes = np.array([(projection.camera.width, projection.camera.height) for projection in projections], dtype=float)
    size = sizes[np.nonzero(some)[0]].T
    points = uv[:, :, some] - 0.5 * (size - 1.0)[:, None]
    whole = exact_hull_areas(*points)
    for axis in (0, 0, 1, 1):
        points = -_cut(points, axis, 0.5 * size[axis])
    return np.divide(exact_hull_areas(*points), whole, out=np.zeros_like(whole), where=whole > 0)


def _cut(points: Array, axis: int, limit: Array) -> Array:
    """Points (2, p + 2, n) whose hulls are those of points (2, p, n) as far as these reach along an axis, limit: (n,).

    Along the limit a hull ends where the outermost of all lines from a point within to one beyond meet it.
    """
    along, across = points[axis], points[1 - axis]
    beyond = along > limit
    crosses = ~beyond[:, None] & beyond
    share = (limit - along[:, None]) / np.where(crosses, along - along[:, None], 1.0)
    met = across[:, None] + share * (across - across[:, None])
    ends = np.where(crosses, met, np.inf).min(axis=(0, 1)), np.where(crosses, met, -np.inf).max(axis=(0, 1))
    low, high = (np.where(np.isfinite(end), end, across[0]) for end in ends)
    edge = np.where(beyond.any(axis=0), limit, along[0])
    cut = np.vstack([np.where(beyond, limit, along), edge, edge]), np.vstack([np.where(beyond, low, across), low, high])
    return np.stack(cut if axis == 0 else cut[::-1])


def aspects(corners_C: Array, normal_C: Array) -> Aspects:
    """How cameras face boxes; corners_C, normal_C: as `check_limits` wants them."""
    center = corners_C.mean(axis=1)
    distance = np.sqrt((center * center).sum(axis=0))
    incidence = np.zeros_like(distance)
    if normal_C.any():
        cosine = -(normal_C * center).sum(axis=0) / np.maximum(distance, 1e-12)
        incidence = np.where(normal_C.any(axis=0), np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)
    return Aspects(distance, incidence)


def bend(projections: Sequence[Projection], plane: Array) -> Mask:
    """Distort corners (2, 8, c, n) in the plane z = 1 of each camera, in place; which boxes (c, n) the lens shows."""
    inside = np.ones(plane.shape[2:], dtype=bool)
    for number, projection in enumerate(projections):
        if projection.camera.distortion_model != "none":
            bent, within = projection.bent(np.moveaxis(plane[:, :, number], 0, -1))
            plane[:, :, number], inside[number] = np.moveaxis(bent, -1, 0), within.all(axis=0)
    return inside


def to_pixels(projections: Sequence[Projection], plane: Array) -> Array:
    """Pixels u and v, shape (2, 8, c, n), of distorted corners in the plane z = 1 of each camera."""
    K = np.stack([projection.camera.matrix[:2] for projection in projections])
    rows = np.moveaxis(K, 0, -1)[:, :, :, None]
    return np.stack([row[0] * plane[0] + row[1] * plane[1] + row[2] for row in rows])


def entries_at(values: Sequence[Array], corners: Sequence[NDArray[np.intp]]) -> Array:
    """The values (8, ...) at some of the corners of each box, given by index (...), shape (values, corners, ...)."""
    shape = corners[0].shape
    at = np.stack([corner.reshape(-1) for corner in corners])
    at *= at.shape[1]
    at += np.arange(at.shape[1])
    return np.stack([entry.reshape(-1).take(at) for entry in values]).reshape(len(values), len(corners), *shape)


def hull_areas(u: Array, v: Array, extremes: Array, enough: Array, asked: Mask | None = None) -> Array:
    """Areas of the convex hulls of points (8, c, n), exact where `asked` (c, n; None: all) and below `enough`.

    enough: shape (c, n), or one that is broadcast to it. Elsewhere it is a bound from below. The four extreme points
    along the axes (left, right, top, bottom; shape (2, 4, c, n)) span a quadrilateral inside the hull, which decides
    nearly every box far from the limit.
    """
    across, down = extremes[:, 1] - extremes[:, 0], extremes[:, 3] - extremes[:, 2]
    areas: Array = 0.5 * np.abs(across[0] * down[1] - across[1] * down[0])
    near = areas < enough if asked is None else asked & (areas < enough)
    if near.any():
        areas[near] = exact_hull_areas(u[:, near], v[:, near])
    return areas


def exact_hull_areas(u: Array, v: Array) -> Array:
    """Areas (n,) of the convex hulls of points with coordinates (p, n) each, by Andrew's monotone chain.

    All hulls grow together, point by point; an area is a sum of triangles with the first point.
    """
    points = np.stack([u - u[0], v - v[0]])
    points = np.take_along_axis(points, np.lexsort(points[::-1], axis=0)[None], axis=1)
    every = np.arange(points.shape[2])
    area = np.zeros(len(every))
    for chain in (points, points[:, ::-1]):
        hull, last = chain.copy(), np.zeros(len(every), dtype=np.int64)
        for point in chain.swapaxes(0, 1)[1:]:
            end = hull[:, last, every]
            while (inward := (last > 0) & (_turn(hull[:, last - 1, every], end, point) <= 0)).any():
                last -= inward
                end = hull[:, last, every]
            last += 1
            hull[:, last, every] = point
        after = np.arange(1, len(points[0]))[:, None] <= last
        area += 0.5 * ((hull[0, :-1] * hull[1, 1:] - hull[1, :-1] * hull[0, 1:]) * after).sum(axis=0)
    return area


def _turn(origin: Array, first: Array, second: Array) -> Array:
    """Twice the signed area of triangles with corners (2, n)."""
    turn: Array = (first[0] - origin[0]) * (second[1] - origin[1]) - (first[1] - origin[1]) * (second[0] - origin[0])
    return turn


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
