"""Detection algorithms: their limits, how likely they see a box, and how far away a camera reads a marker.

Numbers are in SI units, angles in radians. Also the kinds of detectors that installed packages bring: only their names
are read here, and nothing of a package runs before it is to look at an image. And when one of colours calls a part
held, gone or in a place, for what predicts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from itertools import product
from math import cos, pi, radians, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from sqrp_cli.camera.camera import Intrinsics
from sqrp_cli.camera.markers import DICTIONARIES, Marker
from sqrp_cli.errors import expected_names
from sqrp_cli.files.entries import FileRecord, In, Number, Pixels, Range, Rates, from_fields, refused
from sqrp_cli.files.source import describe
from sqrp_cli.files.units import ANGLE, LARGEST_LENGTH, SHARE
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass

Steepness = Annotated[float, In(None, 0.0, 1000.0)]
MostLikely = Annotated[float, In(SHARE, 0.01, 1.0)]
LEAST_FEATURE = 1e-3  # a size in pixels and a cosine below this count as this, so that they have logarithms
COEFFICIENTS = ("pixels", "incidence", "distance", "visible", "blur")
"""The terms that a curve may have, by what of `BoxSights` they are about."""
BoxSights = Array
"""How cameras see boxes, shape (5, ...), in the order of `COEFFICIENTS`.

The square root of the area of the box in the image [pixels]; the angle between its normal and the direction to the
camera, 0 for a box without one [rad]; the distance from the camera to its centre [m]; the share of its silhouette that
nothing hides, in 0..1; and how far its centre moves in the image while the shutter is open [pixels].
"""


def features(sights: BoxSights) -> Array:
    """What the coefficients of a curve are about, in the order of `COEFFICIENTS`, shape (5, ...).

    Each grows the better the box is seen: ln pixels, ln cos incidence, -distance, visible, -blur / pixels.
    """
    pixels, incidence, distance, visible, blur = sights
    size, cosine = np.maximum(pixels, LEAST_FEATURE), np.maximum(np.cos(incidence), LEAST_FEATURE)
    return np.stack([np.log(size), np.log(cosine), -distance, visible, -blur / size])


@dataclass(frozen=True, kw_only=True)
class Curve(FileRecord):
    """How likely a detector sees a box: most / (1 + exp(-z)), where z is `bias` plus the terms below.

    A limit of the detector counts where the curve has no term for what it limits; without terms, all do.
    """

    bias: Number
    """Of z."""
    pixels: Steepness | None = None
    """Times ln of the size in the image, the square root of its area in pixels; replaces `min_pixels`."""
    incidence: Steepness | None = None
    """Times ln of the cosine of the angle to the box's normal; replaces `max_incidence`."""
    distance: Steepness | None = None
    """Times minus the distance in metres; replaces `distance`."""
    visible: Steepness | None = None
    """Times the visible share, in 0..1; replaces `min_visible`."""
    blur: Steepness | None = None
    """Times minus the blur by motion, as a share of the size in the image."""
    most: MostLikely = 1.0
    """The probability in the best of views."""

    @property
    def terms(self) -> dict[str, float]:
        """The coefficients that it has, by name."""
        return {name: value for name in COEFFICIENTS if (value := getattr(self, name)) is not None}

    def probability(self, sights: BoxSights) -> Array:
        """How likely the detector sees each box, in 0..1."""
        weights = np.array([getattr(self, name) or 0.0 for name in COEFFICIENTS])
        z = self.bias + np.tensordot(weights, features(sights), axes=1)
        return self.most / (1.0 + np.exp(-np.clip(z, -500.0, 500.0)))


MODULE_PIXELS, PER_BIT = 1.59, 0.19
"""Pixels along a module of a marker that is read in nine of ten images, if each side has one bit and none may be wrong;
by n bits along a side, of which b in all may be wrong, 1.59 (n / (1 + b))^0.19: of more bits one is lost more often."""
LEAST_SIDE = 0.011
"""Least side of a marker in the image that is looked at, as a share of the longer side of the image. OpenCV passes over
outlines whose perimeter is less than 0.03 of that: sides of 0.0075 and, as outlines are rough, some 0.011."""
PERIMETER_RATE = (0.03, 4.0)  # of outlines that OpenCV looks at, unless a detector states others
STEEPEST = radians(80.0)  # the largest angle at which markers are read [rad]


