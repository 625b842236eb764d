"""What a detection algorithm can do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DetectorKind = Literal["aruco", "color"]


@dataclass(frozen=True)
class Detector:
    """The limits within which a detection algorithm is reliable.

    distance: nearest and farthest distance from the camera to the centre of the box [m].
    max_incidence: largest angle between the box's normal and the direction to the camera [rad].
    min_pixels: least square root of the area of the projected box's convex hull [pixels].
    min_visible: least share of the box's silhouette that must be seen, in (0, 1].
    """

    name: str
    kind: DetectorKind
    distance: tuple[float, float]
    max_incidence: float
    min_pixels: float
    min_visible: float
