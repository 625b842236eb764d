"""The choice of cameras and ways as a problem: what may be chosen, its limits, what is wanted, why nothing is found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.placing.cover import Cover

Objective = Literal["least", "mean"]
OBJECTIVES: tuple[Objective, ...] = ("least", "mean")


@dataclass(frozen=True, kw_only=True)
class FewestPossible:
    """How many cameras there have to be, whatever they see."""

    cameras: int
    """On mounts, besides those that stay."""
    reason: str
    """Such as `inspect` needs two at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Demand:
    """What is wanted of the cameras."""

    wish: Wish | None = None
    """What every candidate has to reach; then as few cameras as possible."""
    most: int | None = None
    """Most cameras on mounts; None: no limit."""
    floor: FewestPossible | None = None
    """Fewest cameras; `most` is not below it. None: any number will do."""
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
    late: Array
    """How long the longest delay of a fault of each way is at least with each option, shape (ways, options) [s]."""
    hiding: frozenset[Hiding] = frozenset()
    """Choices in which one camera hides something from another one; none of them counts."""
    missing: frozenset[tuple[int, ...]] = frozenset()
    """Sets of options, each in order, that are not to be chosen."""

    @property
    def count(self) -> int:
        """How many options there are."""
        return len(self.spot)

    def at_least(self, demand: Demand) -> int:
        """The fewest cameras on mounts with which anything is seen, and not fewer than are demanded."""
        floor = 0 if demand.floor is None else demand.floor.cameras
        return max(floor, 1 + demand.survive - len(self.kept), 0)

    def least_delay(self, choice: Choice) -> float:
        """What the longest delay of a choice is at least, however well its cameras see [s]."""
        together = [*choice.options, *sorted(self.kept)]
        return float(self.late[np.ix_(choice.ways, together)].max(initial=0.0))


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
    """The longest time until a fault is noticed, as if a lost part had parted at once [s]."""
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


def obstacle(problem: Placing, demand: Demand, *, blind: bool) -> str:
    """Why not even the fewest cameras that are needed can be chosen, in one sentence.

    blind: whether some can, but see nothing that counts.
    """
    if blind:
        fails = ", if one of them fails" if demand.survive else ""
        return f"all qualities of all candidates would stay 0.0 %{fails}"
    free = np.array([option for option in range(problem.count) if option not in problem.kept], dtype=np.int64)
    places = len(np.unique(problem.spot[free]))
    if not len(free):
        return "at none of the mounts is there a direction for a camera to look in"
    usable: Indices = free[~np.isin(problem.spot[free], sorted(unusable(problem)))]
    if not len(usable):
        mounts = "the only mount is" if places == 1 else f"all {places} mounts are"
        return f"{mounts} in the way: a camera there would touch something"
    needed = max(problem.at_least(demand), 1)
    spots = problem.spot[usable]
    prices = np.sort([problem.price[usable][spots == place].min() for place in np.unique(spots)])  # of each place
    for count, total in enumerate(np.cumsum(prices[:needed]).tolist(), 1):
        if demand.budget is not None and total > demand.budget + 1e-9:
            cheapest = "the cheapest camera costs" if count == 1 else f"the cheapest {count} cameras cost"
            return f"{cheapest} {total:g}, the budget is {demand.budget:g}"
    reason = "" if demand.floor is None else f", and {demand.floor.reason}"
    if len(prices) < needed:
        return f"of {places} mounts only {len(prices)} can be used{reason}"
    return f"no {needed} of the mounts can be used together: cameras there touch or hide each other{reason}"


def unusable(problem: Placing) -> frozenset[int]:
    """The places where a camera is in the way of a candidate in all of its ways."""
    every = [{place for place, way in problem.blocked if way == number} for number in range(len(problem.cover.ways))]
    return frozenset(
        place for of_one in problem.candidates for place in set.intersection(*(every[number] for number in of_one))
    )
