"""The one search for a least change: outward over grids, shorter from what is found, then a fine grid below it.

A quick bound lets vectors pass that may meet the goal, the exact analysis of the motion decides, and the samples of
`explain` confirm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import TypeAlias

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.camera_moves import CameraMove
from sqrp_cli.search.object_moves import ObjectMove
from sqrp_cli.search.question import ProposedChange, Question, Search, Tried
from sqrp_cli.search.vectors import fine_grid

Move: TypeAlias = CameraMove | ObjectMove
"""A kind of change of one thing by vectors (d,):

- `bounds`: how it is searched.
- `outward`: batches of vectors (p, d) up to a length, nearer ones first.
- `passes`: which vectors (p, d) may meet the goal, shape (p,): quick, and never false for one that does. It gets
  sharper by what is learned of one of them.
- `change`: the change that a vector stands for, in values that people can set; nearly the same one.
- `meets`: whether a change meets the goal, as far as that is about what is seen.
- `analysed`: the way with a change; None if it cannot be done.
- `nearest`: of some vectors, none of which meets the goal, the one that comes nearest to it; None if none can be.
"""

MOST_MORE = {"m": 0.3, "rad": np.radians(30)}
"""A change is not made larger than the least that was found and this, for its margin or to confirm it."""
_MARGIN_STEPS = 60  # Steps in which margins are searched where a move names no lengths
_TOGETHER = 512  # Vectors of a grid that are looked through at once
_FEW = 32  # Vectors to test at once where the next ones may pass; twice as many each time that none does
_DECIDED = 6  # Vectors of one batch that pass the bound and are decided, at most; failures sharpen the bound
_GIVEN_UP = 4
"""Batches of a fine grid that are given up before all of it is: the bound tells too little of what is decided."""


def least_changes(question: Question, moves: Sequence[Callable[[], Move]], none: str, nowhere: str) -> Search:
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
    sure = in_processes(lambda number: confirmed(question, moves[number](), found[number]), list(best.values()), jobs)
    if answers := [one for one in sure if one is not None]:
        return answers, ""

    def nearest(number: int) -> Tried | None:
        move = moves[number]()
        vector = move.nearest()
        change = None if vector is None else move.change(vector)
        analysis = None if change is None else move.analysed(change)
        return None if change is None or analysis is None else Tried(change, analysis)

    near = [one for one in in_processes(nearest, numbers, jobs) if one is not None]
    return near, none if near else nowhere


def confirmed(question: Question, move: Move, found: ProposedChange) -> Tried | None:
    """A change, or the least larger one, that meets the goal if sampled as finely as may be, with its margin."""
    unit, shortest = np.array(found.values[: move.bounds.dimension]) / found.size, 0.1 * move.bounds.step
    low = high = length = found.size
    longer = shortest
    met: Tried | None = None
    # Ever longer until one meets it, then by bisection between that and the longest one that does not.
    while length <= found.size + MOST_MORE[found.unit] if met is None else high - low > shortest:
        change = found if length == found.size else move.change(length * unit)
        analysis = move.analysed(change)
        if analysis is not None and question.met_for_sure(tried := Tried(change, analysis)):
            met, high = tried, length
        else:
            low = length
        if met is None:
            length, longer = low + longer, 2.0 * longer
        else:
            length = 0.5 * (low + high)
    return None if met is None else met._replace(margin=margin(move, met.change))


def margin(move: Move, change: ProposedChange) -> Margin:
    """How much less and how much more of a change along the same direction meets the goal."""
    size, bounds, ends = change.size, move.bounds, list[float]()
    unit = np.array(change.values[: bounds.dimension]) / size
    lengths = size + np.array(bounds.margins)
    if not bounds.margins:
        lengths = np.linspace(0.0, size + MOST_MORE[change.unit], _MARGIN_STEPS)
    for away in (lengths[lengths > size], lengths[lengths < size][::-1]):
        # The last of these lengths up to which all pass, and which is confirmed exactly. After three that are not, the
        # lengths that are left are halved each time.
        end = size
        for patient in (True, True, True, *(False for _ in away)):
            passed = int(np.argmin(np.append(move.passes(away[:, None] * unit), False)))
            if not passed:
                break
            tried = move.change(away[passed - 1] * unit)
            if tried.size and move.meets(tried):
                end = float(away[passed - 1])
                break
            away = away[: passed - 1 if patient else passed // 2]  # the failure has made the bound sharper
        ends.append(end)
    return Margin(less=abs(size - ends[1]), more=abs(ends[0] - size))


def least(move: Move, batches: Iterable[Array], seed: int, most: float = inf) -> ProposedChange | None:
    """The first vector of the batches that meets the goal, made as short as a way down from it can.

    most: batches of `_TOGETHER` that are given up before all of the search is.
    """
    given_up, found = 0, None
    tested = (batch[start : start + _TOGETHER] for batch in batches for start in range(0, len(batch), _TOGETHER))
    for some in tested:
        found, decided = _first_of(move, some)
        given_up += decided == _DECIDED
        if found is not None or given_up >= most:
            break
    if found is None:
        return None
    # A local least vector that meets the goal, from this one: shorter along its direction, then others around.
    bounds, rng, spread = move.bounds, np.random.default_rng(seed), 0.5
    aside: Array | None = found
    shares = np.sort(bounds.shares)[:, None, None]
    for left in range(bounds.rounds, -1, -1):
        if aside is not None:
            length, low = float(np.linalg.norm(aside)), 0.0
            unit = aside / length
            while length - low > 0.1 * bounds.step:
                middle = 0.5 * (low + length)
                met = move.passes(middle * unit[None])[0] and move.meets(move.change(middle * unit))
                low, length = (low, middle) if met else (middle, length)
            found = length * unit
        elif (spread := 0.5 * spread) < 0.02:
            break
        if left:
            length = float(np.linalg.norm(found))
            sideways = rng.normal(size=(bounds.directions, bounds.dimension)) / np.sqrt(bounds.dimension)
            turned = found / length + spread * sideways
            turned /= np.linalg.norm(turned, axis=1)[:, None]
            aside, _ = _first_of(move, (length * shares * turned).reshape(-1, bounds.dimension))
    return move.change(found)


def _first_of(move: Move, vectors: Array) -> tuple[Array | None, int]:
    """The first of some vectors that meets the goal, and how many before it were decided in vain: `_DECIDED` at most.

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
