"""Sets of cameras, built camera by camera: what begins with too little is left out, by bounds that need no solver."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import comb, inf
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.placing.gain import Gain
from sqrp_cli.programming.placing.problem import Placing

_TOGETHER = 4e6
"""Sets times rows that are looked at at once, to bound the memory."""

_SETS_A_ROW = 4
"""If there are so many sets for each row, the rows that are needed are looked for; a row takes as long as a set."""

Worth = Callable[[Indices, Array, list[Array]], Array]
"""What counts first, (sets,), of sets of cameras, (sets, n), that see each row so often, (rows, sets), and have these
figures in each way, (2, sets); negative where a set is not good enough."""


def sets_at_once(rows: int) -> int:
    """How many sets are looked at at once."""
    return int(_TOGETHER / max(16, min(rows, _TOGETHER)))


class _Begun(NamedTuple):
    """Sets that have begun, and the options that may be added to each."""

    cameras: Indices
    """Shape (sets, n)."""
    open: Mask
    """Shape (sets, options)."""


class SetsInBounds:
    """All sets of so many of some options that may stand together, are cheap enough, and may be worth enough."""

    enough: float = 0.0
    """Only sets that may be worth so much are wanted; it may grow while they are looked at."""

    def __init__(self, problem: Placing, gain: Gain, worth: Worth, free: Indices, budget: float) -> None:
        """worth: what sets are worth, never less if more is seen. free: the options, in order."""
        self._problem, self._gain, self._worth, self._budget = problem, gain, worth, budget
        self._free: Mask = np.isin(np.arange(problem.count), free)
        self._sees = gain.sees.astype(np.float32)  # products of whole numbers are slow
        places = {*problem.spot.tolist(), *(place for pair in problem.apart for place in pair)}
        self._clash = np.eye(1 + max(places, default=0), dtype=bool)
        for first, second in problem.apart:
            self._clash[first, second] = self._clash[second, first] = True

    def of(self, count: int) -> Iterator[Indices]:
        """Those of a number, some at a time, shape (sets, count), the options of each in order."""
        waiting, needed = [_Begun(np.zeros((1, 0), dtype=np.int64), self._free[None])], self._needed(count)
        while waiting:
            begun = waiting.pop()
            more = count - begun.cameras.shape[1]
            if more > 0:
                begun = self._grown(self._promising(begun, more), needed, last=more == 1)
            if more > 1:
                waiting += self._in_parts(begun)
                continue
            cameras = np.sort(begun.cameras, axis=1)
            for some in self._problem.missing:
                if len(some) == count:
                    cameras = cameras[np.any(cameras != np.array(some), axis=1)]
            if len(cameras):
                yield cameras

    def _in_parts(self, begun: _Begun) -> Iterator[_Begun]:
        """So few at a time that all their sets of one camera more can be looked at at once."""
        step = max(1, sets_at_once(len(self._sees)) // len(self._free))
        for start in range(0, len(begun.cameras), step):
            yield _Begun(begun.cameras[start : start + step], begun.open[start : start + step])

    def _promising(self, begun: _Begun, more: int) -> _Begun:
        """Those sets that may be worth enough with some more cameras."""
        seen = self._gain.seen(begun.cameras)
        most = seen + np.minimum(more, self._sees @ begun.open.T.astype(np.float32))
        good = self._worth(begun.cameras, most, self._gain.figures_at_most(seen, most, more, begun.open)) >= self.enough
        return _Begun(begun.cameras[good], begun.open[good])

    def _needed(self, count: int) -> Indices:
        """The rows without which nothing is worth enough, whatever else is covered; none where sets are few."""
        every = np.arange(len(self._sees))
        found = np.zeros(len(every), dtype=bool)
        if _SETS_A_ROW * len(every) <= comb(np.count_nonzero(self._free), count):
            for start in range(0, len(every), step := sets_at_once(len(every))):
                some = every[start : start + step]
                seen = np.where(every[:, None] == some, np.int16(-1), np.int16(np.iinfo(np.int16).max))
                nobody = np.zeros((len(some), 0), dtype=np.int64)
                found[some] = self._worth(nobody, seen, self._gain.figures(seen)) < self.enough
        return np.flatnonzero(found)

    def _grown(self, begun: _Begun, needed: Indices, *, last: bool) -> _Begun:
        """Every set with one camera more: one that sees the rarest of what is needed and not covered, if any is.

        Each set comes about once: those that begin with one of these options have none of those before it.
        """
        branches = begun.open
        if len(needed):
            lacking = ~self._gain.covered(self._gain.seen(begun.cameras))[needed]
            seeing = self._sees[needed].astype(bool)
            rarest = np.where(lacking, self._sees[needed] @ begun.open.T.astype(np.float32), inf).argmin(axis=0)
            branches = begun.open & (seeing[rarest] | ~np.any(lacking, axis=0, keepdims=True).T)
        of, option = np.nonzero(branches)
        cameras = np.column_stack([begun.cameras[of], option])
        cheap = self._problem.price[cameras].sum(axis=1) <= self._budget
        of, option, cameras = of[cheap], option[cheap], cameras[cheap]
        if last:
            return _Begun(cameras, begun.open[:0])
        spot = self._problem.spot
        earlier = branches[of] & (np.arange(len(spot)) <= option[:, None])
        return _Begun(cameras, begun.open[of] & ~earlier & ~self._clash[spot[option]][:, spot])