def marker_range(
    camera: Intrinsics, marker: Marker, incidence: float = 0.0, rates: tuple[float, float] = PERIMETER_RATE
) -> tuple[float, float]:
    """Between which distances a camera reads a marker in the middle of the image, turned by an angle [rad]: [m].

    From where its black square, unturned, fills the image in one direction, or has the longest outline of `rates`, to
    where nine of ten images show it. rates: as `perimeter_rate` of a detector.
    """
    fx, fy = float(camera.matrix[0, 0]), float(camera.matrix[1, 1])
    longest = rates[1] * max(camera.width, camera.height)
    near = marker.side * max(fx / camera.width, fy / camera.height, 2.0 * (fx + fy) / longest)
    turned = sqrt(max(cos(incidence), cos(STEEPEST)))  # of the area, to that of its longer side
    least = float(least_pixels(camera, marker.dictionary, incidence, rates[0]))
    return near, marker.side * sqrt(fx * fy) * turned / least


def least_pixels(camera: Intrinsics, dictionary: str, incidence: ArrayLike = 0.0, rate: float = 0.03) -> Array:
    """Square root of the area in the image of the smallest marker that is read in nine of ten images [pixels].

    incidence: angles between its normal and the direction to the camera [rad]; the result has their shape. rate: of the
    shortest outline that is looked at.

    A bit is read by the distance h of its module's edges in the image. Of a marker turned by an angle of cosine k about
    an axis at phi to them, h^2 is in proportion to k^2 / (cos(phi)^2 + k^2 sin(phi)^2); over all axes, the mean of h^-2
    is (1 + k^2) / 2 k^2. Outlines are passed over by their perimeter.
    """
    code = DICTIONARIES[dictionary]
    shorter = np.maximum(np.cos(incidence), cos(STEEPEST))  # the shorter side of a turned marker, to the longer one
    module = MODULE_PIXELS * ((code.modules - 2) / (1 + code.corrected)) ** PER_BIT
    read = code.modules * module * np.sqrt(0.5 * (1.0 + shorter**2)) / shorter
    side = LEAST_SIDE * rate / PERIMETER_RATE[0] * max(camera.width, camera.height)
    longer: Array = np.maximum(read, side * 2.0 / (1.0 + shorter))
    return longer * np.sqrt(shorter)


GROUP = "sqrp.detectors"
"""The group of entry points: the name of each is a kind of detector, its object makes one for a camera."""


@cache
def installed_detectors() -> Mapping[str, EntryPoint]:
    """The entry point of each kind, by its name; of several packages with one name, the first by the package's name."""
    found = [(one.name, one.dist.name if one.dist else one.module, one) for one in entry_points(group=GROUP)]
    return {name: one for name, _, one in sorted(found, key=lambda kind: kind[:2], reverse=True)}


ANYWHERE = (0.0, LARGEST_LENGTH)  # the distance of a detector without limits of it
LEAST_VISIBLE = 0.001  # a box of which less than this share is visible is never seen
BESIDE = 0.95
"""Share of a marker's box from which on images usually show it, though a part of the robot covers some of its edge."""
BUILT_IN = ("aruco", "color")  # the kinds of detectors that need no other package


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
class DetectorEntry(FileRecord):
    """A detection algorithm, and the limits within which it is reliable."""

    kind: DetectorKind
    """What it detects: `aruco` (markers), `color`, or a kind that an installed package brings."""
    max_incidence: Incidence
    """Largest angle between a box's normal and the direction to the camera."""
    min_visible: VisibleShare = 1.0
    """Least share of the box that must be seen."""
    curve: Curve | None = None
    """How likely it sees a box, by how a camera sees it; the limits go on deciding what is covered."""
    distance: Range | None = None
    """Nearest and farthest distance from the camera. Of `aruco` by default from the markers and lenses of the cell."""
    min_pixels: Pixels | None = None
    """Least size in the image: square root of the area in pixels. Of `aruco` by default from the dictionaries."""
    perimeter_rate: Rates | None = None
    """Of `aruco`: least and greatest length of a marker's outline in the image, as shares of the image's longer side;
    OpenCV's `minMarkerPerimeterRate` and `maxMarkerPerimeterRate`. It narrows `distance` and `min_pixels`."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError, a ValueError, for an empty range, and for limits that only markers give."""
        for name in ("distance", "perimeter_rate"):
            if (ends := getattr(self, name)) is not None and ends[0] >= ends[1]:
                raise PydanticCustomError("empty-range", f"`{name}` must go from a lesser to a greater value")
        if self.kind == "aruco":
            return
        if self.perimeter_rate is not None:
            raise refused("conflicting-keys", "`perimeter_rate` is of markers: it goes with `kind: aruco`")
        if names := " and ".join(f"`{name}`" for name in ("distance", "min_pixels") if getattr(self, name) is None):
            raise refused("missing-key", f"a detector of kind `{self.kind}` needs {names}; only markers give their own")


