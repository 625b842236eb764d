"""How far away a camera reads a marker: by the marker's size, its dictionary and the camera's lens.

Measured with images of the simulated cell and OpenCV's detector, see `python -m tests.detectors`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import cos, radians, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Intrinsics
from sqrp_cli.knowledge.markers import DICTIONARIES, Marker

MODULE_PIXELS, PER_BIT = 1.59, 0.19
"""Pixels along a module of a marker that is read in nine of ten images, if each side has one bit and none may be wrong;
by n bits along a side, of which b in all may be wrong, 1.59 (n / (1 + b))^0.19: of more bits one is lost more often."""

LEAST_SIDE = 0.011
"""Least side of a marker in the image that is looked at, as a share of the longer side of the image. OpenCV passes over
outlines whose perimeter is less than 0.03 of that: sides of 0.0075 and, as outlines are rough, some 0.011."""

STEEPEST = radians(80.0)
"""The largest angle at which markers are read [rad]."""


class MarkerRange(NamedTuple):
    """Between which distances a camera reads a marker that faces it, in the middle of the image [m]."""

    near: float
    """Where its black square, unturned, fills the image in one direction."""
    far: float
    """Up to here nine of ten images show it."""

    @classmethod
    def of(cls, camera: Intrinsics, marker: Marker, incidence: float = 0.0) -> MarkerRange:
        """The range of a marker for a camera; incidence: turned by an angle [rad]."""
        fx, fy = float(camera.matrix[0, 0]), float(camera.matrix[1, 1])
        near = marker.side * max(fx / camera.width, fy / camera.height)
        return cls(near, marker.side * sqrt(fx * fy) / float(_least_side(camera, marker.dictionary, incidence)))


def least_pixels(camera: Intrinsics, dictionary: str, incidence: ArrayLike = 0.0) -> Array:
    """Square root of the area in the image of the smallest marker that is read in nine of ten images [pixels].

    incidence: angles between its normal and the direction to the camera [rad]; the result has their shape.
    """
    return _least_side(camera, dictionary, incidence) * np.sqrt(_shorter(incidence))


def _least_side(camera: Intrinsics, dictionary: str, incidence: ArrayLike) -> Array:
    """The longer side in the image of the smallest marker that is read [pixels].

    A bit is read by the distance h of its module's edges in the image. Of a marker turned by an angle of cosine k about
    an axis at phi to them, h^2 is in proportion to k^2 / (cos(phi)^2 + k^2 sin(phi)^2); over all axes, the mean of h^-2
    is (1 + k^2) / 2 k^2. Outlines are passed over by their perimeter.
    """
    code, shorter = DICTIONARIES[dictionary], _shorter(incidence)
    module = MODULE_PIXELS * ((code.modules - 2) / (1 + code.corrected)) ** PER_BIT
    read = code.modules * module * np.sqrt(0.5 * (1.0 + shorter**2)) / shorter
    found: Array = np.maximum(read, LEAST_SIDE * max(camera.width, camera.height) * 2.0 / (1.0 + shorter))
    return found


def _shorter(incidence: ArrayLike) -> Array:
    """How long the shorter side of a turned marker is, as a share of the longer one."""
    return np.maximum(np.cos(incidence), cos(STEEPEST))


def marker_ranges(
    cameras: Mapping[str, Intrinsics], markers: Mapping[str, Marker]
) -> dict[str, dict[str, MarkerRange]]:
    """The range of each marker for each camera, by their names."""
    return {
        name: {called: MarkerRange.of(camera, marker) for called, marker in markers.items()}
        for name, camera in cameras.items()
    }


def widest(ranges: Mapping[str, Mapping[str, MarkerRange]]) -> MarkerRange | None:
    """The nearest and the farthest of several ranges; None of none."""
    every: Iterable[MarkerRange] = [one for of_camera in ranges.values() for one in of_camera.values()]
    return MarkerRange(min(one.near for one in every), max(one.far for one in every)) if every else None
