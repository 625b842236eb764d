"""From what a pinhole camera sees to the image of a calibrated one: exact intrinsics, with lens distortion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera

_WIDEST = np.tan(np.radians(80.0))
"""Largest distance from the optical axis in the plane z = 1 that is drawn; beyond it images stay black."""

_MOST_PIXELS = 2048
"""Largest width and height of a drawn picture."""


_BAND = 1_000_000
"""Pixels whose distortion is undone at once."""


@dataclass(frozen=True, eq=False)
class Optics:
    """How to draw the image of a camera.

    low, high: the window of the plane z = 1 that is drawn, (x, y) of its upper left and lower right corner. width,
    height: of the picture of that window [pixels]. maps: for each pixel of the image where it is in the picture, x and
    y, shape (height, width) of the image; None where the picture is the image.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    width: int
    height: int
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None

    @classmethod
    def of(cls, camera: Camera) -> Optics:
        """The optics of a camera: the picture is as fine as the image is in its middle."""
        fx, fy = float(camera.matrix[0, 0]), float(camera.matrix[1, 1])
        cx, cy = float(camera.matrix[0, 2]), float(camera.matrix[1, 2])
        if camera.distortion_model == "none":
            low = (-0.5 - cx) / fx, (-0.5 - cy) / fy
            high = (camera.width - 0.5 - cx) / fx, (camera.height - 0.5 - cy) / fy
            return cls(low, high, camera.width, camera.height, None)
        plane, seen = _undistorted(camera)
        inside = plane[seen & (np.abs(plane).max(axis=-1) <= _WIDEST)]
        pixel = np.array([1.0 / fx, 1.0 / fy])
        low, high = inside.min(axis=0) - pixel, inside.max(axis=0) + pixel
        size = np.minimum(np.ceil((high - low) / pixel), _MOST_PIXELS)
        where = (plane - low) / (high - low) * size - 0.5
        where[~seen] = -2.0
        x, y = (np.ascontiguousarray(where[..., axis], dtype=np.float32) for axis in (0, 1))
        return cls((low[0], low[1]), (high[0], high[1]), int(size[0]), int(size[1]), (x, y))

    def image(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image that the camera takes, shape (height, width, 3), of a picture of the window.

        It is black where the lens does not look.
        """
        if self.maps is None:
            return picture
        bent: NDArray[np.uint8] = cv2.remap(picture, *self.maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return bent


def _undistorted(camera: Camera) -> tuple[Array, NDArray[np.bool_]]:
    """Where in the plane z = 1 the centre of each pixel looks, shape (height, width, 2), and whether it looks anywhere.

    OpenCV undoes the distortion by iteration, so a pixel counts only if distorting the result leads back to it.
    """
    rows = max(1, _BAND // camera.width)
    plane = np.empty((camera.height, camera.width, 2))
    seen = np.empty((camera.height, camera.width), dtype=bool)
    for first in range(0, camera.height, rows):
        band = slice(first, first + rows)
        plane[band], seen[band] = _undistorted_band(camera, first, min(first + rows, camera.height))
    return plane, seen


def _undistorted_band(camera: Camera, first: int, end: int) -> tuple[Array, NDArray[np.bool_]]:
    """As `_undistorted`, of some rows: OpenCV needs hundreds of bytes for each pixel."""
    v, u = np.mgrid[first:end, 0 : camera.width].astype(float)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    K, coefficients = np.array(camera.matrix), np.array(camera.distortion)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-10)
    if camera.distortion_model == "equidistant":
        plane = cv2.fisheye.undistortPoints(pixels, K, coefficients, criteria=stop)
        back = cv2.fisheye.distortPoints(plane, K, coefficients)
    else:
        plane = cv2.undistortPoints(pixels, K, coefficients, criteria=stop)
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        back, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, coefficients)
    error = np.linalg.norm(back.reshape(-1, 2) - pixels.reshape(-1, 2), axis=1)
    shape = (end - first, camera.width)
    seen = (error < 1e-2) & np.isfinite(error)
    return plane.reshape(*shape, 2).astype(float), seen.reshape(shape)