@dataclass(frozen=True, kw_only=True)
class Detector(DetectorEntry):
    """The limits within which a detection algorithm is reliable: what an entry leaves to the cell is known, too."""

    distance: tuple[float, float] = field()
    """Nearest and farthest distance from the camera [m]."""
    min_pixels: float = field()
    """Least size in the image: square root of the area in pixels."""
    dictionaries: tuple[str, ...] = ()
    """Of the cell's markers, for a detector of them."""
    is_usual: bool = False
    """Whether the size at which markers are read counts, not `min_pixels`: see `usual`."""

    def __post_init__(self) -> None:
        """Accepts an empty range: that of markers which no camera of the cell can read."""

    @classmethod
    def of(cls, entry: DetectorEntry, cameras: Mapping[str, Intrinsics], markers: Mapping[str, Marker]) -> Detector:
        """A detector as a file states it, in a cell with cameras and markers by name.

        Where the file leaves it to them: the distances at which any camera reads any of the markers, and the size at
        which every camera reads each of them, also at the largest angle. With a `perimeter_rate`, the nearest distance
        and that size are such that all keep to it. Raises ValueError where there are none.
        """
        distance, least, rates = entry.distance, entry.min_pixels, entry.perimeter_rate
        dictionaries = tuple(dict.fromkeys(one.dictionary for one in markers.values() if entry.kind == "aruco"))
        if distance is None or least is None or rates is not None:
            used, looks = rates or PERIMETER_RATE, product(cameras.values(), markers.values())
            reads = [marker_range(*look, 0.0, used) for look in looks]
            if not reads:
                raise ValueError("there is no marker, or no camera, that gives the detector its limits")
            nears, fars = zip(*reads, strict=True)
            codes = product(cameras.values(), dictionaries)
            smallest = max(float(least_pixels(*code, entry.max_incidence, used[0])) for code in codes)
            distance, least = distance or (min(nears), max(fars)), smallest if least is None else least
            if rates is not None:
                distance, least = (max(distance[0], *nears), distance[1]), max(least, smallest)
        return from_fields(cls, entry, distance=distance, min_pixels=least, dictionaries=dictionaries)

    @property
    def usual(self) -> Detector:
        """With the limits within which it usually sees: markers as images show them, see `smallest` and `BESIDE`.

        One of colours judges what the image's edge leaves of a part as it does what others leave. Of other detectors,
        and of those with a curve or limits of outlines, no more is known than what is stated.
        """
        is_stated = self.curve is not None or self.perimeter_rate is not None
        if is_stated or not (self.dictionaries or self.kind == "color"):
            return self
        if self.kind == "color":
            return replace(self, min_visible=self.judging.min_visible, is_usual=True)
        visible = min(self.min_visible, BESIDE)
        return replace(self, distance=ANYWHERE, max_incidence=STEEPEST, min_visible=visible, is_usual=True)

    def smallest(self, camera: Intrinsics, incidence: Array) -> Array:
        """The least size of boxes in the image that are seen at angles [rad], the same shape [pixels]."""
        if not self.is_usual or not self.dictionaries:
            return np.full(incidence.shape, self.min_pixels)
        found: Array = np.max([least_pixels(camera, one, incidence) for one in self.dictionaries], axis=0)
        return found

    @property
    def hard_limits(self) -> Detector:
        """With the limits alone that its curve has no term for: outside them it sees nothing."""
        terms = {} if self.curve is None else self.curve.terms
        return replace(
            self,
            distance=ANYWHERE if "distance" in terms else self.distance,
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
        visible = float(np.clip(self.min_visible, LEAST_SHARE, MOST_SHARE))
        return replace(
            self, distance=ANYWHERE, max_incidence=pi, min_pixels=LEAST_PIXELS, min_visible=visible, curve=None
        )


LEAST_PIXELS = 4.0  # least square root of the area of a silhouette that can be judged by colour [pixels]
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
