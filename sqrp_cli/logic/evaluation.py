"""Evaluation of formulas on evidence with gaps: Kleene's three-valued logic over dense time.

A formula is evaluated at t = 0, a nested temporal operator at every instant that its parent needs. Only instants within
[0, total] exist: an `always` with an interval outside is true, an `eventually` false. Unknown counts as neither true
nor false: a decided verdict is the same for every way to fill the gaps in the evidence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy

from sqrp_cli.logic.formula import Always, And, Eventually, Formula, Implies, Interval, Not, Or, Predicate, children
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Signal, Truth, always, combine, nanoseconds, negated, step_signal
from sqrp_cli.records import dataclass


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
