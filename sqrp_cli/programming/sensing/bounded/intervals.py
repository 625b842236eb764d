"""Arithmetic of intervals: what a result can be where each operand is only known to lie between two numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array

_ROUND = 2 * np.pi


class Enclosure(NamedTuple):
    """Numbers between two, of equal shape."""

    low: Array
    high: Array

    def plus(self, other: Enclosure) -> Enclosure:
        """The sum."""
        return Enclosure(self.low + other.low, self.high + other.high)

    def scaled(self, factor: float) -> Enclosure:
        """The product with a number; 0 if that is 0, however far the interval reaches."""
        if factor == 0.0:
            return Enclosure(np.zeros_like(self.low), np.zeros_like(self.high))
        ends = factor * self.low, factor * self.high
        return Enclosure(*ends) if factor > 0 else Enclosure(*ends[::-1])

    def times(self, other: Enclosure) -> Enclosure:
        """The product of two finite ones."""
        ends = [a * b for a in self for b in other]
        return Enclosure(np.minimum.reduce(ends), np.maximum.reduce(ends))


def cosines(middle: Array, spread: Array) -> Enclosure:
    """The cosines of the angles that differ from `middle` by up to `spread` [rad]."""
    low, high = middle - spread, middle + spread
    ends = np.cos(low), np.cos(high)
    # The first multiple of a whole turn, and the first of those half a turn beyond, from `low` on.
    top = np.ceil(low / _ROUND) * _ROUND <= high
    bottom = (np.ceil(low / _ROUND - 0.5) + 0.5) * _ROUND <= high
    return Enclosure(np.where(bottom, -1.0, np.minimum(*ends)), np.where(top, 1.0, np.maximum(*ends)))
