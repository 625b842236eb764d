"""Colours that have a name: their paint, and which of them detectors of colours cannot tell apart.

Light without a colour of its own changes how bright a paint is, not its hue, unless it saturates; detectors of colours
look for hues.
"""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence

Rgb = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""

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

HUES = 180
"""How many hues there are, as OpenCV counts: steps of two degrees."""

HUE_TOLERANCE = 12
"""How far a hue may be from that of the paint that is looked for."""

LEAST_SATURATION = 0.3
"""Below it, in 0..1, a paint has no hue to look for."""

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
    first, second = hue_of(sought), hue_of(other)
    if first is None or second is None:
        return False
    apart = abs(first - second)
    return min(apart, HUES - apart) <= HUE_TOLERANCE


def detected_as(color: str, pixel: Sequence[float]) -> bool:
    """Whether a detector that looks for a colour takes a pixel, red, green and blue in 0..1, for it."""
    sought, (r, g, b) = hue_of(color), pixel
    hue, saturation, value = colorsys.rgb_to_hsv(r, g, b)
    if sought is None or saturation < LEAST_SEEN_SATURATION or value < LEAST_VALUE:
        return False
    apart = abs(round(hue * HUES) - sought)
    return min(apart, HUES - apart) <= HUE_TOLERANCE
