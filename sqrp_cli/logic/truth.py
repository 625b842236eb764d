"""Evaluation of formulas on evidence with gaps: Kleene's three-valued logic over dense time.

A formula is evaluated at t = 0, a nested temporal operator at every instant that its parent needs. Only instants within
[0, total] exist: an `always` with an interval outside is true, an `eventually` false. Unknown counts as neither true
nor false: a decided verdict is the same for every way to fill the gaps in the evidence.

Times are rounded to whole nanoseconds, so that sums of them compare exactly. Values change only there, so that 2 n
stands for the instant n ns, and 2 n + 1 for all instants between it and the next nanosecond.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from itertools import accumulate
from typing import Literal, TypeAlias

from sqrp_cli.logic.formula import Formula, Operator, Predicate
from sqrp_cli.logic.literal import Atom
from sqrp_cli.records import dataclass

TruthWord: TypeAlias = Literal["true", "false", "blind"]
"""A truth value in output about images: `blind` where they show neither."""


class Truth(IntEnum):
    """Kleene's three truth values, ordered so that `and` is the minimum and `or` the maximum."""

    FALSE = -1
    UNKNOWN = 0
    TRUE = 1

    def __invert__(self) -> Truth:
        """Negation; unknown stays unknown."""
        return Truth(-self)

    @property
    def word(self) -> TruthWord:
        """Its name in output about images."""
        return "blind" if self is Truth.UNKNOWN else "true" if self is Truth.TRUE else "false"


@dataclass(frozen=True)
class Signal:
    """A truth value for every instant of [0, total]."""

    starts: tuple[int, ...]  # From when on each value holds, in half nanoseconds as said above, ascending from 0 on
    values: tuple[Truth, ...]

    def at(self, half: int) -> Truth:
        """The value at an instant or between two, in half nanoseconds as said above."""
        return self.values[bisect_right(self.starts, half) - 1]


Sample: TypeAlias = tuple[float, Mapping[Atom, Truth]]
"""A time [s], and truth values of atoms from then on; an atom that is not in it is unknown."""


def evaluate(formula: Formula, samples: Sequence[Sample], end: float, whole: float) -> Signal:
    """The value of a bound formula at every instant from 0 to `whole` [s]; that at 0 is the verdict.

    samples: in order of time; each holds to the next one's time, excluded, and the last one up to `end` [s], included.
    Before the first sample and after `end` everything is unknown. Raises ValueError if a bound of an interval is no
    number (see `with_times`).
    """
    total = 2 * nanoseconds(whole)
    if isinstance(formula, Predicate):
        atom, last = formula.atom, 2 * nanoseconds(end)
        times = [2 * nanoseconds(time) for time, _ in samples]

        def shown(half: int) -> Truth:
            index = bisect_right(times, half) - 1
            values = samples[index][1] if index >= 0 and half <= last else {}
            return values.get(atom, Truth.UNKNOWN)

        return _signal((*times, last + 1), shown, total)
    parts = [evaluate(part, samples, end, whole) for part in formula.parts]
    operator, starts = formula.operator, [start for part in parts for start in part.starts]
    if formula.interval is None:
        return _signal(starts, lambda half: joined(operator, [part.at(half) for part in parts]), total)
    bounds = (formula.interval.start, formula.interval.end)
    if named := [str(bound) for bound in bounds if bound.primitive is not None]:
        raise ValueError(f"the bound {named[0]} is no number of seconds")
    first, last = (2 * nanoseconds(bound.offset) for bound in bounds)
    # The value that decides alone, whether it is true of an `eventually` or false of an `always`; what holds without.
    decisive = Truth.TRUE if operator == "eventually" else Truth.FALSE
    counts = [[0, *accumulate(one == value for one in parts[0].values)] for value in (decisive, Truth.UNKNOWN)]

    def over(half: int) -> Truth:
        begin, end = max(half + first, 0), min(half + last, total)
        some = [count[bisect_right(starts, end)] > count[bisect_right(starts, begin) - 1] for count in counts]
        return ~decisive if begin > end or not any(some) else decisive if some[0] else Truth.UNKNOWN

    edges = (start - bound for start in (*starts, total + 1) for bound in (first, last))
    return _signal(edges, over, total)


def joined(operator: Operator, values: Sequence[Truth]) -> Truth:
    """The value of an operator that is not temporal, applied to parts with these values."""
    match operator:
        case "not":
            return ~values[0]
        case "implies":
            return max(~values[0], values[1])
    return min(values) if operator == "and" else max(values)


def _signal(edges: Iterable[int], value: Callable[[int], Truth], total: int) -> Signal:
    """The signal of a value that changes at no other times than `edges`, all in half nanoseconds."""
    kept: dict[int, Truth] = {0: value(0)}
    last = kept[0]
    for edge in sorted({edge for edge in edges if 0 < edge <= total}):
        if (here := value(edge)) != last:
            kept[edge] = last = here
    return Signal(tuple(kept), tuple(kept.values()))


def nanoseconds(seconds: float) -> int:
    """A time [s] in whole nanoseconds."""
    return round(seconds * 1e9)


class Monitor:
    """Evaluates a formula online; decided as soon as `evaluate` decides on the evidence so far. Copies share nothing.

    truth: the latest verdict; it no longer changes once it is decided.
    """

    def __init__(self, formula: Formula, total: float) -> None:
        """Starts without evidence; formula as for `evaluate`, total: duration of the motion [s]."""
        self._formula, self._total = formula, total
        self._samples: tuple[Sample, ...] = ()
        self._last_time = -math.inf
        self.truth = evaluate(formula, (), -1.0, total).at(0)

    def observe(self, time: float, values: Mapping[Atom, Truth]) -> Truth:
        """The verdict with the values from `time` [s] on; the previous sample held until then.

        Raises ValueError for evidence that is not newer than the last.
        """
        if time <= self._last_time:
            raise ValueError(f"evidence at {time} s is not newer than the last at {self._last_time} s")
        self._last_time = time
        if self.truth == Truth.UNKNOWN:
            if not self._samples or self._samples[-1][1] != values:
                self._samples = (*self._samples, (time, dict(values)))
            self.truth = evaluate(self._formula, self._samples, time, self._total).at(0)
        return self.truth
