"""The limits of a detection algorithm. Numbers are in SI units, angles in radians."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from math import pi, radians
from typing import Annotated

from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from sqrp_cli.errors import expected_names
from sqrp_cli.knowledge.camera.curve import Curve
from sqrp_cli.knowledge.camera.installed import GROUP, installed_detectors
from sqrp_cli.knowledge.text.bounds import LARGEST_LENGTH
from sqrp_cli.knowledge.text.entries import In, Pixels, Range, Stored, refused
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import ANGLE, SHARE

LEAST_VISIBLE = 0.001
"""A box of which less than this share is visible is never seen."""

BUILT_IN = ("aruco", "color")
"""The kinds of detectors that need no other package."""


def _kind(value: object) -> str:
    """Raises PydanticCustomError for what is no kind of detector."""
    if value in BUILT_IN:
        return str(value)
    known = (*BUILT_IN, *installed_detectors())
    if not isinstance(value, str) or value not in known:
        raise refused("wrong-value", f"found {describe(value)}, which is no detector; {_expected(value, known)}")
    return value


def _expected(value: object, known: Collection[str]) -> str:
    """The nearest name, or all, and how there may be more."""
    return f"{expected_names(str(value), known)}; installed packages bring more as entry points `{GROUP}`"


DetectorKind = Annotated[
    str, PlainValidator(_kind), WithJsonSchema({"anyOf": [{"enum": list(BUILT_IN)}, {"type": "string"}]})
]
Incidence = Annotated[float, In(ANGLE, radians(0.1), pi)]
VisibleShare = Annotated[float, In(SHARE, LEAST_VISIBLE, 1.0)]


@dataclass(frozen=True, kw_only=True)
class Detector(Stored):
    """The limits within which a detection algorithm is reliable."""

    kind: DetectorKind
    """What it detects: `aruco` (markers), `color`, or a kind that an installed package brings."""
    distance: Range
    """Nearest and farthest distance from the camera."""
    max_incidence: Incidence
    """Largest angle between a box's normal and the direction to the camera."""
    min_pixels: Pixels
    """Least size in the image: square root of the area in pixels."""
    min_visible: VisibleShare = 1.0
    """Least share of the box that must be seen."""
    curve: Curve | None = None
    """How likely it sees a box, by how a camera sees it; the limits go on deciding what is covered."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError, a ValueError, for an empty range."""
        if self.distance[0] >= self.distance[1]:
            raise PydanticCustomError("empty-range", "`distance` must go from a nearer to a farther distance")

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
