"""How far away a camera reads a marker: by the marker's size, its dictionary and the camera's lens.

Measured with images of the simulated cell and OpenCV's detector, see `python -m tests.detectors`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import cos, sqrt
from typing import NamedTuple

from sqrp_cli.knowledge.camera.camera import Intrinsics
from sqrp_cli.knowledge.markers import DICTIONARIES, Marker

MODULE_PIXELS, LESS_PER_BIT, MOST_BITS = 1.9, 0.1, 3
"""Pixels along a module of a marker that is read in nine of ten images; less for each bit that is corrected, up to so
many bits."""

LEAST_SIDE = 0.011
"""Least side of a marker in the image that is looked at, as a share of the longer side of the image. OpenCV passes over
outlines whose perimeter is less than 0.03 of that: sides of 0.0075 and, as outlines are rough, some 0.011."""

_STEEPEST = 0.17
"""Cosine of the largest angle, 80 degrees, at which markers are read."""


class MarkerRange(NamedTuple):
    """Between which distances a camera reads a marker that faces it, in the middle of the image [m]."""

    near: float
    """Where its black square, unturned, fills the image in one direction."""
    far: float
    """Up to here nine of ten images show it; at an angle, at least to this times the cosine of the angle."""

    @classmethod
    def of(cls, camera: Intrinsics, marker: Marker) -> MarkerRange:
        """The range of a marker for a camera."""
        fx, fy = float(camera.matrix[0, 0]), float(camera.matrix[1, 1])
        near = marker.side * max(fx / camera.width, fy / camera.height)
        return cls(near, marker.side * sqrt(fx * fy) / least_pixels(camera, marker))


def least_pixels(camera: Intrinsics, marker: Marker, incidence: float = 0.0) -> float:
    """Square root of the area in the image of the smallest marker that is read in nine of ten images [pixels].

    incidence: angle between its normal and the direction to the camera [rad]. What counts is the shorter side.
    """
    dictionary = DICTIONARIES[marker.dictionary]
    module = MODULE_PIXELS - LESS_PER_BIT * min(dictionary.corrected, MOST_BITS)
    side = max(dictionary.modules * module, LEAST_SIDE * max(camera.width, camera.height))
    return side / sqrt(max(cos(incidence), _STEEPEST))


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
