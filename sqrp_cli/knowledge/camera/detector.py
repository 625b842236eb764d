"""The limits of a detection algorithm. Numbers are in SI units, angles in radians.

Also the kinds of detectors that installed packages bring: only their names are read here, and nothing of a package runs
before it is to look at an image. And when one of colours calls a part held, gone or in a place, for what predicts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from itertools import product
from math import pi, radians
from typing import Annotated

import numpy as np
from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from sqrp_cli.errors import expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Intrinsics
from sqrp_cli.knowledge.camera.curve import Curve
from sqrp_cli.knowledge.camera.marker_range import STEEPEST, least_pixels, marker_ranges, widest
from sqrp_cli.knowledge.markers import Marker
from sqrp_cli.knowledge.text.entries import In, Pixels, Range, Stored, completed, refused
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import ANGLE, LARGEST_LENGTH, SHARE

GROUP = "sqrp.detectors"
"""The group of entry points: the name of each is a kind of detector, its object makes one for a camera."""


@cache
def installed_detectors() -> Mapping[str, EntryPoint]:
    """The entry point of each kind, by its name; of several packages with one name, the first by the package's name."""
    found = sorted(entry_points(group=GROUP), key=lambda one: (one.name, package_of(one)), reverse=True)
    return {one.name: one for one in found}


def package_of(entry: EntryPoint) -> str:
    """The name of the package that brings an entry point."""
    return entry.dist.name if entry.dist is not None else entry.module


LEAST_VISIBLE = 0.001
"""A box of which less than this share is visible is never seen."""

BESIDE = 0.95
"""Share of a marker's box from which on images usually show it, though a part of the robot covers some of its edge."""

BUILT_IN = ("aruco", "color")
"""The kinds of detectors that need no other package."""


def _kind(value: object) -> str:
    """Raises PydanticCustomError for what is no kind of detector."""
    if value in BUILT_IN:
        return str(value)
    known = (*BUILT_IN, *installed_detectors())
    if not isinstance(value, str) or value not in known:
        hint = f"{expected_names(str(value), known)}; installed packages bring more as entry points `{GROUP}`"
        raise refused("wrong-value", f"found {describe(value)}, which is no detector; {hint}")
    return value


DetectorKind = Annotated[
    str, PlainValidator(_kind), WithJsonSchema({"anyOf": [{"enum": list(BUILT_IN)}, {"type": "string"}]})
]
Incidence = Annotated[float, In(ANGLE, radians(0.1), pi)]
VisibleShare = Annotated[float, In(SHARE, LEAST_VISIBLE, 1.0)]


@dataclass(frozen=True, kw_only=True)
class DetectorTraits(Stored):
    """What a workspace file says of a detection algorithm, and what is taken unchanged."""

    kind: DetectorKind
    """What it detects: `aruco` (markers), `color`, or a kind that an installed package brings."""
    max_incidence: Incidence
    """Largest angle between a box's normal and the direction to the camera."""
    min_visible: VisibleShare = 1.0
    """Least share of the box that must be seen."""
    curve: Curve | None = None
    """How likely it sees a box, by how a camera sees it; the limits go on deciding what is covered."""


@dataclass(frozen=True, kw_only=True)
class DetectorEntry(DetectorTraits):
    """A detection algorithm, and the limits within which it is reliable."""

    distance: Range | None = None
    """Nearest and farthest distance from the camera. Of `aruco` by default from the markers and lenses of the cell."""
    min_pixels: Pixels | None = None
    """Least size in the image: square root of the area in pixels. Of `aruco` by default from the dictionaries."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError, a ValueError, for an empty range, and for limits that only markers give."""
        if self.distance is not None and self.distance[0] >= self.distance[1]:
            raise PydanticCustomError("empty-range", "`distance` must go from a nearer to a farther distance")
        missing = [name for name in ("distance", "min_pixels") if getattr(self, name) is None]
        if missing and self.kind != "aruco":
            names = " and ".join(f"`{name}`" for name in missing)
            raise refused("missing-key", f"a detector of kind `{self.kind}` needs {names}; only markers give their own")


