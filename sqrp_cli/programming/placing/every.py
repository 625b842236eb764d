"""The best of all sets of cameras, where they are few enough to compare all that may be good enough."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import comb, inf
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.placing.gain import Gain, WayQuality, qualities_alone
from sqrp_cli.programming.placing.problem import Choice, Demand, Placing

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
            if more > 1:  # so few at a time that all their sets of one camera more can be looked at at once
                step = max(1, sets_at_once(len(self._sees)) // len(self._free))
                starts = range(0, len(begun.cameras), step)
                waiting += [_Begun(begun.cameras[at : at + step], begun.open[at : at + step]) for at in starts]
                continue
            cameras = np.sort(begun.cameras, axis=1)
            for some in self._problem.missing:
                if len(some) == count:
                    cameras = cameras[np.any(cameras != np.array(some), axis=1)]
            if len(cameras):
                yield cameras

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


MOST_WORK = 1e9
"""Most sets of cameras times rows that are compared; beyond that, an integer program finds the best."""

_SAME = 1e-9
"""Figures that differ by less are equal."""

_REACHED = 1e-7
"""By how much figures may miss a wish: they are sums."""

Key = tuple[float, ...]
"""What a choice is worth in every aim, the least the best."""


class _Scores(NamedTuple):
    """What several sets of cameras are worth; negative where a set, or a way with it, cannot be."""

    first: Array
    """What counts first, shape (sets,)."""
    least: Array
    """The least quality of each way, shape (ways, sets)."""
    mean: Array
    """Its mean quality, shape (ways, sets)."""


class EverySet:
    """Compares all sets of cameras of a problem, aim by aim: a proof that depends on no solver."""

    def __init__(self, problem: Placing, demand: Demand, known: float = 0.0) -> None:
        """known: a value of what counts first that some choice is known to have, if there is no wish."""
        self._problem, self._demand, self._known = problem, demand, known
        self._gain = Gain(problem, demand)
        self._rows = max(1, len(problem.cover.table.needed))
        free = np.array([option for option in range(problem.count) if option not in problem.kept], dtype=np.int64)
        self._budget = inf if demand.budget is None else demand.budget + _SAME
        self._free: Indices = free[problem.price[free] <= self._budget]

    @property
    def most(self) -> int:
        """The most cameras that there may be: one at each place."""
        return len(np.unique(self._problem.spot[self._free]))

    def fits(self, counts: Sequence[int]) -> bool:
        """Whether all sets of so many cameras are few enough."""
        return sum(comb(len(self._worth_trying(count)), count) for count in counts) * self._rows <= MOST_WORK

    def best(self, counts: Sequence[int], *, first_only: bool = False) -> Choice | None:
        """The best set of so many cameras that may stand together; None if none meets the wish.

        Aims: quality, delay, price, number, mean quality, what each sees alone, then the order of options. first_only:
        only quality.
        """
        found = [one for count in counts if (one := self._best(count, first_only=first_only)) is not None]
        return min(found, key=lambda one: one[0])[1] if found else None

    def _worth_trying(self, count: int) -> Indices:
        """The options that may be part of the best set: where one of two may fail, each has to be enough alone."""
        demand = self._demand
        if not demand.survive or count != 1 + demand.survive or self._problem.kept:
            return self._free
        alone = Gain(self._problem, demand, failed=demand.survive)
        score = np.concatenate([self._scores(alone, part).first for part in self._chunked(self._free[:, None])])
        return self._free[score >= (0.0 if demand.wish is not None else self._known - _SAME)]

    def _best(self, count: int, *, first_only: bool) -> tuple[Key, Choice] | None:
        """The best of all sets of a number, with its key."""
        best, tied = max(0.0, self._known - _SAME), list[tuple[float, Indices]]()
        sets = SetsInBounds(self._problem, self._gain, self._at_most, self._worth_trying(count), self._budget)
        sets.enough = best
        for cameras in sets.of(count):
            score = self._scores(self._gain, cameras).first
            top = float(score.max())
            if top >= best - _SAME:
                best = max(best, top)
                tied.append((top, cameras[score >= top - _SAME]))
                sets.enough = max(0.0, best - _SAME)
        equal = [cameras for top, cameras in tied if top >= best - _SAME]
        if not equal:
            return None
        together = np.concatenate(equal)
        together = together[np.lexsort(together.T[::-1])] if count else together
        keys = [self._finest(part, best) for part in self._chunked(together[:1] if first_only else together)]
        return min((key for key in keys if key is not None), key=lambda one: one[0], default=None)

    def _chunked(self, cameras: Indices) -> Iterator[Indices]:
        at_once = sets_at_once(self._rows)
        yield from (cameras[start : start + at_once] for start in range(0, len(cameras), at_once))

    def _shut(self, cameras: Indices) -> Mask:
        """Whether a camera of a set is in the way, or in the sight of another one, shape (ways, sets)."""
        problem = self._problem
        found: Mask = np.any(self._gain.shut[:, cameras], axis=2)
        for hiding in problem.hiding:
            in_sight = (problem.spot[cameras] == hiding.place).any(axis=1)
            sees = np.isin(cameras, hiding.options).any(axis=1) | bool(set(hiding.options) & problem.kept)
            found[hiding.way] |= in_sight & sees
        return found

    def _scores(self, gain: Gain, cameras: Indices) -> _Scores:
        """What several sets are worth."""
        seen = gain.seen(cameras)
        return self._judged(gain, cameras, seen, gain.figures(seen))

    def _at_most(self, cameras: Indices, seen: Array, figures: Sequence[Array]) -> Array:
        """What counts first of sets with these cameras and others, which see no more than this, (sets,)."""
        return self._judged(self._gain, cameras, seen, figures).first

    def _judged(self, gain: Gain, cameras: Indices, seen: Array, figures: Sequence[Array]) -> _Scores:
        """The same, of these figures of each way, (2, sets), if so many cameras see each row, (rows, sets)."""
        usable = ~self._shut(cameras) & np.array([self._reaches(pair) for pair in figures])
        wish = self._demand.wish
        if wish is not None and wish.delay is not None and usable.any():
            usable &= np.maximum(self._delays(gain, seen), self._least_delays(cameras)) <= wish.delay + _REACHED
        of_way = [WayQuality.of(pair) for pair in figures]
        least = np.where(usable, [one.least for one in of_way], -1.0)
        mean = np.where(usable, [one.mean for one in of_way], -1.0)
        return _Scores(self._first(least, mean), least, mean)

    def _reaches(self, pair: Array) -> Mask:
        """Whether Q_eoi and Q_avg, (2, sets), are as wished for; undefined ones are; (sets,)."""
        wish = self._demand.wish
        if wish is None:
            return np.ones(pair.shape[1], dtype=bool)
        wanted = np.array([[wish.q_eoi or 0.0], [wish.q_avg or 0.0]])
        reached: Mask = np.all(~(pair < wanted - _REACHED), axis=0, keepdims=True)[0]
        return reached

    def _first(self, least: Array, mean: Array) -> Array:
        """What counts first, if every candidate takes its best way, negative if one has none, (sets,)."""
        if self._demand.objective == "least":
            each = [least[list(of_one)].max(axis=0) for of_one in self._problem.candidates]
            lowest: Array = np.min([*each, np.ones(least.shape[1])], axis=0)
            return lowest
        return self._mean(mean)

    def _mean(self, mean: Array) -> Array:
        """The mean of all candidates in their best ways, negative if one has none, (sets,)."""
        weights = self._problem.weights
        each = np.array([mean[list(of_one)].max(axis=0) for of_one in self._problem.candidates])
        total = float(weights.sum())
        means = weights @ each / total if total > 0 else np.ones(mean.shape[1])
        return np.where(np.any(each < 0.0, axis=0), -1.0, means)

    def _delays(self, gain: Gain, seen: Array) -> Array:
        """The longest delay of each way, shape (ways, sets) [s]."""
        covered, cover = gain.covered(seen), self._problem.cover
        return np.array([cover.delays(way, covered) for way in cover.ways]).reshape(len(cover.ways), seen.shape[1])

    def _least_delays(self, cameras: Indices) -> Array:
        """See `Placing.least_delay`, of each way, shape (ways, sets) [s]."""
        late = self._problem.late
        stay = late[:, sorted(self._problem.kept)].max(axis=1, initial=0.0)[:, None]
        longest: Array = np.maximum(stay, late[:, cameras].max(axis=2, initial=0.0))
        return longest

    def _finest(self, cameras: Indices, first: float) -> tuple[Key, Choice] | None:
        """The best of some sets that are equal in what counts first, by all other aims, with the ways to take."""
        problem, of_each = self._problem, [list(of_one) for of_one in self._problem.candidates]
        _, least, mean = self._scores(self._gain, cameras)
        delay = self._delays(self._gain, self._gain.seen(cameras))
        good = np.zeros(least.shape, dtype=bool)
        for of_one in of_each:
            rough = least[of_one] if self._demand.objective == "least" else mean[of_one]
            enough = first if self._demand.objective == "least" else rough.max(axis=0)
            good[of_one] = rough >= enough - _SAME
        delay = np.where(good, delay, inf)
        slowest = np.round(np.max([delay[of_one].min(axis=0) for of_one in of_each], axis=0), 7)
        mean = np.where(good & (delay <= slowest + _REACHED), mean, -1.0)
        price, alone = problem.price[cameras].sum(axis=1), self._alone[cameras].sum(axis=1)
        best = int(np.lexsort((-np.round(alone, 9), -np.round(self._mean(mean), 9), np.round(price, 9), slowest))[0])
        ways = tuple(of_one[int(mean[of_one, best].argmax())] for of_one in of_each)
        costs = (float(slowest[best]), round(float(price[best]), 9), float(cameras.shape[1]))
        gains = (round(float(self._mean(mean)[best]), 9), round(float(alone[best]), 9))
        return (-round(first, 9), *costs, *(-gain for gain in gains)), Choice(
            tuple(sorted(cameras[best].tolist())), ways
        )

    @cached_property
    def _alone(self) -> Array:
        """The mean quality of each option alone, shape (options,)."""
        return qualities_alone(self._problem, self._demand.survive)
