"""The choice of cameras and ways as a problem: what may be chosen, what limits it, what is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.placing.cover import NEVER, Cover, CoveredWay

Objective = Literal["least", "mean"]
OBJECTIVES: tuple[Objective, ...] = ("least", "mean")


@dataclass(frozen=True, eq=False, kw_only=True)
class Demand:
    """What is wanted of the cameras."""

    wish: Wish | None = None
    """What every candidate has to reach; then as few cameras as possible."""
    most: int | None = None
    """Most cameras on mounts; None: no limit."""
    needed: int = 0
    """Fewest cameras on mounts, unless `most` is less: so many a skill needs at once, in whatever task."""
    objective: Objective = "least"
    """Whether the least quality counts first, or the mean."""
    survive: int = 0
    """So many cameras may fail: only what is seen then still counts as seen."""
    budget: float | None = None
    """Most that the cameras may cost; None: no limit."""

    @property
    def at_least(self) -> int:
        """Fewest cameras on mounts."""
        return self.needed if self.most is None else min(self.needed, self.most)


class Hiding(NamedTuple):
    """A place where a camera stands in the sight of others."""

    place: int
    """By index."""
    options: tuple[int, ...]
    """At one other place: those from which it hides something that they see."""
    way: int
    """In which motion."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Placing:
    """What may be chosen, and what that leads to. Options and ways are named by index."""

    cover: Cover
    candidates: tuple[tuple[int, ...], ...]
    """The ways of each candidate, one of which is taken."""
    weights: Array
    """How much each candidate counts in the mean, shape (candidates,)."""
    spot: Indices
    """The place of each option, at which there is room for one, shape (options,)."""
    price: Array
    """Shape (options,)."""
    kept: frozenset[int] = frozenset()
    """Options that are there already: always chosen, and not counted."""
    apart: frozenset[tuple[int, int]] = frozenset()
    """Pairs of places that cannot both have a camera."""
    blocked: frozenset[tuple[int, int]] = frozenset()
    """Places with the ways in which the robot would touch a camera there."""
    hiding: frozenset[Hiding] = frozenset()
    """Choices in which one camera hides something from another one; none of them counts."""

    @property
    def count(self) -> int:
        """How many options there are."""
        return len(self.spot)

    def ways_of(self, candidate: int) -> Sequence[CoveredWay]:
        """The ways of a candidate."""
        return [self.cover.ways[number] for number in self.candidates[candidate]]


@dataclass(frozen=True, eq=False)
class Choice:
    """Cameras, and a way for each candidate, by index."""

    options: tuple[int, ...]
    """Those on mounts; kept ones are not named."""
    ways: tuple[int, ...]

    def covered(self, problem: Placing) -> Mask:
        """The rows that are covered, shape (rows,)."""
        return problem.cover.table.covered([*self.options, *sorted(problem.kept)])


@dataclass(frozen=True, eq=False, kw_only=True)
class Worth:
    """What a choice is worth at the samples."""

    least: float
    """The least of all qualities, Q_eoi and Q_avg of every candidate, in 0..1."""
    mean: float
    """Their mean, by weight."""
    delay: float
    """The longest time until a fault is noticed [s]."""
    price: float
    qualities: tuple[tuple[float | None, float | None], ...] = field(default=())
    """Q_eoi and Q_avg of each candidate."""

    def of(self, objective: Objective) -> float:
        """The quality that counts first."""
        return self.least if objective == "least" else self.mean


def worth_of(problem: Placing, choice: Choice) -> Worth:
    """What a choice is worth."""
    covered = choice.covered(problem)
    cover = problem.cover
    taken = [cover.ways[number] for number in choice.ways]
    qualities = tuple(cover.quality(way, covered) for way in taken)
    known = [[q for q in pair if q is not None] for pair in qualities]
    each = [float(np.mean(of_one)) if of_one else 1.0 for of_one in known]
    total = float(problem.weights.sum())
    return Worth(
        least=min((q for of_one in known for q in of_one), default=1.0),
        mean=float(problem.weights @ np.array(each)) / total if total > 0 else 1.0,
        delay=max((cover.delay(way, covered) for way in taken), default=0.0),
        price=float(problem.price[list(choice.options)].sum()),
        qualities=qualities,
    )


def greedy(problem: Placing, demand: Demand, most: int) -> Choice:
    """Cameras one by one, each the one that helps most, with the ways that are best for them.

    It shows what the exact search gains.
    """
    gain, options = _Gain(problem, demand), list[int]()
    while len(options) < most:
        better = gain.best_with(options)
        if better is None:
            break
        options.append(better)
        if gain.worth(options)[0] >= 1.0 and len(options) >= demand.at_least:
            break
    return gain.choice(options)


def improved(problem: Placing, demand: Demand, most: int) -> Choice:
    """The greedy choice, with cameras exchanged one by one as long as that helps: where the exact search begins."""
    gain = _Gain(problem, demand)
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


_EXCHANGES = 20
"""Most exchanges of one camera by another one, to find a start."""


def qualities_alone(problem: Placing) -> Array:
    """The mean quality of all candidates with each option alone, in its best ways, shape (options,)."""
    gain = _Gain(problem, Demand(objective="mean"))
    return gain.with_each([])[0]


