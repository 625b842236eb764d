"""What OpenCV does for us: colours, outlines and markers. The only module of perception that knows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from operator import itemgetter
from typing import Any, TypeAlias

import cv2
import numpy as np

from sqrp_cli.camera.detector import ALIKE
from sqrp_cli.camera.light import HUE_TOLERANCE, HUES, LEAST_SEEN_SATURATION, LEAST_VALUE, hue_of
from sqrp_cli.camera.markers import ORIGINAL, opencv_name
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.run.image import SUBPIXEL, Corners, ImageArray

cv2.setNumThreads(1)  # one process per core looks at images already


FoundMarker: TypeAlias = tuple[int, Array]
"""The id of an ArUco marker in an image, and its corners [pixels], shape (4, 2)."""
Crop: TypeAlias = tuple[slice, slice]  # The rows and columns of a part of an image; indexes it


def color_mask(image: ImageArray, color: str) -> Mask:
    """Where an image has a colour."""
    hue = hue_of(color)
    if hue is None:
        return np.zeros(image.shape[:2], dtype=bool)
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    saturation, value = (round(255 * least) for least in (LEAST_SEEN_SATURATION, LEAST_VALUE))
    first, last = hue - HUE_TOLERANCE, hue + HUE_TOLERANCE
    mask = np.zeros(image.shape[:2], dtype=bool)
    for turn in (-HUES, 0, HUES):  # hues go round
        low, high = max(first + turn, 0), min(last + turn, HUES - 1)
        if low <= high:
            mask |= cv2.inRange(hsv, (low, saturation, value), (high, 255, 255)) > 0
    return mask


def same_color(first: ImageArray, second: ImageArray, tolerance: int, share: float | None = None) -> Mask:
    """Where two images of the same size differ by at most a tolerance in every channel.

    With a share also where the first shows what the second does in brighter or darker light, every channel in
    proportion: it may then differ by a share of its brightest channel and a quarter of the tolerance.
    """
    same: Mask = cv2.inRange(cv2.absdiff(first, second), (0, 0, 0), (tolerance,) * 3) > 0
    if share is not None:
        one, other = first.astype(np.float32), second.astype(np.float32)
        factor = (one * other).sum(axis=2) / np.maximum((other * other).sum(axis=2), 1.0)
        off = np.abs(one - factor[..., None] * other).max(axis=2)
        same |= off <= share * one.max(axis=2) + tolerance / 4
    return same


def convex_outline(points: Array) -> Array:
    """The convex hull of points (n, 2) as a polygon."""
    outline: Array = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    return outline


def area_of(polygon: Array) -> float:
    """Area of a polygon (n, 2)."""
    return float(cv2.contourArea(polygon.astype(np.float32)))


def filled(crop: Crop, polygons: Iterable[Corners]) -> Mask:
    """The pixels of a crop that convex polygons cover.

    polygons: (n, 2) each, or several with as many corners at once, (p, n, 2).
    """
    rows, columns = crop
    canvas = np.zeros((rows.stop - rows.start, columns.stop - columns.start), dtype=np.uint8)
    first = np.array([columns.start, rows.start], dtype=np.int32) << SUBPIXEL
    for corners in polygons:
        for polygon in corners.reshape(-1, *corners.shape[-2:]) - first:
            cv2.fillConvexPoly(canvas, polygon, 1, cv2.LINE_8, SUBPIXEL)
    return canvas.astype(bool)


def displacement(shown: Mask, judged: Mask, expected: Callable[[int], Mask], reaches: Sequence[int]) -> Array:
    """By how much (x, y) something lies beside where it is expected, (2,) [pixels].

    shown: where it is seen, shape (h, w). judged: where it would be seen if it were there, (h, w). expected: its
    silhouette, with a margin on every side by which it may lie beside it, one of some rising reaches. The first reach
    counts that does not end where it lies, so that what is alike further away does not matter where something nearer
    explains the image. Of all that explains which of the judged pixels show it, but for a share `ALIKE` of the
    silhouette as far as it is judged, it is the least.
    """
    least = np.zeros(2)
    score = np.where(judged, np.where(shown, -1.0, 1.0), 0.0).astype(np.float32)
    for reach in reaches:
        silhouette = expected(reach)
        wrong = cv2.matchTemplate(silhouette.astype(np.float32), score, cv2.TM_CCORR)
        down, right = ((size - 1) // 2 for size in wrong.shape)
        there = silhouette[down : down + shown.shape[0], right : right + shown.shape[1]] & judged
        rows, columns = np.nonzero(wrong <= wrong.min() + ALIKE * float(there.sum()))
        steps = np.stack([right - columns, down - rows], axis=1)
        least = steps[np.hypot(*steps.T).argmin()].astype(float)
        if np.abs(least).max() < reach:
            break
    return least


def dilated(mask: Mask, pixels: int) -> Mask:
    """A mask made wider by some pixels on every side."""
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), dtype=np.uint8)
    grown: Mask = cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)
    return grown


def inpainted(image: ImageArray, missing: Mask) -> ImageArray:
    """The image with a guess, from what is around, at its missing pixels."""
    restored: ImageArray = cv2.inpaint(image, missing.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    return restored


def largest_blob(mask: Mask) -> tuple[int, Array] | None:
    """How many pixels the largest connected patch of a mask has, if there is any, and their mean (x, y).

    Of equal ones it is that furthest to the left, then up.
    """
    patches = mask.astype(np.uint8)
    left, top, width, height = cv2.boundingRect(patches)  # around all of them: hardly any of the image
    patches = patches[top : top + height, left : left + width]
    if not patches.size:
        return None
    _, _, stats, centers = cv2.connectedComponentsWithStats(patches, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA, None]
    centers = (np.rint(centers[1:] * areas) + areas * (left, top)) / areas  # as of the whole: sums of whole numbers
    return min(zip(areas[:, 0].tolist(), centers, strict=True), key=lambda blob: (-blob[0], *blob[1].tolist()))


def find_markers(image: ImageArray, dictionary: str = ORIGINAL, beside: Mask | None = None) -> list[FoundMarker]:
    """The markers of a dictionary in an image, by id.

    beside: known parts that may cover some of a marker's margin, or a line of its black square. A dark part that
    touches the square makes the two one shape, which is no square: so it is taken for margin.
    """
    if beside is not None:
        painted = image.copy()
        painted[beside] = np.percentile(image, BRIGHT)
        image = painted
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    framed = cv2.copyMakeBorder(grey, _FRAME, _FRAME, _FRAME, _FRAME, cv2.BORDER_CONSTANT, value=255)
    corners, ids, _ = _marker_detector(dictionary).detectMarkers(framed)
    if ids is None:
        return []
    # OpenCV's corners are those of pixels' edges, half a pixel off from their centres.
    found = ((int(i), c[0].astype(float) - _FRAME) for i, c in zip(ids.ravel(), corners, strict=True))
    return sorted(found, key=itemgetter(0))


_FRAME = 8  # Width of a white frame around the image [pixels]: the margin of a marker at the edge
BRIGHT = 90  # Percentile of the pixels around a marker that is as bright as its margin


@cache
def _marker_detector(name: str) -> Any:  # noqa: ANN401
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.minDistanceToBorder = 0  # the default, 3, misses what is whole, but at the edge of the image
    parameters.perspectiveRemovePixelPerCell = 8  # the default, 4, misses one in twenty of the smallest
    return cv2.aruco.ArucoDetector(dictionary, parameters)
