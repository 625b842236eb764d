"""The fastest way through a sequence of stations, of which each offers several branches."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.geometry import Array

TIE_DECIMALS = 6
"""Total times that agree to so many decimals of a second are ties; joint values are compared as coarsely."""

Question = tuple[int, int, int]
"""Whether something works: index of a station, of a branch of the one before (-1 for none), and of its own branch."""


@dataclass(frozen=True, eq=False)
class Station:
    """The ways of doing one part of the motion: k branches that begin and end at given joint positions.

    q_start, q_end: shape (k, n). duration: between them, shape (k,) [s].
    """

    q_start: Array
    q_end: Array
    duration: Array


def fastest_sequence(
    stations: Sequence[Station],
    move_durations: Sequence[Array],
    works: Callable[[int, int, int], bool],
    way_works: Callable[[int, int, int], bool] | None = None,
) -> tuple[int, ...] | None:
    """The branch of each station with which the whole takes the shortest time, ties by lexicographic joint values.

    move_durations: of the moves from each branch of a station to each of the next one, shape (k_i, k_i+1) [s] each.
    works(i, previous, branch): whether a branch of station i and the move to it from the one before can be done. It is
    asked for the most promising sequences only, once for each question. None when no sequence works.
    way_works(i, previous, branch): whether there is a way around where `works` says no, asked in the same manner. For
    the choice of the sequence, a way counts as taking twice as long as the move that it replaces.

    A* search: the time still to go, ignoring what does not work, is exact by dynamic programming, so that sequences are
    completed in the order of their total times.
    """
    to_go = [station.duration for station in stations]
    for i in reversed(range(len(stations) - 1)):
        to_go[i] = to_go[i] + (move_durations[i] + to_go[i + 1]).min(axis=1, initial=np.inf)
    keys = [np.round(station.q_start, TIE_DECIMALS).tolist() for station in stations]
    asked: dict[Question, bool] = {}
    ways_asked: dict[Question, bool] = {}

    def successors(spent: float, chosen: tuple[int, ...], key: tuple[float, ...]) -> Iterator[_Entry]:
        """The sequences that go one station further, in the order of their bounds."""
        i = len(chosen)
        begun = np.full(len(to_go[i]), spent) if i == 0 else spent + move_durations[i - 1][chosen[-1]]
        bounds = np.round(begun + to_go[i], TIE_DECIMALS)
        durations = stations[i].duration
        entries = [
            _Entry(float(bounds[k]), (*key, *keys[i][k]), (*chosen, int(k)), float(begun[k] + durations[k]), False)
            for k in np.flatnonzero(np.isfinite(bounds))
        ]
        return iter(sorted(entries, key=lambda entry: (entry.bound, entry.key)))

    heap: list[tuple[float, tuple[float, ...], tuple[int, ...], bool, _Entry, Iterator[_Entry]]] = []

    def push_next(siblings: Iterator[_Entry]) -> None:
        entry = next(siblings, None)
        if entry is not None:
            heapq.heappush(heap, (entry.bound, entry.key, entry.chosen, entry.around, entry, siblings))

    push_next(successors(0.0, (), ()))
    while heap:
        *_, entry, siblings = heapq.heappop(heap)
        push_next(siblings)
        i = len(entry.chosen) - 1
        question = (i, entry.chosen[-2] if i else -1, entry.chosen[-1])
        answers = ways_asked if entry.around else asked
        if question not in answers:
            answers[question] = (way_works if entry.around and way_works else works)(*question)
        if not answers[question]:
            if way_works is not None and i > 0 and not entry.around:
                again = float(move_durations[i - 1][question[1], question[2]])
                bound = round(entry.bound + again, TIE_DECIMALS)
                push_next(iter([replace(entry, bound=bound, spent=entry.spent + again, around=True)]))
            continue
        if len(entry.chosen) == len(stations):
            return entry.chosen
        push_next(successors(entry.spent, entry.chosen, entry.key))
    return None


@dataclass(frozen=True)
class _Entry:
    """A sequence of branches so far: a bound of the total time, its joint values, and the time spent until its end.

    around: whether the last move is to be a way around.
    """

    bound: float
    key: tuple[float, ...]
    chosen: tuple[int, ...]
    spent: float
    around: bool
