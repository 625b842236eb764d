"""How far the pose of each camera may be from where the workspace says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array

_ROUNDING = 1e-9
"""Added to bounds, so that rounding decides nothing [m and rad]."""


@dataclass(frozen=True)
class PoseBounds:
    """Bounds on the error of each camera's optical frame; the errors of cameras have nothing to do with each other."""

    position: float
    """Longest distance of its centre from where it should be, in any direction [m]."""
    rotation: float
    """Largest angle by which it is turned, about any axis [rad]."""

    @property
    def reach(self) -> float:
        """`position`, and what rounding may add [m]."""
        return self.position + _ROUNDING

    @property
    def turn(self) -> float:
        """`rotation`, and what rounding may add [rad]."""
        return self.rotation + _ROUNDING

    def angles(self, distances: Array) -> Array:
        """By how much the direction from a camera to points changes at most, by their distances [m]; the same shape.

        The camera's turn, and the angle under which the ball of its centres is seen from the point.
        """
        return self.turn + self.parallax(distances)

    def parallax(self, distances: Array) -> Array:
        """The angles under which the ball of a camera's centres is seen from points at distances [m]."""
        found: Array = np.where(
            distances > self.reach, np.arcsin(np.clip(self.reach / np.maximum(distances, 1e-300), 0.0, 1.0)), np.pi
        )
        return found
