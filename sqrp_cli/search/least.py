"""The least vector for which a test holds: growing shells, a descent over directions and lengths, and a fine grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from math import inf
from typing import TypeVar

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.records import dataclass

Test = Callable[[Array], Mask]
"""Which vectors (p, d) may do, shape (p,): quick, and never false for one that does."""

Decide = Callable[[Array], bool]
"""Whether a vector (d,) does."""

Passed = TypeVar("Passed")

FINE = 16
"""The fine grid has at most so many steps to every side."""

COARSE = {2: 12, 3: 4}
"""Steps of the grid of each shell to every side, by the dimension."""

_TOGETHER = 512
"""Vectors to test at once."""

_FEW = 32
"""Vectors to test at once where the next ones may pass; twice as many each time that none does."""

_DECIDED = 6
"""Vectors of one batch that pass the test and are decided, at most; failures sharpen the test."""

_GIVEN_UP = 4
"""Batches of a fine grid that are given up before all of it is: the test tells too little of what is decided."""

_ROUNDS = 10
"""Of the descent."""

_DIRECTIONS = 20
"""Directions around the best one that each round of the descent looks at."""

_SHORTER = np.array([0.995, 0.98, 0.95, 0.9, 0.8])
"""Lengths that each round looks at, as shares of the best."""


@dataclass(frozen=True)
class LeastSearch:
    """A search for the least vector."""

    test: Test
    decide: Decide
    dimension: int
    step: float
    """Of the grid."""
    reach: float
    """Longest vector that a coarse search looks at."""
    seed: int
    """Of the directions of the descent."""

    def anywhere(self) -> Array | None:
        """A vector (d,) that does, as short as a coarse search and a descent from what it finds can make it."""
        return self._least(shells(self.dimension, self.step, self.reach), inf)

    def within(self, length: float) -> Array | None:
        """A vector that does, from a fine grid up to a length; of many points that pass the test a few are decided.

        The grid is coarser than asked for beyond `FINE` of its steps.
        """
        return self._least(_ball(self.dimension, self.step, length), _GIVEN_UP)

    def _least(self, batches: Iterator[Array], most: float) -> Array | None:
        """The first vector of the batches that does, made shorter. most: batches that are given up before all are."""
        given_up = 0
        for batch in batches:
            for start in range(0, len(batch), _TOGETHER):
                found, decided = self._first_of(batch[start : start + _TOGETHER])
                if found is not None:
                    return self._descended(found)
                given_up += decided == _DECIDED
                if given_up >= most:
                    return None
        return None

    def _first_of(self, vectors: Array) -> tuple[Array | None, int]:
        """The first of some vectors that does, and how many were decided that do not: `_DECIDED` at most.

        Those make the test of the next ones sharper, so few are tested at once as long as they pass.
        """
        begin, count, decided = 0, _FEW, 0
        while begin < len(vectors):
            left = vectors[begin : begin + count]
            begin, count = begin + count, 2 * count
            while len(left := left[self.test(left)]):
                if self.decide(left[0]):
                    return left[0], decided
                decided, left, count = decided + 1, left[1:], _FEW
                if decided == _DECIDED:
                    return None, decided
        return None, decided

    def _descended(self, found: Array) -> Array:
        """A local least vector that does, from one that does."""
        rng = np.random.default_rng(self.seed)
        spread = 0.5
        for _ in range(_ROUNDS):
            length = np.linalg.norm(found)
            turned = found / length + spread * rng.normal(size=(_DIRECTIONS, self.dimension)) / np.sqrt(self.dimension)
            turned = np.concatenate([found[None] / length, turned / np.linalg.norm(turned, axis=1)[:, None]])
            lengths = length * _SHORTER
            tried = (lengths[:, None, None] * turned).reshape(-1, self.dimension)
            order = np.argsort(np.linalg.norm(tried, axis=1), kind="stable")
            nearer, _ = self._first_of(tried[order])
            if nearer is not None:
                found = nearer
            else:
                spread *= 0.5
        return found


def least_beyond(passes: Callable[[float], Passed | None], size: float, reach: float, step: float) -> Passed | None:
    """What passes at a size, else at the least greater one that growing steps and a bisection find.

    reach: the greatest size that is looked at. step: the first one, and how exactly the size is found.
    """
    found = passes(size)
    if found is not None:
        return found
    low, high = size, size + step
    while high <= reach and (found := passes(high)) is None:
        low, high = high, high + 2.0 * (high - low)
    while found is not None and high - low > step:
        middle = 0.5 * (low + high)
        nearer = passes(middle)
        low, high, found = (low, middle, nearer) if nearer is not None else (middle, high, found)
    return found


def shells(dimension: int, step: float, reach: float) -> Iterator[Array]:
    """Vectors (p, d) on grids around zero, nearer ones first: the farther out, the coarser."""
    inner = step
    while inner < reach:
        outer = min(2.0 * inner, reach)
        points = _grid(dimension, COARSE[dimension]) * (2.0 * inner / COARSE[dimension])
        lengths = np.linalg.norm(points, axis=1)
        yield points[(lengths > inner * (1 + 1e-9)) & (lengths <= outer * (1 + 1e-9))]
        inner = outer


def _ball(dimension: int, step: float, radius: float) -> Iterator[Array]:
    """The grid within a radius, without zero, nearest first; coarser where it would have too many points."""
    step = max(step, radius / FINE)
    points = _grid(dimension, FINE) * step
    lengths = np.linalg.norm(points, axis=1)
    yield points[(lengths > 0) & (lengths <= radius * (1 + 1e-9))]


@cache
def _grid(dimension: int, most: int) -> Array:
    """Whole-numbered vectors up to a length, shortest first; equal ones in the order of their coordinates."""
    points = np.array(list(product(range(-most, most + 1), repeat=dimension)), dtype=float)
    lengths = np.linalg.norm(points, axis=1)
    near: Array = points[lengths <= most * (1 + 1e-9)]
    return near[np.argsort(np.linalg.norm(near, axis=1), kind="stable")]
