"""When formulas apply: intervals of temporal operators in seconds, and the stretches of time they cover together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Literal as OneOf

from sqrp_cli.errors import InputError
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.literal import Literal
from sqrp_cli.records import dataclass

SAME_INSTANT = 1e-9
"""Stretches that are closer than this [s] count as one."""

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

    @property
    def stretch(self) -> TimeInterval:
        """Its interval."""
        return TimeInterval(self.start, self.end)


def with_times(formula: mtl.Formula, spans: Mapping[str, tuple[float, float]]) -> mtl.Formula:
    """The formula with every bound of an interval as a number of seconds.

    spans: start and end of each primitive action [s]. Raises InputError for an interval that ends before it starts.
    """
    parts = tuple(with_times(part, spans) for part in mtl.children(formula))
    found = mtl.with_children(formula, parts)
    return replace(found, interval=_with_times(found.interval, spans)) if isinstance(found, mtl.Temporal) else found


def ground_operators(
    formula: mtl.Formula, spans: Mapping[str, tuple[float, float]], total: float
) -> tuple[GroundOperator, ...]:
    """The temporal operators of a bound formula, outer before inner, from left to right, with their times.

    spans: start and end of each primitive action [s]. total: duration of the whole motion [s].
    The interval of a nested operator is the Minkowski sum of its own and those of the operators around it, clipped to
    [0, total]; an operator whose interval lies outside [0, total] has no entry. Literals outside any temporal operator
    count at t = 0: they make an entry of their own, before the others, `always` from 0 to 0, whose text is the formula.
    Raises InputError for an interval that ends before it starts.
    """
    literals = tuple(dict.fromkeys(_own_literals(formula, positive=True)))
    at_start = GroundOperator(text=str(formula), operator="always", start=0.0, end=0.0, literals=literals)
    inside = (
        GroundOperator(
            text=str(operator),
            operator="always" if isinstance(operator, mtl.Always) else "eventually",
            start=min(max(when.start, 0.0), total),
            end=min(max(when.end, 0.0), total),
            literals=tuple(dict.fromkeys(_own_literals(operator.operand, positive=True))),
        )
        for operator, when, outside in _timed_operators(formula, spans, total)
        if not outside
    )
    return (at_start, *inside) if literals else tuple(inside)


def operators_outside(formula: mtl.Formula, spans: Mapping[str, tuple[float, float]], total: float) -> tuple[int, ...]:
    """Which temporal operators of a formula, bound or not, have no entry in `ground_operators`.

    They are never looked at. Each by its place in `operators`. Arguments and errors are those of `ground_operators`.
    """
    timed = _timed_operators(formula, spans, total)
    return tuple(index for index, (_, _, outside) in enumerate(timed) if outside)


def operators(formula: mtl.Formula) -> tuple[mtl.Temporal, ...]:
    """The temporal operators of a formula, outer before inner, from left to right."""
    own = (formula,) if isinstance(formula, mtl.Temporal) else ()
    return (*own, *(operator for part in mtl.children(formula) for operator in operators(part)))


def merge(stretches: Iterable[TimeInterval]) -> tuple[TimeInterval, ...]:
    """The union as separate stretches in order of time; stretches closer than 1e-9 s become one."""
    merged: list[TimeInterval] = []
    for stretch in sorted(stretches):
        if merged and stretch.start - merged[-1].end < SAME_INSTANT:
            merged[-1] = TimeInterval(merged[-1].start, max(merged[-1].end, stretch.end))
        else:
            merged.append(stretch)
    return tuple(merged)


def union_length(stretches: Iterable[TimeInterval]) -> float:
    """Duration of the union [s]: T over all ground operators, T_eoi over those of events of interest."""
    return sum(stretch.length for stretch in merge(stretches))


def events_of_interest(operators: Iterable[GroundOperator]) -> tuple[TimeInterval, ...]:
    """The stretches of the events of interest: of every `eventually`."""
    return merge(operator.stretch for operator in operators if operator.operator == "eventually")


def _timed_operators(
    formula: mtl.Formula,
    spans: Mapping[str, tuple[float, float]],
    total: float,
    evaluated: TimeInterval = TimeInterval(0.0, 0.0),  # noqa: B008 - it is frozen
) -> Iterator[tuple[mtl.Temporal, TimeInterval, bool]]:
    """The operators in a formula that is evaluated at all instants of a stretch, in the order of `operators`.

    Each with its interval, not clipped, and whether nothing of that lies in [0, total].
    """
    if isinstance(formula, mtl.Temporal):
        interval = _with_times(formula.interval, spans)
        evaluated = TimeInterval(evaluated.start + interval.start.offset, evaluated.end + interval.end.offset)
        outside = evaluated.end <= -SAME_INSTANT or evaluated.start >= total + SAME_INSTANT
        yield formula, evaluated, outside
    for part in mtl.children(formula):
        yield from _timed_operators(part, spans, total, evaluated)


def _own_literals(formula: mtl.Formula, positive: bool) -> Iterator[Literal]:
    """Literals outside any temporal operator; under an odd number of negations if `positive` is false."""
    match formula:
        case mtl.Predicate():
            yield Literal(formula.atom, positive)
        case mtl.Not(operand):
            yield from _own_literals(operand, not positive)
        case mtl.Joined(operands):
            for operand in operands:
                yield from _own_literals(operand, positive)
        case mtl.Implies(premise, conclusion):
            yield from _own_literals(premise, not positive)
            yield from _own_literals(conclusion, positive)
        case mtl.Temporal():
            pass


def _with_times(interval: mtl.Interval, spans: Mapping[str, tuple[float, float]]) -> mtl.Interval:
    bounds = (interval.start, interval.end)
    start, end = (
        (spans[bound.primitive][bound.edge == "end"] if bound.primitive is not None else 0.0) + bound.offset
        for bound in bounds
    )
    if end < start - SAME_INSTANT:
        code, message = "mtl-empty-interval", f"the interval {interval} is empty: from {start:g} s to {end:g} s"
        raise InputError(mtl.problem_at(interval.start.origin, code, message))
    return mtl.Interval(
        mtl.Instant(offset=start, origin=interval.start.origin),
        mtl.Instant(offset=max(start, end), origin=interval.end.origin),
    )
