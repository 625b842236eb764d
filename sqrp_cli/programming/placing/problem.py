"""The choice of cameras and ways as a problem: what may be chosen, what limits it, what is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.placing.cover import Cover, CoveredWay

Objective = Literal["least", "mean"]
OBJECTIVES: tuple[Objective, ...] = ("least", "mean")


@dataclass(frozen=True, eq=False, kw_only=True)
class Demand:
    """What is wanted of the cameras."""

    wish: Wish | None = None
    """What every candidate has to reach; then as few cameras as possible."""
    most: int | None = None
    """Most cameras on mounts; None: no limit."""
    objective: Objective = "least"
    """Whether the least quality counts first, or the mean."""
    survive: int = 0
    """So many cameras may fail: only what is seen then still counts as seen."""
    budget: float | None = None
    """Most that the cameras may cost; None: no limit."""


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
    """Cameras one by one, each the one that helps most, with the first way of every candidate that they allow.

    It is where the exact search begins.
    """
    options: list[int] = []
    ways = tuple(of_one[0] for of_one in problem.candidates)
    gain = _Gain(problem, ways)
    while len(options) < most:
        allowed = _allowed(problem, demand, options, ways)
        if not allowed.any():
            break
        least, mean = gain.with_each([*options, *sorted(problem.kept)])
        first, second = (least, mean) if demand.objective == "least" else (mean, least)
        order = np.lexsort((problem.price, -np.round(second, 9), -np.round(first, 9), ~allowed))
        options.append(int(order[0]))
        if least[order[0]] >= 1.0:
            break
    return Choice(tuple(sorted(options)), ways)


def _allowed(problem: Placing, demand: Demand, options: Sequence[int], ways: Sequence[int]) -> Mask:
    """Which options may be added."""
    taken = set(problem.spot[list(options)].tolist())
    shut = taken | {b for a, b in problem.apart if a in taken} | {a for a, b in problem.apart if b in taken}
    shut |= {place for place, way in problem.blocked if way in ways}
    for hiding in problem.hiding:
        shut |= {hiding.place} if set(hiding.options) & set(options) and hiding.way in ways else set()
    allowed = ~np.isin(problem.spot, sorted(shut))
    for hiding in problem.hiding:
        if hiding.place in taken and hiding.way in ways:
            allowed[list(hiding.options)] = False
    allowed[sorted(problem.kept)] = False
    if demand.budget is not None:
        spent = float(problem.price[list(options)].sum())
        allowed &= problem.price <= demand.budget - spent + 1e-9
    return allowed


def qualities_with_each(problem: Placing, ways: Sequence[int], chosen: Sequence[int]) -> tuple[Array, Array]:
    """The least quality and the mean with each option besides the chosen ones, shape (options,) each."""
    return _Gain(problem, ways).with_each(chosen)


class _Gain:
    """What each option would add to others, for all options at once."""

    def __init__(self, problem: Placing, ways: Sequence[int]) -> None:
        table = problem.cover.table
        self._matrix = table.matrix.astype(np.int64).reshape(-1, problem.count)
        self._needed = np.array(table.needed, dtype=np.int64)[:, None]
        self._weights = problem.weights
        self._parts: list[tuple[Array, Array]] = []
        for number in ways:
            way = problem.cover.ways[number]
            groups = [group for group in way.groups if -1 not in group.rows]
            incidence = np.zeros((len(groups), len(self._matrix)))
            for index, group in enumerate(groups):
                incidence[index, list(group.rows)] = 1.0
            lengths = [[g.of_interest / way.T_eoi for g in groups]] if way.T_eoi > 0 else []
            lengths += [[g.seconds / way.T for g in groups]] if way.T > 0 else []
            self._parts.append((incidence, np.array(lengths).reshape(len(lengths), len(groups))))

    def with_each(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """The least quality and the mean with each option besides the chosen ones, shape (options,) each."""
        seen = self._matrix[:, list(chosen)].sum(axis=1)[:, None] + self._matrix
        seen[:, list(chosen)] = self._matrix[:, list(chosen)].sum(axis=1)[:, None]
        missing = (seen < self._needed).astype(float)
        qualities = [lengths @ (incidence @ missing < 0.5) for incidence, lengths in self._parts]
        count = self._matrix.shape[1]
        least = np.min(np.concatenate([*qualities, np.ones((1, count))]), axis=0)
        means = np.array([q.mean(axis=0) if len(q) else np.ones(count) for q in qualities]).reshape(-1, count)
        total = max(float(self._weights.sum()), 1e-12)
        return least, self._weights @ means / total
