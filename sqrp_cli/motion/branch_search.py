"""The fastest way through a sequence of stations with several branches each."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass

TIE_DECIMALS = 6
"""Total times equal to this many decimals of a second are ties; joint values are rounded alike."""

Question = tuple[int, int, int]
"""Whether something works: index of a station, of a branch of the one before (-1 for none), and of its own branch."""


@dataclass(frozen=True, eq=False)
class Station:
    """The ways of doing one part of the motion: k branches that begin and end at given joint positions."""

    q_start: Array
    q_end: Array
    """Shape (k, n)."""
    duration: Array
    """Between them, shape (k,) [s]."""


def fastest_sequence(
    stations: Sequence[Station],
    move_durations: Sequence[Array],
    works: Callable[[int, int, int], bool] = lambda *_: True,
    way_works: Callable[[int, int, int], bool] | None = None,
) -> tuple[int, ...] | None:
    """The branch of each station with which the whole takes the shortest time, ties by lexicographic joint values.

    move_durations: of the moves from each branch of a station to each of the next one, shape (k_i, k_i+1) [s] each.
    works(i, previous, branch): whether a branch of station i and the move to it from the one before are feasible. It is
    called only for the most promising sequences, once for each argument. None when no sequence works.
    way_works(i, previous, branch): whether there is a way around where `works` is false, called in the same manner. In
    the search, a way counts twice the time of the move that it replaces.

    A* search: the remaining time, infeasibility ignored, is exact by dynamic programming, so sequences are completed in
    the order of their total times.
    """
    sequences = _Sequences(stations, move_durations)
    answers: dict[tuple[Question, bool], bool] = {}
    heap: list[tuple[_Sequence, Iterator[_Sequence]]] = []

    def push_next(siblings: Iterator[_Sequence]) -> None:
        if (sequence := next(siblings, None)) is not None:
            heapq.heappush(heap, (sequence, siblings))

    push_next(sequences.beginning())
    while heap:
        sequence, siblings = heapq.heappop(heap)
        push_next(siblings)
        question, ask = sequence.question, way_works if sequence.around and way_works else works
        if (question, sequence.around) not in answers:
            answers[question, sequence.around] = ask(*question)
        if not answers[question, sequence.around]:
            if way_works is not None and len(sequence.chosen) > 1 and not sequence.around:
                push_next(iter([sequences.going_around(sequence)]))
        elif len(sequence.chosen) == len(stations):
            return sequence.chosen
        else:
            push_next(sequences.longer(sequence))
    return None


@dataclass(frozen=True, order=True)
class _Sequence:
    """A sequence of branches so far: a bound of the total time, its joint values, and the time spent until its end."""

    bound: float
    key: tuple[float, ...]
    chosen: tuple[int, ...]
    around: bool
    """Whether the last move is to be a way around."""
    spent: float

    @property
    def question(self) -> Question:
        """The arguments of `works` for its last branch."""
        return len(self.chosen) - 1, self.chosen[-2] if len(self.chosen) > 1 else -1, self.chosen[-1]


class _Sequences:
    """Makes sequences longer, the most promising first."""

    def __init__(self, stations: Sequence[Station], move_durations: Sequence[Array]) -> None:
        self._stations, self._moves = stations, move_durations
        self._to_go = [station.duration for station in stations]
        for i in reversed(range(len(stations) - 1)):
            still_to_go = (move_durations[i] + self._to_go[i + 1]).min(axis=1, initial=np.inf)
            self._to_go[i] = self._to_go[i] + still_to_go
        self._keys = [np.round(station.q_start, TIE_DECIMALS) for station in stations]

    def beginning(self) -> Iterator[_Sequence]:
        """The sequences of one branch, in the order of their bounds."""
        return self._one_further((), (), np.zeros(len(self._to_go[0])))

    def longer(self, sequence: _Sequence) -> Iterator[_Sequence]:
        """The sequences that go one station further, in the order of their bounds."""
        moves = self._moves[len(sequence.chosen) - 1][sequence.chosen[-1]]
        return self._one_further(sequence.chosen, sequence.key, sequence.spent + moves)

    def going_around(self, sequence: _Sequence) -> _Sequence:
        """The same sequence with a way around for its last move."""
        i, previous, branch = sequence.question
        again = float(self._moves[i - 1][previous, branch])
        bound = round(sequence.bound + again, TIE_DECIMALS)
        return replace(sequence, bound=bound, spent=sequence.spent + again, around=True)

    def _one_further(self, chosen: tuple[int, ...], key: tuple[float, ...], begun: Array) -> Iterator[_Sequence]:
        """begun: when each branch of the next station would begin [s]."""
        i = len(chosen)
        bounds = np.round(begun + self._to_go[i], TIE_DECIMALS)
        spent = begun + self._stations[i].duration
        for k in np.lexsort((*self._keys[i].T[::-1], bounds)).tolist():
            if np.isinf(bounds[k]):
                return
            joints = tuple(self._keys[i][k].tolist())
            yield _Sequence(
                bound=float(bounds[k]), key=(*key, *joints), chosen=(*chosen, k), around=False, spent=float(spent[k])
            )
