"""Where the centre of a camera may be, cut into columns along the direction to a box.

Across that direction the parallax of what hides the box changes much faster than along it, so only that is cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds

_ROUND = np.arange(6) * (np.pi / 3)

_PARTS = np.vstack([np.zeros(2), 0.5 * np.sqrt(3.0) * np.stack([np.cos(_ROUND), np.sin(_ROUND)], axis=1)])
"""Centres of seven disks of half its radius that cover the unit disk."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Upright cylinders that hold the possible centres of cameras, one for each of n sight lines."""

    line: Indices
    """Index of the sight line, not decreasing, shape (n,)."""
    middle: Array
    """Of each column, across the direction to the box, from where the camera should be, shape (n, 2) [m]."""
    aside: Array
    """Radius of each, shape (n,) [m]."""
    bounds: PoseBounds

    @classmethod
    def whole(cls, line: Indices, bounds: PoseBounds) -> Columns:
        """One column for each sight line."""
        return cls(line, np.zeros((len(line), 2)), np.full(len(line), bounds.reach), bounds)

    @property
    def turn(self) -> float:
        """By how much the cameras may be turned [rad]."""
        return self.bounds.turn

    @property
    def along(self) -> Array:
        """Half the length of each that lies in the ball of centres, shape (n,) [m]."""
        nearest = np.maximum(np.hypot(*self.middle.T) - self.aside, 0.0)
        found: Array = np.sqrt(np.maximum(self.bounds.reach**2 - nearest**2, 0.0))
        return found

    @property
    def reach(self) -> Array:
        """Distance from the middle of each column within which its centres lie, shape (n,) [m]."""
        centred = self.aside >= self.bounds.reach
        return np.where(centred, self.bounds.reach, np.hypot(self.aside, self.along))

    def some(self, which: Mask) -> Columns:
        """Some of the columns."""
        return Columns(self.line[which], self.middle[which], self.aside[which], self.bounds)

    def split(self) -> Columns:
        """Each cut into those of half its radius that reach into the ball of centres."""
        parts = len(_PARTS)
        aside = np.repeat(0.5 * self.aside, parts)
        middle = np.repeat(self.middle, parts, axis=0) + np.tile(_PARTS, (len(self.line), 1)) * (2.0 * aside)[:, None]
        found = Columns(np.repeat(self.line, parts), middle, aside, self.bounds)
        return found.some(np.hypot(*middle.T) - aside < self.bounds.reach)
