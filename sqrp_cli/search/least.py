"""The one search for a least change: outward over grids, shorter from what is found, then a fine grid below it.

A kind of change is a `Move`: vectors (d,), each of which stands for a change of one thing. A quick bound lets vectors
pass that may meet the goal, the exact study of the motion decides, and the samples of `explain` confirm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from itertools import product
from math import inf
from typing import NamedTuple, Protocol

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.question import Found, ProposedChange, Question, Tried
from sqrp_cli.study.whole_study import WholeAnalysis

FINE = 16
"""The fine grid has at most so many steps to every side."""

COARSE = {2: 12, 3: 4}
"""Steps of the grid of each shell to every side, by the dimension."""

MOST_MORE = {"m": 0.3, "rad": np.radians(30)}
"""A change is not made larger than the least that was found and this, for its margin or to confirm it."""

_MARGIN_STEPS = 60
"""Steps in which margins are searched where a move names no lengths."""

_TOGETHER = 512
"""Vectors of a grid that are looked through at once."""

_FEW = 32
"""Vectors to test at once where the next ones may pass; twice as many each time that none does."""
_DECIDED = 6
"""Vectors of one batch that pass the bound and are decided, at most; failures sharpen the bound."""
_GIVEN_UP = 4
"""Batches of a fine grid that are given up before all of it is: the bound tells too little of what is decided."""


class Bounds(NamedTuple):
    """How far and how finely changes of a kind are searched."""

    dimension: int
    """Of the vectors."""
    step: float
    """Of the fine grid; a length is found to a tenth of it. In the unit of the vectors."""
    reaches: tuple[float, ...]
    """How far it is searched, one after the other, until something is found."""
    fine: bool
    """Whether a fine grid below the least that was found is looked through."""
    rounds: int = 0
    """Of looks in other directions than that of what is found."""
    directions: int = 0
    """That each of them tries."""
    shares: tuple[float, ...] = ()
    """Of the length so far, that it tries in each direction."""
    margins: tuple[float, ...] = ()
    """By how much longer changes are looked at for the margin; none: all lengths up to `MOST_MORE` beyond, in steps."""


class Move(Protocol):
    """Changes of one thing by vectors (d,); what is learned of one of them makes the bound on others sharper."""

    bounds: Bounds
    """How it is searched."""

    def outward(self, reach: float) -> Iterable[Array]:
        """Batches of vectors (p, d) up to a length, nearer ones first."""

    def passes(self, vectors: Array) -> Mask:
        """Which vectors (p, d) may meet the goal, shape (p,): quick, and never false for one that does."""

    def change(self, vector: Array) -> ProposedChange:
        """The change that a vector stands for, in values that people can set; nearly the same one."""

    def meets(self, change: ProposedChange) -> bool:
        """Whether a change meets the goal, as far as that is about what is seen."""

    def study(self, change: ProposedChange) -> WholeAnalysis | None:
        """The way with a change; None if it cannot be done."""

    def nearest(self) -> Array | None:
        """Of some vectors, none of which meets the goal, the one that comes nearest to it; None if none can be."""


def least_changes(question: Question, moves: Sequence[Callable[[], Move]], none: str, nowhere: str) -> Found:
    """The least change of each target that meets the goal, with its margin; or what comes nearest.

    moves: each makes a move that has learned nothing, so that answers do not depend on what was asked before; of one
    kind. none: why no change meets the goal; nowhere: why none could be tried.
    """
    seed, jobs, numbers, bounds = question.cell.seed, question.jobs, range(len(moves)), moves[0]().bounds

    def searched(vectors: Callable[[Move], Iterable[Array]], most: float) -> dict[int, ProposedChange]:
        """What is found in the vectors of each move."""
        changes = in_processes(lambda number: least(move := moves[number](), vectors(move), seed, most), numbers, jobs)
        return {number: change for number, change in enumerate(changes) if change is not None}

    found: dict[int, ProposedChange] = {}
    for reach in bounds.reaches:
        found = found or searched(lambda move: move.outward(reach), inf)  # noqa: B023 - done at once
    if found and bounds.fine:
        below = fine_grid(bounds, 0.95 * min(change.size for change in found.values()))
        found |= searched(lambda _: [below], _GIVEN_UP)
    best: dict[str, int] = {}
    for number in sorted(found, key=lambda number: found[number].size):
        best.setdefault(found[number].target, number)

    def confirmed(number: int) -> Tried | None:
        """The change, or the least larger one, that meets the goal if sampled as finely as may be."""
        move, first = moves[number](), found[number]
        unit = np.array(first.values[: bounds.dimension]) / first.size

        def tried(length: float) -> Tried | None:
            change = first if length == first.size else move.change(length * unit)
            study = move.study(change)
            return Tried(change, study) if study is not None and question.met_for_sure(change, study) else None

        one, low, high = tried(first.size), first.size, first.size + 0.1 * bounds.step
        if one is None:
            while high <= first.size + MOST_MORE[first.unit] and (one := tried(high)) is None:
                low, high = high, high + 2.0 * (high - low)
            while one is not None and high - low > 0.1 * bounds.step:
                middle = 0.5 * (low + high)
                if (smaller := tried(middle)) is not None:
                    high, one = middle, smaller
                else:
                    low = middle
        return None if one is None else one._replace(margin=margin(move, one.change))

    if answers := [one for one in in_processes(confirmed, list(best.values()), jobs) if one is not None]:
        return answers, ""

    def nearest(number: int) -> Tried | None:
        move = moves[number]()
        if (vector := move.nearest()) is None:
            return None
        study = move.study(change := move.change(vector))
        return None if study is None else Tried(change, study)

    near = [one for one in in_processes(nearest, numbers, jobs) if one is not None]
    return near, none if near else nowhere


def margin(move: Move, change: ProposedChange) -> Margin:
    """How much less and how much more of a change along the same direction meets the goal."""
    size, bounds = change.size, move.bounds
    unit = np.array(change.values[: bounds.dimension]) / size

    def unbroken(lengths: Array) -> float:
        """The last of some lengths, going away, up to which all pass, and which is confirmed exactly."""
        for patient in (True, True, True, *(False for _ in lengths)):
            passed = int(np.argmin(np.append(move.passes(lengths[:, None] * unit), False)))
            if not passed:
                break
            tried = move.change(lengths[passed - 1] * unit)
            if tried.size and move.meets(tried):
                return float(lengths[passed - 1])
            lengths = lengths[: passed - 1 if patient else passed // 2]  # the failure has made the bound sharper
        return size

    lengths = size + np.array(bounds.margins)
    if not bounds.margins:
        lengths = np.linspace(0.0, size + MOST_MORE[change.unit], _MARGIN_STEPS)
    more, less = unbroken(lengths[lengths > size]), unbroken(lengths[lengths < size][::-1])
    return Margin(less=abs(size - less), more=abs(more - size))


def least(move: Move, batches: Iterable[Array], seed: int, most: float = inf) -> ProposedChange | None:
    """The first vector of the batches that meets the goal, made as short as a way down from it can.

    most: batches of `_TOGETHER` that are given up before all of the search is.
    """
    given_up = 0
    for batch in batches:
        for start in range(0, len(batch), _TOGETHER):
            found, decided = _first_of(move, batch[start : start + _TOGETHER])
            if found is not None:
                return move.change(_made_shorter(move, found, seed))
            given_up += decided == _DECIDED
            if given_up >= most:
                return None
    return None


def _first_of(move: Move, vectors: Array) -> tuple[Array | None, int]:
    """The first of some vectors that does, and how many were decided that do not: `_DECIDED` at most.

    Those make the bound on the next ones sharper, so few are tested at once as long as they pass.
    """
    begin, count, decided = 0, _FEW, 0
    while begin < len(vectors):
        left = vectors[begin : begin + count]
        begin, count = begin + count, 2 * count
        while len(left := left[move.passes(left)]):
            if move.meets(move.change(left[0])):
                return left[0], decided
            decided, left, count = decided + 1, left[1:], _FEW
            if decided == _DECIDED:
                return None, decided
    return None, decided


def _made_shorter(move: Move, found: Array, seed: int) -> Array:
    """A local least vector that does, from one that does: shorter along its direction, then along others around it."""

    def shorter(vector: Array) -> Array:
        length, low = float(np.linalg.norm(vector)), 0.0
        unit = vector / length
        while length - low > 0.1 * move.bounds.step:
            middle = 0.5 * (low + length)
            does = move.passes(middle * unit[None])[0] and move.meets(move.change(middle * unit))
            low, length = (low, middle) if does else (middle, length)
        return length * unit

    bounds, rng, spread, found = move.bounds, np.random.default_rng(seed), 0.5, shorter(found)
    shares = np.sort(bounds.shares)[:, None, None]
    for _ in range(bounds.rounds):
        length = np.linalg.norm(found)
        sideways = rng.normal(size=(bounds.directions, bounds.dimension)) / np.sqrt(bounds.dimension)
        turned = found / length + spread * sideways
        turned /= np.linalg.norm(turned, axis=1)[:, None]
        aside, _ = _first_of(move, (length * shares * turned).reshape(-1, bounds.dimension))
        if aside is not None:
            found = shorter(aside)
        elif (spread := 0.5 * spread) < 0.02:
            break
    return found


def fine_grid(bounds: Bounds, length: float) -> Array:
    """Vectors (p, d) of a fine grid up to a length, coarser than asked for beyond `FINE` of its steps."""
    points = grid(bounds.dimension, FINE) * max(bounds.step, length / FINE)
    lengths = np.linalg.norm(points, axis=1)
    near: Array = points[(lengths > 0) & (lengths <= length * (1 + 1e-9))]
    return near


def shells(dimension: int, step: float, reach: float) -> Iterator[Array]:
    """Vectors (p, d) on grids around zero, nearer ones first: the farther out, the coarser."""
    inner = step
    while inner < reach:
        outer = min(2.0 * inner, reach)
        points = grid(dimension, COARSE[dimension]) * (2.0 * inner / COARSE[dimension])
        lengths = np.linalg.norm(points, axis=1)
        yield points[(lengths > inner * (1 + 1e-9)) & (lengths <= outer * (1 + 1e-9))]
        inner = outer


@cache
def grid(dimension: int, most: int) -> Array:
    """Whole-numbered vectors up to a length, shortest first; equal ones in the order of their coordinates."""
    points = np.array(list(product(range(-most, most + 1), repeat=dimension)), dtype=float)
    lengths = np.linalg.norm(points, axis=1)
    near: Array = points[lengths <= most * (1 + 1e-9)]
    return near[np.argsort(np.linalg.norm(near, axis=1), kind="stable")]
