"""What each camera would add to others: choices made one by one, with which the exact search begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.placing.cover import NEVER, CoveredWay
from sqrp_cli.programming.placing.problem import Choice, Demand, Placing, worth_of


def greedy(problem: Placing, demand: Demand, most: int) -> Choice:
    """Cameras one by one, each the one that helps most, with the ways that are best for them.

    It shows what the exact search gains.
    """
    gain, options = Gain(problem, demand), list[int]()
    while len(options) < most:
        better = gain.best_with(options)
        if better is None:
            break
        options.append(better)
        if gain.worth(options).first >= 1.0 and len(options) >= problem.at_least(demand):
            break
    return gain.choice(options)


def improved(problem: Placing, demand: Demand, most: int) -> Choice:
    """The greedy choice, with cameras exchanged one by one as long as that helps: where the exact search begins."""
    gain = Gain(problem, demand)
    options = list(greedy(problem, demand, most).options)
    worth = gain.worth(options)
    for _ in range(_EXCHANGES):
        for place in range(len(options)):
            others = [*options[:place], *options[place + 1 :]]
            better = gain.best_with(others)
            if better is not None and gain.worth([*others, better]) > worth:
                options = [*others, better]
                worth = gain.worth(options)
                break
        else:
            break
    return gain.choice(options)


def with_useful_cameras(problem: Placing, demand: Demand, choice: Choice) -> Choice:
    """The choice with the cheapest cameras that see most instead of those that add nothing, and only are so many.

    They are the ones without which qualities and delay are the same.
    """
    options = list(choice.options)
    for option in choice.options:
        rest = [one for one in options if one != option]
        without, worth = (worth_of(problem, Choice(tuple(one), choice.ways)) for one in (rest, options))
        if (without.least, without.mean, without.delay) == (worth.least, worth.mean, worth.delay):
            options = [*rest, Gain(problem, demand).spare_with(rest, choice.ways, option)]
    better = Choice(tuple(sorted(options)), choice.ways)
    return choice if better.options in problem.missing else better


_EXCHANGES = 20
"""Most exchanges of one camera by another one, to find a start."""


def qualities_alone(problem: Placing, spare: int = 0) -> Array:
    """The mean quality of all candidates with each option and no other camera, in its best ways, shape (options,).

    spare: so many cameras may fail by the problem, but none does. 0 where an option is in the way.
    """
    gain = Gain(replace(problem, kept=frozenset()), Demand(objective="mean"), failed=spare)
    return np.maximum(gain.with_each([]).first, 0.0)


class WayQuality(NamedTuple):
    """What a way is worth with several sets of cameras, of those of Q_eoi and Q_avg that are defined."""

    least: Array
    """Shape (sets,); 1 where none is defined."""
    mean: Array
    """Shape (sets,); 1 where none is defined."""

    @classmethod
    def of(cls, qualities: Array) -> WayQuality:
        """Of Q_eoi and Q_avg, shape (2, sets), NaN where undefined."""
        defined = np.isfinite(qualities)
        count, total = defined.sum(axis=0), np.where(defined, qualities, 0.0).sum(axis=0)
        mean = np.where(count > 0, total / np.maximum(count, 1), 1.0)
        return cls(np.where(defined, qualities, 1.0).min(axis=0), mean)


class Worths(NamedTuple):
    """What several sets of cameras are worth to all candidates in their best ways; negative where one has none."""

    first: Array
    """What counts first, the least or the mean quality, shape (sets,)."""
    second: Array
    """The other one."""
    ways: list[Indices]
    """The best way of each candidate, shape (sets,) each."""


class SetWorth(NamedTuple):
    """What one set of cameras is worth; see `Worths`."""

    first: float
    second: float


class _Groups(NamedTuple):
    """The groups of a way that can be covered."""

    rows: Indices
    """Those of the first group, those of the next one, and so on."""
    begins: Indices
    """Where each group begins, shape (groups,)."""
    shares: Array
    """What each is worth in Q_eoi and Q_avg, shape (2, groups)."""
    defined: Mask
    """Whether the way has these two, shape (2, 1)."""
    helps: Mask
    """Which options see any row of each, shape (groups, options)."""

    def share(self, missing: Mask) -> Array:
        """What is covered, if some rows are not, (rows, sets); as part of all, (2, sets)."""
        found: Array = self.shares @ (~_any_of_each(missing[self.rows], self.begins)).astype(float)
        return found

    def qualities(self, shares: Array) -> Array:
        """Q_eoi and Q_avg, NaN where undefined, (2, sets)."""
        return np.where(self.defined, np.minimum(1.0, shares), np.nan)


def _any_of_each(rows: Mask, begins: Indices) -> Mask:
    """Whether any row of a group is true, shape (rows of all groups, n); (groups, n)."""
    return np.logical_or.reduceat(rows, begins, axis=0) if len(begins) else rows[:0]


class Gain:
    """What each option would add to others, for all options at once."""

    def __init__(self, problem: Placing, demand: Demand, failed: int = 0) -> None:
        """failed: so many cameras have failed already, of those that may."""
        table = problem.cover.table
        self._problem, self._demand = problem, demand
        self.sees = table.matrix.reshape(-1, problem.count).astype(np.int16)
        """Which options see each row, 0 or 1, shape (rows, options)."""
        self._needed = np.array(table.needed, dtype=np.int16)[:, None] - failed
        self._parts = [self._part(way) for way in problem.cover.ways]
        self.shut = np.zeros((len(problem.cover.ways), problem.count), dtype=bool)
        for place, way in problem.blocked:
            self.shut[way] |= problem.spot == place

    def _part(self, way: CoveredWay) -> _Groups:
        groups = [group for group in way.groups if NEVER not in group.rows]
        rows = np.array([row for group in groups for row in group.rows], dtype=np.int64)
        begins = np.cumsum([0, *(len(group.rows) for group in groups)])[:-1]
        seconds = np.array([[group.of_interest, group.seconds] for group in groups]).reshape(-1, 2).T
        totals = np.array([[way.T_eoi], [way.T]])
        helps = _any_of_each(self.sees[rows] > 0, begins)
        return _Groups(rows, begins, seconds / np.maximum(totals, 1e-12), totals > 0, helps)

    def seen(self, cameras: Indices) -> Array:
        """How many cameras see each row, with those that stay; cameras: of several sets, (sets, n); (rows, sets)."""
        stay = self.sees[:, sorted(self._problem.kept)].sum(axis=1, dtype=np.int16)[:, None]
        found: Array = stay + sum((self.sees[:, column] for column in cameras.T), np.zeros((1, 1), dtype=np.int16))
        return found

    def covered(self, seen: Array) -> Mask:
        """Which rows are covered, (rows, sets)."""
        return seen >= self._needed

    def figures(self, seen: Array) -> list[Array]:
        """Q_eoi and Q_avg of each way for several sets of cameras, NaN where undefined, (2, sets).

        seen: how many cameras of each set see each row, (rows, sets).
        """
        missing = ~self.covered(seen)
        return [part.qualities(part.share(missing)) for part in self._parts]

    def figures_at_most(self, seen: Array, most: Array, more: int, open_: Mask) -> list[Array]:
        """Bounds of the figures with some of the open options, (sets, options), besides; seen: so far, most: with all.

        Time that they add has a row that is not covered yet and that one of them sees: so together they add no more
        than each could, as if it were enough alone.
        """
        missing, still, found = ~self.covered(seen), ~self.covered(most), []
        for part in self._parts:
            lacking = _any_of_each(missing[part.rows], part.begins).astype(float)
            each = np.where(open_, (part.shares[:, None] * lacking.T) @ part.helps, 0.0)  # (2, sets, options)
            gained = -np.partition(-each, min(more, each.shape[2]) - 1, axis=2)[..., :more].sum(axis=2)
            found.append(part.qualities(np.minimum(part.share(missing) + gained, part.share(still))))
        return found

    def _of_all(self, seen: Array, shut: Mask) -> Worths:
        """Of several sets. seen: cameras that see each row, (rows, sets). shut: if one is in the way, (ways, sets)."""
        first_is_least, weights = self._demand.objective == "least", self._problem.weights
        of_way, least, mean, best = [WayQuality.of(pair) for pair in self.figures(seen)], [], [], []
        for of_one in self._problem.candidates:
            least_of = np.stack([of_way[way].least for way in of_one])
            mean_of = np.stack([of_way[way].mean for way in of_one])
            rough = least_of if first_is_least else mean_of
            key = np.where(shut[list(of_one)], -1.0, np.round(rough, 9) + 1e-6 * mean_of)
            which = key.argmax(axis=0)
            here = np.arange(seen.shape[1])
            usable = key[which, here] >= 0
            least.append(np.where(usable, least_of[which, here], -1.0))
            mean.append(np.where(usable, mean_of[which, here], -1.0))
            best.append(np.array(of_one)[which])
        count, total = seen.shape[1], max(float(weights.sum()), 1e-12)
        lowest = np.min([*least, np.ones(count)], axis=0)
        means = np.where(lowest < 0, -1.0, weights @ np.array(mean).reshape(-1, count) / total)
        return Worths(lowest, means, best) if first_is_least else Worths(means, lowest, best)

    def with_each(self, chosen: Sequence[int]) -> Worths:
        """The worth of each option besides the chosen ones and those that stay."""
        fixed = [*chosen, *sorted(self._problem.kept)]
        seen = self.sees[:, fixed].sum(axis=1, dtype=np.int16)[:, None] + self.sees
        shut = self.shut | np.any(self.shut[:, list(chosen)], axis=1, keepdims=True)
        return self._of_all(seen, shut)

    def best_with(self, chosen: Sequence[int]) -> int | None:
        """The option that helps most besides the chosen ones; None if none may be added."""
        first, second, _ = self.with_each(chosen)
        allowed = self._allowed(chosen) & (first >= 0)
        if not allowed.any():
            return None
        order = np.lexsort((self._problem.price, -np.round(second, 9), -np.round(first, 9), ~allowed))
        return int(order[0])

    def spare_with(self, chosen: Sequence[int], ways: Sequence[int], present: int) -> int:
        """The cheapest option besides the chosen ones that sees most alone, no dearer than the present one."""
        allowed = self._allowed(chosen) & (self._problem.price <= self._problem.price[present])
        allowed &= ~np.array(np.any(self.shut[list(ways)], axis=0, keepdims=True))[0]
        if not allowed.any():
            return present
        alone = np.round(qualities_alone(self._problem, self._demand.survive), 9)
        return int(np.lexsort((-alone, self._problem.price, ~allowed))[0])

    def worth(self, chosen: Sequence[int]) -> SetWorth:
        """With some options and those that stay, rounded."""
        found = self._together(chosen)
        return SetWorth(round(float(found.first[0]), 9), round(float(found.second[0]), 9))

    def choice(self, chosen: Sequence[int]) -> Choice:
        """The options with the best way of each candidate."""
        best = self._together(chosen).ways
        return Choice(tuple(sorted(chosen)), tuple(int(ways[0]) for ways in best))

    def _together(self, chosen: Sequence[int]) -> Worths:
        seen = self.sees[:, [*chosen, *sorted(self._problem.kept)]].sum(axis=1, dtype=np.int16)[:, None]
        return self._of_all(seen, np.any(self.shut[:, list(chosen)], axis=1, keepdims=True))

    def _allowed(self, chosen: Sequence[int]) -> Mask:
        """Which options may be added."""
        problem, demand = self._problem, self._demand
        taken = set(problem.spot[list(chosen)].tolist())
        shut = taken | {b for a, b in problem.apart if a in taken} | {a for a, b in problem.apart if b in taken}
        shut |= {hiding.place for hiding in problem.hiding if set(hiding.options) & {*chosen, *problem.kept}}
        allowed: Mask = ~np.isin(problem.spot, sorted(shut))
        for hiding in problem.hiding:
            if hiding.place in taken:
                allowed[list(hiding.options)] = False
        allowed[sorted(problem.kept)] = False
        if demand.budget is not None:
            allowed &= problem.price <= demand.budget - float(problem.price[list(chosen)].sum()) + 1e-9
        return allowed
