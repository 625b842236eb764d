"""When formulas apply: intervals of temporal operators in seconds, and the stretches of time they cover together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Literal as OneOf

from sqrp_cli.errors import InputError
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.literal import Literal
from sqrp_cli.records import dataclass

SAME_INSTANT = 1e-9  # Stretches that are closer than this [s] count as one
Operator = OneOf["always", "eventually"]


@dataclass(frozen=True, order=True)
class TimeInterval:
    """The time from `start` to `end` [s], both included."""

    start: float
    end: float

    @property
    def length(self) -> float:
        """Its duration [s]."""
        return self.end - self.start

    @property
    def when(self) -> str:
        """In words, such as `from 6.0 s to 7.2 s`, with more digits where both would look the same."""
        if self.start == self.end:
            return f"at {self.start:.1f} s"
        digits = 1 if f"{self.start:.1f}" != f"{self.end:.1f}" else 3
        return f"from {self.start:.{digits}f} s to {self.end:.{digits}f} s"


@dataclass(frozen=True)
class GroundOperator(TimeInterval):
    """A temporal operator of a ground formula with the time in which it applies, from the start of the skill [s]."""

    text: str
    """The operator with its body, as written."""
    operator: Operator
    """As written; under a negation an `eventually` stays one."""
    literals: tuple[Literal, ...]
    """Those of its body outside any deeper temporal operator, once each, from left to right.

    After negations within the body are pushed down to the predicates.
    """
    fault: str | None = None
    """The fault that its formula describes, if any."""


def with_times(formula: mtl.Formula, spans: Mapping[str, tuple[float, float]]) -> mtl.Formula:
    """The formula with every bound of an interval as a number of seconds.

    spans: start and end of each primitive action [s]. Raises InputError for an interval that ends before it starts.
    """
    if isinstance(formula, mtl.Predicate):
        return formula
    interval = formula.interval
    if interval is not None:
        start, end = _bounds(interval, spans)
        interval = mtl.Interval(
            replace(interval.start, primitive=None, edge=None, offset=start),
            replace(interval.end, primitive=None, edge=None, offset=end),
        )
    return replace(formula, parts=tuple(with_times(part, spans) for part in formula.parts), interval=interval)


def _bounds(interval: mtl.Interval, spans: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    start, end = (
        (spans[bound.primitive][bound.edge == "end"] if bound.primitive is not None else 0.0) + bound.offset
        for bound in (interval.start, interval.end)
    )
    if end < start - SAME_INSTANT:
        code, message = "mtl-empty-interval", f"the interval {interval} is empty: from {start:g} s to {end:g} s"
        raise InputError(mtl.problem_at(interval.start.origin, code, message))
    return start, max(start, end)


def ground_operators(
    formula: mtl.Formula, spans: Mapping[str, tuple[float, float]], total: float, fault: str | None = None
) -> tuple[GroundOperator, ...]:
    """The temporal operators of a bound formula, outer before inner, from left to right, with their times.

    spans: start and end of each primitive action [s]. total: duration of the whole motion [s].
    fault: that the formula describes, if any.
    The interval of a nested operator is the Minkowski sum of its own and those of the operators around it, clipped to
    [0, total]; an operator whose interval lies outside [0, total] has no entry. Literals outside any temporal operator
    count at t = 0: they make an entry of their own, before the others, `always` from 0 to 0, whose text is the formula.
    Raises InputError for an interval that ends before it starts.
    """
    literals = tuple(dict.fromkeys(_own_literals(formula, positive=True)))
    found = [GroundOperator(0.0, 0.0, str(formula), "always", literals, fault)]
    for operator, when in timed_operators(formula, spans, total):
        if when is not None:
            found.append(
                GroundOperator(
                    start=when.start,
                    end=when.end,
                    text=str(operator),
                    operator="always" if operator.operator == "always" else "eventually",
                    literals=tuple(dict.fromkeys(_own_literals(operator.parts[0], positive=True))),
                    fault=fault,
                )
            )
    return tuple(found) if literals else tuple(found[1:])


def timed_operators(
    formula: mtl.Formula,
    spans: Mapping[str, tuple[float, float]],
    total: float,
    evaluated: tuple[float, float] = (0.0, 0.0),
) -> Iterator[tuple[mtl.Operation, TimeInterval | None]]:
    """The temporal operators of a formula, bound or not, with their times; None for one that is never looked at.

    evaluated: from when to when the formula is [s]. Order, the other arguments and errors as of `ground_operators`.
    """
    if isinstance(formula, mtl.Operation) and formula.interval is not None:
        start, end = _bounds(formula.interval, spans)
        start, end = evaluated = (evaluated[0] + start, evaluated[1] + end)
        outside = end <= -SAME_INSTANT or start >= total + SAME_INSTANT
        yield formula, None if outside else TimeInterval(min(max(start, 0.0), total), min(max(end, 0.0), total))
    for part in formula.parts:
        yield from timed_operators(part, spans, total, evaluated)


def _own_literals(formula: mtl.Formula, positive: bool) -> Iterator[Literal]:
    """Literals outside any temporal operator; under an odd number of negations if `positive` is false."""
    if isinstance(formula, mtl.Predicate):
        yield Literal(formula.atom, positive)
    elif formula.interval is None:
        for number, part in enumerate(formula.parts):
            opposite = formula.operator == "not" or (formula.operator == "implies" and number == 0)
            yield from _own_literals(part, positive != opposite)


def merge(stretches: Iterable[TimeInterval]) -> tuple[TimeInterval, ...]:
    """The union as separate stretches in order of time; stretches closer than 1e-9 s become one."""
    merged: list[TimeInterval] = []
    for stretch in sorted(stretches, key=lambda one: (one.start, one.end)):
        if merged and stretch.start - merged[-1].end < SAME_INSTANT:
            merged[-1] = TimeInterval(merged[-1].start, max(merged[-1].end, stretch.end))
        else:
            merged.append(TimeInterval(stretch.start, stretch.end))
    return tuple(merged)
