"""What OpenCV does for us: colours, outlines, markers and image files. The only module of perception that knows it."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.colors import COLORS

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

HUE_TOLERANCE = 12
"""How far a hue may be from that of the paint, in OpenCV's units of two degrees."""

LEAST_SATURATION, LEAST_VALUE = 90, 40
"""Below these (of 255) a pixel counts as grey or black, not as coloured."""

cv2.setNumThreads(1)  # one process per core looks at images already


@dataclass(frozen=True, eq=False)
class FoundMarker:
    """An ArUco marker in an image; corners [pixels], shape (4, 2)."""

    id: int
    corners: Array


@dataclass(frozen=True, eq=False)
class Blob:
    """A connected patch of pixels: how many, and their mean (x, y) [pixels]."""

    area: int
    center: Array


def hue_of(color: str) -> int | None:
    """OpenCV's hue (0 to 179) of a colour's name; None for a name without a hue."""
    if color.lower() not in COLORS:
        return None
    hue, saturation, _ = colorsys.rgb_to_hsv(*COLORS[color.lower()])
    return None if saturation < 0.3 else round(hue * 180) % 180


def color_mask(image: Image, color: str) -> Mask:
    """Where an image has a colour."""
    hue = hue_of(color)
    if hue is None:
        return np.zeros(image.shape[:2], dtype=bool)
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    first, last = hue - HUE_TOLERANCE, hue + HUE_TOLERANCE
    mask = np.zeros(image.shape[:2], dtype=bool)
    for turn in (-180, 0, 180):  # hues go round
        low, high = max(first + turn, 0), min(last + turn, 179)
        if low <= high:
            mask |= cv2.inRange(hsv, (low, LEAST_SATURATION, LEAST_VALUE), (high, 255, 255)) > 0
    return mask


def alike(first: Image, second: Image, tolerance: int) -> Mask:
    """Where two images of the same size differ by at most a tolerance in every channel."""
    same: Mask = cv2.inRange(cv2.absdiff(first, second), (0, 0, 0), (tolerance,) * 3) > 0
    return same


def convex_outline(points: Array) -> Array:
    """The convex hull of points (n, 2) as a polygon."""
    outline: Array = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    return outline


def area_of(polygon: Array) -> float:
    """Area of a polygon (n, 2)."""
    return float(cv2.contourArea(polygon.astype(np.float32)))


_SUBPIXEL = 4
"""Fractional bits of polygon corners."""

Corners = NDArray[np.int32]
"""Corners of polygons in sixteenths of a pixel."""


def corners_of(polygons: Array) -> Corners:
    """Polygons (..., 2) [pixels] as `filled` wants them."""
    corners: Corners = np.round(polygons * 2**_SUBPIXEL).clip(-(2**24), 2**24).astype(np.int32)
    return corners


def filled(shape: tuple[int, int], origin: tuple[int, int], polygons: Iterable[Corners]) -> Mask:
    """The pixels of a crop, `origin` (x, y) its first one, that convex polygons cover.

    polygons: (n, 2) each, or several with as many corners at once, (p, n, 2).
    """
    canvas = np.zeros(shape, dtype=np.uint8)
    first = np.array(origin, dtype=np.int32) << _SUBPIXEL
    for corners in polygons:
        if corners.ndim == 2:
            cv2.fillConvexPoly(canvas, corners - first, 1, cv2.LINE_8, _SUBPIXEL)
            continue
        pixels = (corners - first + (1 << _SUBPIXEL - 1)) >> _SUBPIXEL
        spans = np.ptp(pixels, axis=1)
        # Most of a fine mesh covers a pixel, or two in a row or column: those of its corners, and nothing in between.
        tiny = (spans.max(axis=1) <= 1) & (spans.min(axis=1) == 0)
        columns, rows = pixels[tiny].reshape(-1, 2).T
        inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
        canvas[rows[inside], columns[inside]] = 1
        for polygon in corners[~tiny] - first:
            cv2.fillConvexPoly(canvas, polygon, 1, cv2.LINE_8, _SUBPIXEL)
    return canvas.astype(bool)


def middle(mask: Mask) -> Array:
    """Mean (x, y) of the pixels of a mask that has some."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def dilated(mask: Mask, pixels: int) -> Mask:
    """A mask made wider by some pixels on every side."""
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), dtype=np.uint8)
    grown: Mask = cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)
    return grown


def inpainted(image: Image, missing: Mask) -> Image:
    """The image with a guess, from what is around, at its missing pixels."""
    restored: Image = cv2.inpaint(image, missing.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    return restored


def blobs(mask: Mask) -> list[Blob]:
    """The connected patches of a mask, largest first."""
    count, _, stats, centers = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    found = [Blob(int(stats[i, cv2.CC_STAT_AREA]), centers[i]) for i in range(1, count)]
    return sorted(found, key=lambda blob: (-blob.area, *blob.center.tolist()))


def find_markers(image: Image) -> list[FoundMarker]:
    """The ArUco markers in an image, by id."""
    corners, ids, _ = _marker_detector().detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    if ids is None:
        return []
    # OpenCV's corners are those of pixels' edges, half a pixel off from their centres.
    found = [FoundMarker(int(i), c[0].astype(float)) for i, c in zip(ids.ravel(), corners, strict=True)]
    return sorted(found, key=lambda marker: marker.id)


@cache
def _marker_detector() -> Any:  # noqa: ANN401
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.perspectiveRemovePixelPerCell = 8  # the default, 4, misses one in twenty of the smallest
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def direction(camera: Camera, pixel: Array) -> Array:
    """The unit vector, in the optical frame, of the ray that a pixel (2,) sees."""
    K, D = np.array(camera.matrix), np.array(camera.distortion)
    point = np.asarray(pixel, dtype=float).reshape(1, 1, 2)
    if camera.distortion_model == "equidistant":
        plane = cv2.fisheye.undistortPoints(point, K, D)
    else:
        plane = cv2.undistortPoints(point, K, D if len(D) else None)
    ray = np.array([*plane.ravel(), 1.0])
    unit: Array = ray / np.linalg.norm(ray)
    return unit


def png_of(image: Image) -> bytes:
    """An image as a PNG file."""
    _, content = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return bytes(content)


def decoded(content: bytes) -> Image | None:
    """The image of an image file's content, in eight bits and without transparency; None if it is damaged."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    return None if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def drawn(image: Image, outlines: Iterable[tuple[Array, tuple[int, int, int]]], text: str) -> Image:
    """A copy of an image with polygons (n, 2) in their colours, and a line of text."""
    canvas = image.copy()
    for polygon, color in outlines:
        if len(polygon):
            cv2.polylines(canvas, [corners_of(polygon)], True, color, 2, cv2.LINE_AA, _SUBPIXEL)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(canvas, text, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


def resized(image: Image, width: int, height: int) -> Image:
    """An image in another size."""
    smaller: Image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return smaller


class Video:
    """An MPEG-4 file that images are appended to."""

    def __init__(self, path: Path, rate: float) -> None:
        """rate: images per second."""
        self._path, self._rate = path, rate
        self._writer: Any = None
        self._count = 0

    def add(self, image: Image) -> None:
        """Append an image; all have the same size."""
        if self._writer is None:
            size = (image.shape[1], image.shape[0])
            self._writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), self._rate, size)
        self._count += 1
        self._writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))

    def close(self) -> bool:
        """Finish the file; returns whether all images are in it, which the writer does not say."""
        if self._writer is not None:
            self._writer.release()
        return round(cv2.VideoCapture(str(self._path)).get(cv2.CAP_PROP_FRAME_COUNT)) == self._count
