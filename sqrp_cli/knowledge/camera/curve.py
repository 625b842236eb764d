"""How likely a detector sees a box, by how the camera sees it: a curve that frames teach, with stated coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.text.entries import In, Number, Stored
from sqrp_cli.knowledge.text.units import SHARE

Steepness = Annotated[float, In(None, 0.0, 1000.0)]
MostLikely = Annotated[float, In(SHARE, 0.01, 1.0)]

LEAST = 1e-3
"""A size in pixels and a cosine below this count as this, so that they have logarithms."""


class BoxSights(NamedTuple):
    """How cameras see boxes: arrays of one shape, one entry per look."""

    pixels: Array
    """Square root of the area of the box in the image [pixels]."""
    incidence: Array
    """Angle between the box's normal and the direction to the camera, 0 for a box without one [rad]."""
    distance: Array
    """From the camera to the box's centre [m]."""
    visible: Array
    """Share of the box's silhouette that nothing hides, in 0..1."""
    blur: Array
    """How far the box's centre moves in the image while the shutter is open [pixels]."""

    def features(self) -> Array:
        """What the coefficients of a curve are about, in the order of `COEFFICIENTS`, shape (5, ...).

        Each grows the better the box is seen: ln pixels, ln cos incidence, -distance, visible, -blur / pixels.
        """
        size = np.maximum(self.pixels, LEAST)
        cosine = np.maximum(np.cos(self.incidence), LEAST)
        return np.stack([np.log(size), np.log(cosine), -self.distance, self.visible, -self.blur / size])


@dataclass(frozen=True, kw_only=True)
class Curve(Stored):
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
        found = {name: getattr(self, name) for name in COEFFICIENTS}
        return {name: value for name, value in found.items() if value is not None}

    def probability(self, sights: BoxSights) -> Array:
        """How likely the detector sees each box, in 0..1."""
        weights = np.array([getattr(self, name) or 0.0 for name in COEFFICIENTS])
        z = self.bias + np.tensordot(weights, sights.features(), axes=1)
        return self.most / (1.0 + np.exp(-np.clip(z, -500.0, 500.0)))


COEFFICIENTS = BoxSights._fields
"""The terms that a curve may have."""
