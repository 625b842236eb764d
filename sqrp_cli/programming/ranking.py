"""Ranking of candidates: order by a criterion with defined ties, and Pareto optimality."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Literal, get_args

from sqrp_cli.errors import bad_option, expected_names
from sqrp_cli.programming.coverage.assessment import Assessment

Criterion = Literal["q_eoi", "q_avg", "time", "delay", "expected_time"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)


def read_criterion(name: str, option: str = "--by") -> Criterion:
    """The criterion of that name. option: that gives it, for the message. Raises InputError for another name."""
    for criterion in CRITERIA:
        if criterion == name:
            return criterion
    raise bad_option(f"{option} is `{name}`; {expected_names(name, CRITERIA)}")


_Figure = Callable[[Assessment], float | None]
"""A figure of a candidate by which it may be ranked; None where it is undefined."""

_TIME_DECIMALS = 6
"""Times equal to this many decimals of a second count as equal: the rest is rounding."""

_QUALITY_STEP = 1e-3
"""Qualities are compared rounded to this (0.1 points), the accuracy of bisection."""


@dataclass(frozen=True)
class Ranked:
    """An assessment with its place: rank from 1, None if infeasible."""

    assessment: Assessment
    rank: int | None
    pareto: bool
    """No other is at least as good in Q_avg, Q_eoi and time, and better in one of them."""


def rank(assessments: Sequence[Assessment], by: Criterion) -> tuple[Ranked, ...]:
    """The candidates in order: the best first, the infeasible ones last, in their original order.

    Ties are broken by Q_avg, time, worst delay and finally the parameters. A criterion that is null for a candidate is
    ignored for all.
    """
    feasible = [assessment for assessment in assessments if assessment.feasible]
    columns = _columns(feasible, by)
    ordered = sorted(feasible, key=lambda one: (_compared(one, columns), _parameters(one)))
    ranked = [
        Ranked(assessment, place, _undominated(assessment, feasible)) for place, assessment in enumerate(ordered, 1)
    ]
    return (*ranked, *(Ranked(assessment, None, False) for assessment in assessments if not assessment.feasible))


def contenders(assessments: Sequence[Assessment], by: Criterion) -> list[bool]:
    """Which of some feasible ones without delays may be first or Pareto-optimal, whatever their delays are.

    by: no criterion of delays.
    """
    columns = _columns(assessments, by)
    values = [_compared(one, columns) for one in assessments]
    first = min(values)
    return [own == first or _undominated(one, assessments) for own, one in zip(values, assessments, strict=True)]


def _columns(feasible: Sequence[Assessment], by: Criterion) -> list[_Figure]:
    """What is compared, in order: all that no candidate lacks."""
    columns: list[_Figure] = [_CRITERIA[by], _CRITERIA["q_avg"], _CRITERIA["time"], lambda one: one.latest]
    return [column for column in columns if all(column(assessment) is not None for assessment in feasible)]


def _compared(assessment: Assessment, columns: Sequence[_Figure]) -> list[float]:
    """The figures of columns as they are compared, the least the best."""
    return [compared_time(value) for column in columns if (value := column(assessment)) is not None]


def winners(assessments: Sequence[Assessment], by: Criterion) -> Counter[str]:
    """How often each candidate would be first among the draws of camera poses."""
    feasible = [assessment for assessment in assessments if assessment.feasible]
    draws = zip(*(assessment.recalibrated for assessment in feasible), strict=True)
    first = []
    for draw in draws:
        drawn = [replace(a, q_avg=q.q_avg, q_eoi=q.q_eoi) for a, q in zip(feasible, draw, strict=True)]
        first.append(rank(drawn, by)[0].assessment.candidate.name)
    return Counter(first)


def compared_quality(quality: float | None) -> float:
    """A quality as it is compared, in 0..1; one that is undefined counts as 1."""
    return 1.0 if quality is None else round(quality / _QUALITY_STEP) * _QUALITY_STEP


def compared_time(seconds: float) -> float:
    """A time as it is compared [s]; rounded qualities stay as they are."""
    return round(seconds, _TIME_DECIMALS)


def _rounded(quality: float | None) -> float | None:
    """A quality as it is compared, negated because less is better in every column."""
    return None if quality is None else -round(quality / _QUALITY_STEP) * _QUALITY_STEP


def _expected_time(assessment: Assessment) -> float | None:
    """After the worst of the retried faults: the others do not complete the task. Infinite like `_delay`."""
    retried = assessment.candidate.skill.retried_faults
    times = [fault.expected_time or inf for name, fault in assessment.faults.items() if name in retried]
    return (inf if assessment.unseen else max(times)) if times else None


def _delay(assessment: Assessment) -> float | None:
    """Of the worst fault, on average; infinite where a fault may never be noticed."""
    if assessment.unseen:
        return inf
    return max((fault.delay_mean or 0.0 for fault in assessment.faults.values()), default=None)


_CRITERIA: dict[Criterion, _Figure] = {
    "q_eoi": lambda assessment: _rounded(assessment.q_eoi),
    "q_avg": lambda assessment: _rounded(assessment.q_avg),
    "time": lambda assessment: assessment.time,
    "delay": _delay,
    "expected_time": _expected_time,
}
"""What each criterion compares; less is better."""


def criterion_figure(assessment: Assessment, by: Criterion) -> float | None:
    """The figure of a criterion: a quality in 0..1, or a time [s]; None where it is undefined.

    A time is infinite where a fault may never be noticed.
    """
    figure = _CRITERIA[by](assessment)
    return abs(figure) if figure is not None and by in ("q_eoi", "q_avg") else figure


def _parameters(assessment: Assessment) -> list[tuple[float, str]]:
    """The parameters' values as a sort key: numbers by value, words by spelling."""
    values = assessment.candidate.parameters.values()
    return [(0.0, value) if isinstance(value, str) else (value, "") for value in values]


def _undominated(assessment: Assessment, others: Sequence[Assessment]) -> bool:
    own = _objectives(assessment)
    return not any(_dominates(_objectives(other), own) for other in others)


def _objectives(assessment: Assessment) -> tuple[float | None, ...]:
    time = None if assessment.time is None else compared_time(assessment.time)
    return _rounded(assessment.q_avg), _rounded(assessment.q_eoi), time


def _dominates(first: tuple[float | None, ...], second: tuple[float | None, ...]) -> bool:
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if a is not None and b is not None]
    return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)
