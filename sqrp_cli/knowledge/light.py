"""The lights of a cell, and between what brightness a detector can tell what it looks for.

Light has no colour. Its intensity is how bright it makes a white surface that faces it, as a share of what makes pixels
of a camera with gain 1 saturate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import cos, inf, radians
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from pydantic_core import PydanticCustomError

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.paint import COLORS, LEAST_VALUE, detected_as
from sqrp_cli.knowledge.text.entries import Direction, In, Position, Stored
from sqrp_cli.knowledge.text.units import ANGLE, SHORTEST_DIRECTION

MOST_LIGHTS = 8
"""Lights of a cell, of which one may come from everywhere: as many as the simulated cell can draw."""

MOST_INTENSITY = 1000.0
"""Of a light, and most gain of a camera."""

Intensity = Annotated[float, In(None, 0.0, MOST_INTENSITY)]
Beam = Annotated[float, In(ANGLE, radians(1.0), radians(160.0))]


class Rays(NamedTuple):
    """What reaches n points from a light, if nothing is in the way."""

    towards: Array
    """Unit vectors to the light, shape (n, 3)."""
    distance: Array
    """To the light, infinite from a directional one, shape (n,) [m]."""
    strength: Array
    """Intensity of the light there, shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Light(Stored):
    """A light: from everywhere, from a direction, as of the sun, or a lamp in a place."""

    intensity: Annotated[
        Intensity,
        Field(
            description="How bright it makes a white surface that faces it, of a lamp at 1 m; 1 saturates at gain 1."
        ),
    ]
    direction: Annotated[
        Direction | None, Field(description="In which it shines, in the world, from very far away.")
    ] = None
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
        if not self.is_ambient and float(np.linalg.norm(self._way)) < SHORTEST_DIRECTION:
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
        """Unit vector in which it shines, (3,)."""
        return self._way / np.linalg.norm(self._way)

    def rays(self, points: Array) -> Rays:
        """What reaches points, shape (n, 3): of a lamp less with the square of the distance."""
        if self.position is None:
            count = len(points)
            return Rays(np.tile(-self.heading, (count, 1)), np.full(count, inf), np.full(count, self.intensity))
        to_light = np.subtract(self.position, points)
        distance = np.maximum(np.linalg.norm(to_light, axis=1), 1e-6)
        towards = to_light / distance[:, None]
        within = -(towards @ self.heading) >= cos(self.half_beam)
        return Rays(towards, distance, np.where(within, self.intensity / distance**2, 0.0))

    @property
    def _way(self) -> Array:
        if self.direction is not None:
            return np.array(self.direction)
        return np.subtract(self.look_at or (0.0, 0.0, 0.0), self.position or (0.0, 0.0, 0.0))


class Brightness(NamedTuple):
    """Between which intensities of light, at gain 1, something is told from others."""

    least: float
    most: float


_ROUNDED = 0.5 / 255
"""By how much a pixel's value may be rounded up."""

ANY_BRIGHTNESS = Brightness(0.0, inf)

MARKER = Brightness(0.2, inf)
"""Of the white of a marker: with less, black and white differ too little for a threshold. Black stays black."""


@cache
def brightness_of(color: str | None) -> Brightness:
    """In which light a paint has the hue and saturation that a detector looks for; any for one without a hue."""
    paint = COLORS.get((color or "").lower())
    if paint is None or not detected_as(color or "", paint):
        return ANY_BRIGHTNESS
    brighter: Array = np.geomspace(1.0, 2 * MOST_INTENSITY, 4000)
    seen = np.minimum(np.outer(brighter, paint), 1.0).tolist()
    lost = (light for light, pixel in zip(brighter.tolist(), seen, strict=True) if not detected_as(color or "", pixel))
    return Brightness((LEAST_VALUE - _ROUNDED) / max(paint), next(lost, inf))
