"""Evaluation of formulas on evidence with gaps: Kleene's three-valued logic over dense time.

A formula is evaluated at t = 0, a nested temporal operator at every instant that its parent needs. Only instants within
[0, total] exist: an `always` with an interval outside is true, an `eventually` false. Unknown counts as neither true
nor false: a decided verdict is the same for every way to fill the gaps in the evidence. Times are rounded to whole
nanoseconds, so that sums of them compare exactly.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from enum import IntEnum
from itertools import accumulate, chain

from sqrp_cli.logic.formula import Always, And, Eventually, Formula, Implies, Interval, Not, Or, Predicate, children
from sqrp_cli.logic.literal import Atom
from sqrp_cli.records import dataclass


class Truth(IntEnum):
    """Kleene's three truth values, ordered so that `and` is the minimum and `or` the maximum."""

    FALSE = -1
    UNKNOWN = 0
    TRUE = 1

    def __invert__(self) -> Truth:
        """Negation; unknown stays unknown."""
        return Truth(-self)

    @property
    def word(self) -> str:
        """Its name in output about images: `true`, `false`, or `blind`."""
        return "blind" if self is Truth.UNKNOWN else self.name.lower()


def nanoseconds(seconds: float) -> int:
    """A time [s] in whole nanoseconds."""
    return round(seconds * 1e9)


@dataclass(frozen=True)
class Signal:
    """A truth value for every instant of [0, total]."""

    times: tuple[int, ...]
    """Instants at which the value may change [ns], ascending, from 0 to total."""
    values: tuple[Truth, ...]
    """Values at the first time, in the open gap after it, at the second, and so on; 2 n - 1 values for n times."""

    def at(self, time: float) -> Truth:
        """The value at a time [s] in [0, total]."""
        return self.values[self._cell(nanoseconds(time))]

    def _cell(self, time: int) -> int:
        index = bisect_right(self.times, time) - 1
        return 2 * index + (self.times[index] != time)

    def _resampled(self, times: Sequence[int]) -> list[Truth]:
        """The values at `times`, which include the signal's own, and in the gaps between them."""
        points = [self.values[self._cell(time)] for time in times]
        gaps = [self.values[2 * bisect_right(self.times, time) - 1] for time in times[:-1]]
        return [value for pair in zip(points, [*gaps, points[-1]], strict=True) for value in pair][:-1]


def step_signal(steps: Sequence[tuple[int, Truth]], end: int, total: int) -> Signal:
    """The signal that takes each value from its time [ns] on until the next one's, the last up to `end` [ns], included.

    Unknown before the first and after the end. steps: in order of time; they and the end may lie outside [0, total].
    """
    inside = sorted({0, total, *(time for time in (end, *(time for time, _ in steps)) if 0 <= time <= total)})
    starts = [time for time, _ in steps]

    def after(time: int) -> Truth:
        index = bisect_right(starts, time)
        return steps[index - 1][1] if index else Truth.UNKNOWN

    points = [after(time) if time <= end else Truth.UNKNOWN for time in inside]
    gaps = [after(time) if time < end else Truth.UNKNOWN for time in inside]
    return _simplified(inside, [value for pair in zip(points, gaps, strict=True) for value in pair][:-1])


def combine(signals: Sequence[Signal], join: Callable[[Iterable[Truth]], Truth]) -> Signal:
    """Joins the values of several signals instant by instant."""
    times = sorted(set(chain.from_iterable(signal.times for signal in signals)))
    columns = zip(*(signal._resampled(times) for signal in signals), strict=True)
    return _simplified(times, [join(column) for column in columns])


def negated(signal: Signal) -> Signal:
    """The opposite value at each instant."""
    return Signal(signal.times, tuple(~value for value in signal.values))


def always(signal: Signal, start: int, end: int) -> Signal:
    """At each instant t the least value of the signal in the part of [t + start, t + end] [ns] within [0, total].

    True where that part is empty.
    """
    total = signal.times[-1]
    shifted = (time - bound for time in signal.times for bound in (start, end))
    times = sorted({0, total, *(time for time in shifted if 0 <= time <= total)})
    count_false = [0, *accumulate(value == Truth.FALSE for value in signal.values)]
    count_unknown = [0, *accumulate(value == Truth.UNKNOWN for value in signal.values)]

    def least(first: int, last: int) -> Truth:
        if count_false[last + 1] > count_false[first]:
            return Truth.FALSE
        return Truth.UNKNOWN if count_unknown[last + 1] > count_unknown[first] else Truth.TRUE

    def at(time: int) -> Truth:
        if time + end < 0 or time + start > total:
            return Truth.TRUE
        return least(signal._cell(max(time + start, 0)), signal._cell(min(time + end, total)))

    def gap_after(time: int) -> int:
        return 2 * bisect_right(signal.times, time) - 1

    def within(left: int) -> Truth:
        """The value in the gap that begins at `left`: the window's ends stay in one cell of the signal each."""
        if left + end < 0 or left + start >= total:
            return Truth.TRUE
        first = 0 if left + start < 0 else gap_after(left + start)
        last = len(signal.values) - 1 if left + end >= total else gap_after(left + end)
        return least(first, last)

    values = [value for left in times for value in (at(left), within(left))][:-1]
    return _simplified(times, values)


