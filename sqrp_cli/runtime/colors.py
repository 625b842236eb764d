"""Colours of things by name: what the simulated cell paints, and what the colour detector looks for."""

from __future__ import annotations

from collections.abc import Mapping

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
