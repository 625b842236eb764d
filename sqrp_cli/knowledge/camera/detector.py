"""The limits of a detection algorithm. Numbers are in SI units, angles in radians."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians
from typing import Annotated, Literal

from pydantic_core import PydanticCustomError

from sqrp_cli.knowledge.camera.curve import Curve
from sqrp_cli.knowledge.text.bounds import LARGEST_LENGTH
from sqrp_cli.knowledge.text.entries import In, Pixels, Range, Stored
from sqrp_cli.knowledge.text.units import ANGLE, SHARE

LEAST_VISIBLE = 0.001
"""A box of which less than this share is visible is never seen."""

DetectorKind = Literal["aruco", "color"]
Incidence = Annotated[float, In(ANGLE, radians(0.1), pi)]
VisibleShare = Annotated[float, In(SHARE, LEAST_VISIBLE, 1.0)]


@dataclass(frozen=True, kw_only=True)
class Detector(Stored):
    """The limits within which a detection algorithm is reliable."""

    kind: DetectorKind
    """What it detects: ArUco markers or colours."""
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
