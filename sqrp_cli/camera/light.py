"""Colours that have a name, the lights of a cell, and in which light a detector tells what it looks for.

Light has no colour: it changes how bright a paint is, not its hue, unless it saturates; detectors of colours look for
hues. Its intensity is how bright it makes a white surface that faces it, as a share of what makes pixels of a camera
with gain 1 saturate.
"""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from functools import cache
from math import inf, radians
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic_core import PydanticCustomError

from sqrp_cli.files.entries import Direction, FileRecord, In, Position
from sqrp_cli.files.units import ANGLE, SHORTEST_DIRECTION
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass

Rgb = tuple[float, float, float]  # red, green and blue, 0 to 1

COLORS: Mapping[str, Rgb] = {
    "red": (0.85, 0.08, 0.08),
    "orange": (0.95, 0.45, 0.03),
    "yellow": (0.90, 0.82, 0.06),
    "green": (0.08, 0.65, 0.12),
    "cyan": (0.05, 0.70, 0.75),
    "blue": (0.08, 0.20, 0.85),
    "purple": (0.45, 0.10, 0.75),
    "magenta": (0.85, 0.08, 0.65),
    "pink": (0.95, 0.45, 0.62),
    "brown": (0.42, 0.22, 0.08),
    "white": (0.92, 0.92, 0.92),
    "grey": (0.58, 0.58, 0.58),
    "gray": (0.58, 0.58, 0.58),
    "silver": (0.70, 0.70, 0.70),
    "black": (0.06, 0.06, 0.06),
}
"""Paint of each colour that has a name. Those with a hue are saturated; robot, floor and background are not."""
HUES = 180  # how many hues there are, as OpenCV counts: steps of two degrees
HUE_TOLERANCE = 12  # how far a hue may be from that of the paint that is looked for
LEAST_SATURATION = 0.3  # below it, in 0..1, a paint has no hue to look for
LEAST_SEEN_SATURATION, LEAST_VALUE = 90 / 255, 40 / 255
"""Below these, in 0..1, a detector of colours counts a pixel as grey or black, not as coloured."""


def hue_of(color: str | None) -> int | None:
    """The hue (0 to `HUES` - 1) of a colour's name; None for one without a hue, or that has no paint here."""
    if color is None or color.lower() not in COLORS:
        return None
    hue, saturation, _ = colorsys.rgb_to_hsv(*COLORS[color.lower()])
    return None if saturation < LEAST_SATURATION else round(hue * HUES) % HUES


def look_alike(sought: str | None, other: str | None) -> bool:
    """Whether a detector that looks for one colour takes another one for it."""
    return sought is not None and other is not None and detected_as(sought, COLORS.get(other.lower(), (0.0, 0.0, 0.0)))


def detected_as(color: str, pixel: Sequence[float]) -> bool:
    """Whether a detector that looks for a colour takes a pixel, red, green and blue in 0..1, for it."""
    sought, (r, g, b) = hue_of(color), pixel
    hue, saturation, value = colorsys.rgb_to_hsv(r, g, b)
    if sought is None or saturation < LEAST_SEEN_SATURATION or value < LEAST_VALUE:
        return False
    apart = abs(round(hue * HUES) - sought)
    return min(apart, HUES - apart) <= HUE_TOLERANCE


MOST_LIGHTS = 8  # lights of a cell, of which one may come from everywhere: as many as the simulated cell can draw
MOST_INTENSITY = 1000.0  # of a light, and most gain of a camera
Intensity = Annotated[float, In(None, 0.0, MOST_INTENSITY)]
Beam = Annotated[float, In(ANGLE, radians(1.0), radians(160.0))]


@dataclass(frozen=True, kw_only=True)
class Light(FileRecord):
    """A light: from everywhere, from a direction, as of the sun, or a lamp in a place."""

    intensity: Intensity
    """How bright it makes a white surface that faces it, of a lamp at 1 m; 1 saturates at gain 1."""
    direction: Direction | None = None
    """In which it shines, in the world, from very far away."""
    position: Annotated[Position | None, Field(description="Of a lamp, in the world.")] = None
    look_at: Annotated[Position | None, Field(description="The point in the middle of the lamp's beam.")] = None
    beam: Annotated[Beam | None, Field(description="Opening angle of the lamp's beam; default 120 deg.")] = None

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for keys that contradict each other."""
        if self.direction is not None and self.position is not None:
            raise PydanticCustomError("conflicting-keys", "a light has a `direction` or a `position`, not both")
        if (self.position is None) != (self.look_at is None):
            raise PydanticCustomError("conflicting-keys", "`position` and `look_at` of a lamp go together")
        if self.beam is not None and self.position is None:
            raise PydanticCustomError("conflicting-keys", "`beam` goes with the `position` of a lamp")
        if not self.is_ambient and np.linalg.norm(self.heading) < 0.999:
            raise PydanticCustomError("not-a-rotation", "the direction of the light has length 0")

    @property
    def is_ambient(self) -> bool:
        """Whether it comes from everywhere."""
        return self.direction is None and self.position is None

    @property
    def half_beam(self) -> float:
        """Angle of a lamp between the middle and the edge of its beam [rad]."""
        return 0.5 * (radians(120.0) if self.beam is None else self.beam)

    @property
    def heading(self) -> Array:
        """Unit vector in which it shines, (3,); a shorter one if that is not known."""
        way = np.subtract(self.look_at or (0.0, 0.0, 0.0), self.position or (0.0, 0.0, 0.0))
        if self.direction is not None:
            way = np.array(self.direction)
        heading: Array = way / max(float(np.linalg.norm(way)), SHORTEST_DIRECTION)
        return heading


Brightness = tuple[float, float]  # Least and most intensity of light, at gain 1, in which something is told from others
ANY_BRIGHTNESS: Brightness = (0.0, inf)
MARKER: Brightness = (0.2, inf)
"""Of the white of a marker: with less, black and white differ too little for a threshold. Black stays black."""


def paint_of(color: str | None) -> Rgb:
    """What simulations and recordings paint something with; of a colour that has no name here, one without a hue."""
    return COLORS.get((color or "").lower(), (0.75, 0.74, 0.72))


@cache
def brightness_of(color: str | None) -> Brightness:
    """In which light a paint has the hue and saturation that a detector looks for; any for one without a hue."""
    paint = COLORS.get((color or "").lower())
    if paint is None or not detected_as(color or "", paint):
        return ANY_BRIGHTNESS
    # Pixels are rounded, by up to half a step.
    brighter: Array = np.geomspace(1.0, 2 * MOST_INTENSITY, 4000)
    seen = np.minimum(np.outer(brighter, paint), 1.0).tolist()
    lost = (light for light, pixel in zip(brighter.tolist(), seen, strict=True) if not detected_as(color or "", pixel))
    return (LEAST_VALUE - 0.5 / 255) / max(paint), next(lost, inf)