def _simplified(times: Sequence[int], values: Sequence[Truth]) -> Signal:
    """The signal without the times at which nothing changes."""
    kept_times, kept_values = [times[0]], [values[0]]
    for index in range(1, len(times)):
        before, here = values[2 * index - 1], values[2 * index]
        last = index == len(times) - 1
        if last or not before == here == values[2 * index + 1]:
            kept_times.append(times[index])
            kept_values += [before, here]
    return Signal(tuple(kept_times), tuple(kept_values))


@dataclass(frozen=True)
class TraceSample:
    """Truth values of atoms from a time [s] on, until the next sample; an atom that is not in it is unknown."""

    time: float
    values: Mapping[Atom, Truth]


@dataclass(frozen=True)
class Trace:
    """Evidence about atoms over the time [0, total] [s]."""

    samples: tuple[TraceSample, ...]
    """In order of time.

    Each holds from its time, included, to the next one's, excluded, and the last one up to `end`, included. Before the
    first sample and after `end` everything is unknown.
    """
    end: float
    total: float


@dataclass(frozen=True)
class FormulaVerdict:
    """A formula with its truth value at every instant, and the same for its direct sub-formulas."""

    formula: Formula
    signal: Signal
    parts: tuple[FormulaVerdict, ...]

    @property
    def truth(self) -> Truth:
        """The verdict on the formula as a whole: its value at t = 0."""
        return self.signal.values[0]


def evaluate(formula: Formula, trace: Trace) -> FormulaVerdict:
    """The verdict on a bound formula whose intervals are numbers (see `with_times`) and on all its sub-formulas."""
    parts = tuple(evaluate(part, trace) for part in children(formula))
    return FormulaVerdict(formula, _signal(formula, [part.signal for part in parts], trace), parts)


class Monitor:
    """Evaluates a formula online; decided as soon as `evaluate` decides on the evidence so far.

    verdict: the latest one; it no longer changes once its truth is decided.
    """

    def __init__(self, formula: Formula, total: float) -> None:
        """Starts without evidence; formula as for `evaluate`, total: duration of the motion [s]."""
        self._formula = formula
        self._samples: list[TraceSample] = []
        self._last_time = -math.inf
        self._total = total
        self.verdict = self._judge(-1.0)

    def observe(self, time: float, values: Mapping[Atom, Truth]) -> FormulaVerdict:
        """The verdict with the values from `time` [s] on; the previous sample held until then.

        Raises ValueError for evidence that is not newer than the last.
        """
        if time <= self._last_time:
            raise ValueError(f"evidence at {time} s is not newer than the last at {self._last_time} s")
        self._last_time = time
        if self.verdict.truth == Truth.UNKNOWN:
            if not self._samples or self._samples[-1].values != values:
                self._samples.append(TraceSample(time, dict(values)))
            self.verdict = self._judge(time)
        return self.verdict

    def copy(self) -> Monitor:
        """An independent copy with the same evidence."""
        found = copy(self)
        found._samples = list(self._samples)
        return found

    def _judge(self, end: float) -> FormulaVerdict:
        return evaluate(self._formula, Trace(tuple(self._samples), end, self._total))


def _signal(formula: Formula, parts: list[Signal], trace: Trace) -> Signal:
    match formula:
        case Predicate():
            steps = [
                (nanoseconds(sample.time), sample.values.get(formula.atom, Truth.UNKNOWN)) for sample in trace.samples
            ]
            return step_signal(steps, nanoseconds(trace.end), nanoseconds(trace.total))
        case Not():
            return negated(parts[0])
        case And():
            return combine(parts, min)
        case Or():
            return combine(parts, max)
        case Implies():
            return combine([negated(parts[0]), parts[1]], max)
        case Always(interval):
            return always(parts[0], *_bounds(interval))
        case Eventually(interval):
            return negated(always(negated(parts[0]), *_bounds(interval)))


def _bounds(interval: Interval) -> tuple[int, int]:
    for bound in (interval.start, interval.end):
        if bound.primitive is not None:
            raise ValueError(f"the bound {bound} is no number of seconds")
    return nanoseconds(interval.start.offset), nanoseconds(interval.end.offset)