class _Gain:
    """What each option would add to others, for all options at once."""

    def __init__(self, problem: Placing, demand: Demand) -> None:
        table = problem.cover.table
        self._problem, self._demand = problem, demand
        self._matrix = table.matrix.reshape(-1, problem.count).astype(np.int16)
        self._needed = np.array(table.needed, dtype=np.int16)[:, None]
        self._parts = [self._part(way) for way in problem.cover.ways]
        self._shut = np.zeros((len(problem.cover.ways), problem.count), dtype=bool)
        for place, way in problem.blocked:
            self._shut[way] |= problem.spot == place

    @staticmethod
    def _part(way: CoveredWay) -> tuple[Indices, Indices, Array, bool]:
        """Of a way: the rows of all groups in a row, where each group begins, and what each is worth."""
        groups = [group for group in way.groups if NEVER not in group.rows]
        rows = np.array([row for group in groups for row in group.rows], dtype=np.int64)
        begins = np.cumsum([0, *(len(group.rows) for group in groups)])[:-1]
        shares = [[g.of_interest / way.T_eoi for g in groups]] if way.T_eoi > 0 else []
        shares += [[g.seconds / way.T for g in groups]] if way.T > 0 else []
        return rows, begins, np.array(shares).reshape(len(shares), len(groups)), bool(shares)

    def _qualities(self, seen: Array) -> list[tuple[Array, Array]]:
        """The least and the mean quality of each way, for several sets of cameras, (sets,) each; seen: (rows, sets)."""
        missing, found = seen < self._needed, []
        for rows, begins, shares, asked in self._parts:
            if not asked:
                found.append((np.ones(seen.shape[1]), np.ones(seen.shape[1])))
                continue
            good = np.zeros((len(begins), seen.shape[1]))
            if len(begins):
                good = (~np.logical_or.reduceat(missing[rows], begins, axis=0)).astype(float)
            qualities = shares @ good
            found.append((qualities.min(axis=0), qualities.mean(axis=0)))
        return found

    def _of_all(self, seen: Array, shut: Mask) -> tuple[Array, Array, list[Indices]]:
        """What counts first and second, for several sets of cameras, and the best way of each candidate.

        shut: whether a camera is in the way, shape (ways, sets).
        """
        first_is_least, weights = self._demand.objective == "least", self._problem.weights
        of_way, least, mean, best = self._qualities(seen), [], [], []
        for of_one in self._problem.candidates:
            rough = np.stack([of_way[way][0 if first_is_least else 1] for way in of_one])
            fine = np.stack([of_way[way][1] for way in of_one])
            key = np.where(shut[list(of_one)], -1.0, np.round(rough, 9) + 1e-6 * fine)
            which = key.argmax(axis=0)
            here = np.arange(seen.shape[1])
            usable = key[which, here] >= 0
            least.append(np.where(usable, np.stack([of_way[way][0] for way in of_one])[which, here], -1.0))
            mean.append(np.where(usable, fine[which, here], -1.0))
            best.append(np.array(of_one)[which])
        count, total = seen.shape[1], max(float(weights.sum()), 1e-12)
        lowest = np.min([*least, np.ones(count)], axis=0)
        means = np.where(lowest < 0, -1.0, weights @ np.array(mean).reshape(-1, count) / total)
        return (lowest, means, best) if first_is_least else (means, lowest, best)

    def with_each(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """What counts first and second with each option besides the chosen ones and those that stay, (options,)."""
        fixed = [*chosen, *sorted(self._problem.kept)]
        seen = self._matrix[:, fixed].sum(axis=1, dtype=np.int16)[:, None] + self._matrix
        shut = self._shut | np.any(self._shut[:, list(chosen)], axis=1, keepdims=True)
        first, second, _ = self._of_all(seen, shut)
        return first, second

    def best_with(self, chosen: Sequence[int]) -> int | None:
        """The option that helps most besides the chosen ones; None if none may be added."""
        first, second = self.with_each(chosen)
        allowed = self._allowed(chosen) & (first >= 0)
        if not allowed.any():
            return None
        order = np.lexsort((self._problem.price, -np.round(second, 9), -np.round(first, 9), ~allowed))
        return int(order[0])

    def worth(self, chosen: Sequence[int]) -> tuple[float, float]:
        """What counts first and second with some options and those that stay."""
        first, second, _ = self._together(chosen)
        return round(float(first[0]), 9), round(float(second[0]), 9)

    def choice(self, chosen: Sequence[int]) -> Choice:
        """The options with the best way of each candidate."""
        _, _, best = self._together(chosen)
        return Choice(tuple(sorted(chosen)), tuple(int(ways[0]) for ways in best))

    def _together(self, chosen: Sequence[int]) -> tuple[Array, Array, list[Indices]]:
        seen = self._matrix[:, [*chosen, *sorted(self._problem.kept)]].sum(axis=1, dtype=np.int16)[:, None]
        return self._of_all(seen, np.any(self._shut[:, list(chosen)], axis=1, keepdims=True))

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