@dataclass(frozen=True, kw_only=True)
class Detector(DetectorTraits):
    """The limits within which a detection algorithm is reliable."""

    distance: tuple[float, float]
    """Nearest and farthest distance from the camera [m]."""
    min_pixels: float
    """Least size in the image: square root of the area in pixels."""
    dictionaries: tuple[str, ...] = ()
    """Of the cell's markers, for a detector of them."""
    is_usual: bool = False
    """Whether the size at which markers are read counts, not `min_pixels`: see `usual`."""

    @classmethod
    def of(cls, entry: DetectorEntry, cameras: Mapping[str, Intrinsics], markers: Mapping[str, Marker]) -> Detector:
        """A detector as a file states it, in a cell with cameras and markers by name.

        Where the file leaves it to them: the distances at which any camera reads any of the markers, and the size at
        which every camera reads each of them, also at the largest angle. Raises ValueError where there are none.
        """
        distance, least = entry.distance, entry.min_pixels
        dictionaries = tuple(dict.fromkeys(one.dictionary for one in markers.values() if entry.kind == "aruco"))
        if distance is None or least is None:
            reads = widest(marker_ranges(cameras, markers))
            if reads is None:
                raise ValueError("there is no marker, or no camera, that gives the detector its limits")
            looks = product(cameras.values(), dictionaries)
            smallest = max(float(least_pixels(*look, entry.max_incidence)) for look in looks)
            distance, least = distance or (reads.near, reads.far), smallest if least is None else least
        return completed(cls, entry, distance=distance, min_pixels=least, dictionaries=dictionaries)

    @property
    def usual(self) -> Detector:
        """With the limits within which it usually sees: markers as images show them, see `smallest` and `BESIDE`.

        One of colours judges what the image's edge leaves of a part as it does what others leave, see `judges_rest`. Of
        other detectors, and of those with a curve, no more is known than what is stated.
        """
        if self.curve is not None:
            return self
        if self.kind == "color":
            return replace(self, min_visible=self.judging.min_visible, is_usual=True)
        if not self.dictionaries:
            return self
        visible = min(self.min_visible, BESIDE)
        return replace(self, distance=(0.0, LARGEST_LENGTH), max_incidence=STEEPEST, min_visible=visible, is_usual=True)

    def smallest(self, camera: Intrinsics, incidence: Array) -> Array:
        """The least size of boxes in the image that are seen at angles [rad], the same shape [pixels]."""
        if not self.is_usual or not self.dictionaries:
            return np.full(incidence.shape, self.min_pixels)
        found: Array = np.max([least_pixels(camera, one, incidence) for one in self.dictionaries], axis=0)
        return found

    @property
    def judges_rest(self) -> bool:
        """Whether what the image's edge leaves of a box counts as what a part does that hides some of it."""
        return self.is_usual and self.kind == "color"

    @property
    def gates(self) -> Detector:
        """With the limits alone that its curve has no term for: outside them it sees nothing."""
        terms = {} if self.curve is None else self.curve.terms
        return replace(
            self,
            distance=(0.0, LARGEST_LENGTH) if "distance" in terms else self.distance,
            max_incidence=pi if "incidence" in terms else self.max_incidence,
            min_pixels=0.0 if "pixels" in terms else self.min_pixels,
            min_visible=LEAST_VISIBLE if "visible" in terms else self.min_visible,
        )

    @property
    def judging(self) -> Detector:
        """With the limits within which it judges images, though nobody relies on it: one of colours takes what it gets.

        See `BORDER`, too. Of other detectors no more is known than what is stated.
        """
        if self.kind != "color":
            return self
        return replace(
            self,
            distance=(0.0, LARGEST_LENGTH),
            max_incidence=pi,
            min_pixels=LEAST_PIXELS,
            min_visible=float(np.clip(self.min_visible, LEAST_SHARE, MOST_SHARE)),
            curve=None,
        )


LEAST_PIXELS = 4.0
"""Least square root of the area of a silhouette that can be judged by colour [pixels]."""

LEAST_SHARE, MOST_SHARE = 0.35, 0.5
"""Share of the silhouette of a coloured object that must be judged, at least and at most; in between, what its
detector requires to be visible. Of an object that nothing hides, a good part may still look like neither it nor the
background: at its edges, and where it meets the robot."""

BORDER = 1.8
"""Pixels along the edge of what hides an object that are not judged though they are visible: the robot's silhouette is
taken to be a pixel wider than it is, and pixels at its edge show both."""

FULL, EMPTY = 0.6, 0.1
"""A box is filled if it shows at least this share of the colour that its object would show, empty if at most this.
An object that is not held counts as in a place that is filled by more than half of the former."""

SHIFT_PIXELS, SHIFT_SHARE = 2.0, 0.05
"""How far the patch of an object may lie from where the tool would show it: pixels, plus a share of its size there."""

ALIKE = 0.02
"""Places explain an image equally well if they differ by no more than this share of the part's silhouette; the nearest
to where the tool would show it counts."""
