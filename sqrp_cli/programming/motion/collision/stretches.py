"""A path cut into stretches, with the pairs of bodies that are not yet proven apart over each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.motion.collision.placed_bodies import Indices
from sqrp_cli.trajectory import Path

FIRST_STRETCH = 0.08
"""Motion of the arm's outermost point within half of each stretch that a check begins with [m]."""


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of a path as their middles, with the pairs of bodies that are still open over each.

    s, half: middle and half length of each stretch, shape (m,). q: joint positions in the middle, shape (m, n).
    variation: how far each joint can be from there within the stretch, shape (m, n).
    stretch, pairs: index of stretch and of pair of every open combination, shape (k,), ordered by stretch.
    """

    s: Array
    half: Array
    q: Array
    variation: Array
    stretch: Indices
    pairs: Indices

    @staticmethod
    def still(q: Array, pairs: int, s: Array | None = None) -> Stretches:
        """Joint positions (m, n) without motion, with all pairs open; s: where on a path they are, (m,)."""
        middles = np.zeros(len(q)) if s is None else s
        return Stretches(middles, np.zeros(len(q)), q, np.zeros_like(q), *_all_open(len(q), pairs))

    @staticmethod
    def along(path: Path, slopes: Array, radii: Array, pairs: int) -> Stretches:
        """The whole path, each stretch with at most twice `FIRST_STRETCH` of motion, with all pairs open.

        slopes: bounds of the joints' slopes over each piece of the path, (p, n). radii: sizes of their motions, (n,).
        """
        middles, halves = [], []
        motions = (slopes @ radii) * (path.breaks[1:] - path.breaks[:-1])
        for motion, start, end in zip(motions.tolist(), path.breaks[:-1], path.breaks[1:], strict=True):
            count = max(1, int(np.ceil(motion / (2 * FIRST_STRETCH))))
            half = (end - start) / (2 * count)
            middles.append(start + half * (2 * np.arange(count) + 1))
            halves.append(np.full(count, half))
        s, half = np.concatenate(middles), np.concatenate(halves)
        return Stretches(s, half, path.positions(s), _variation(path, slopes, s, half), *_all_open(len(s), pairs))

    def halved(self, path: Path, slopes: Array, open_ones: Indices, until: float) -> Stretches:
        """Both halves of every stretch with one of the open combinations that begins before `until`."""
        open_ones = open_ones[(self.s - self.half)[self.stretch[open_ones]] < until]
        of_open, open_pairs = self.stretch[open_ones], self.pairs[open_ones]
        begins = np.ones(len(of_open), dtype=bool)  # of the open combinations, the first of each stretch
        begins[1:] = of_open[1:] != of_open[:-1]
        kept, stretch = of_open[begins], begins.cumsum() - 1
        quarter = self.half[kept] / 2
        s = np.stack([self.s[kept] - quarter, self.s[kept] + quarter], axis=1).ravel()
        half = quarter.repeat(2)
        both = np.concatenate([2 * stretch, 2 * stretch + 1])
        order = both.argsort(kind="stable")
        pairs = np.concatenate([open_pairs, open_pairs])[order]
        return Stretches(s, half, path.positions(s), _variation(path, slopes, s, half), both[order], pairs)


def _all_open(stretches: int, pairs: int) -> tuple[Indices, Indices]:
    """Every combination of stretch and pair, ordered by stretch."""
    return np.arange(stretches).repeat(pairs), np.arange(stretches * pairs) % pairs


def _variation(path: Path, slopes: Array, s: Array, half: Array) -> Array:
    """How far each joint can be from where it is at s, within `half` of s, shape (m, n)."""
    if len(slopes) > 1:
        slopes = slopes[np.clip(np.searchsorted(path.breaks, s) - 1, 0, len(slopes) - 1)]
    variation: Array = slopes * half[:, None]
    return variation
