"""Ranking of candidates: order by a criterion with defined ties, and Pareto optimality."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import inf

from sqrp_cli.study.result import CandidateResult, Criterion

_Figure = Callable[[CandidateResult], float | None]
"""A figure of a candidate by which it may be ranked; None where it is undefined."""
_DECIMALS = 6  # Figures equal to this many decimals count as equal, times in seconds: the rest is rounding
QUALITY_STEP = 1e-3  # Qualities are compared rounded to this (0.1 points), the accuracy of bisection


def rank(results: Sequence[CandidateResult], by: Criterion) -> tuple[CandidateResult, ...]:
    """The candidates in order, with their places: the best first, the infeasible ones last, in their original order.

    Ties are broken by Q_avg, time, worst delay and finally the parameters: numbers by value, words by spelling. A
    criterion that is null for a candidate is ignored for all.
    """
    feasible = [one for one in results if one.feasible]
    ordered = [
        replace(one, rank=place, pareto=_undominated(one, feasible))
        for place, one in enumerate(_in_order(feasible, by), 1)
    ]
    return (*ordered, *(replace(one, rank=None, pareto=False) for one in results if not one.feasible))


def _in_order(feasible: Sequence[CandidateResult], by: Criterion) -> list[CandidateResult]:
    values = [one.candidate.parameters.values() for one in feasible]
    words = [[(0.0, value) if isinstance(value, str) else (value, "") for value in own] for own in values]
    keys = list(zip(_compared(feasible, by), words, strict=True))
    return [feasible[place] for place in sorted(range(len(feasible)), key=keys.__getitem__)]


def contenders(results: Sequence[CandidateResult], by: Criterion) -> list[bool]:
    """Which of some feasible ones without delays may be first or Pareto-optimal, whatever their delays are.

    by: no criterion of delays.
    """
    values = _compared(results, by)
    return [own == min(values) or _undominated(one, results) for own, one in zip(values, results, strict=True)]


def _compared(feasible: Sequence[CandidateResult], by: Criterion) -> list[list[float]]:
    """The figures of each as they are compared in order, the least the best: all that none of them lacks."""
    columns: list[_Figure] = [_CRITERIA[by], _CRITERIA["q_avg"], _CRITERIA["time"], lambda one: one.latest]
    known = [column for column in columns if all(column(one) is not None for one in feasible)]
    return [[round(column(one) or 0.0, _DECIMALS) for column in known] for one in feasible]


def winners(feasible: Sequence[CandidateResult], by: Criterion) -> Counter[str]:
    """How often each candidate would be first among the draws of camera poses, by its name."""
    draws = zip(*(one.recalibrated for one in feasible), strict=True)
    drawn = ([replace(a, q_avg=q.q_avg, q_eoi=q.q_eoi) for a, q in zip(feasible, draw, strict=True)] for draw in draws)
    return Counter(_in_order(one, by)[0].candidate.name for one in drawn)


def compared_quality(quality: float | None) -> float:
    """A quality as it is compared, in 0..1; one that is undefined counts as 1."""
    return 1.0 if quality is None else round(quality / QUALITY_STEP) * QUALITY_STEP


def compared_time(seconds: float) -> float:
    """A time as it is compared [s]."""
    return round(seconds, _DECIMALS)


def _longest(one: CandidateResult, times: Iterable[float | None]) -> float | None:
    """The longest of times about faults; infinite where a fault may never be noticed, None without times."""
    found = [inf if one.unseen else time or 0.0 for time in times]
    return max(found, default=None)


_CRITERIA: dict[Criterion, _Figure] = {
    "q_eoi": lambda one: None if one.q_eoi is None else -compared_quality(one.q_eoi),
    "q_avg": lambda one: None if one.q_avg is None else -compared_quality(one.q_avg),
    "time": lambda one: one.time,
    "delay": lambda one: _longest(one, (fault.delay_mean for fault in one.faults.values())),
    # After the retried faults: the others do not complete the task.
    "expected_time": lambda one: _longest(one, (one.faults[name].expected_time for name in one.retried)),
}
"""What each criterion compares; less is better, so that qualities are negative."""


def _undominated(one: CandidateResult, others: Sequence[CandidateResult]) -> bool:
    """Whether none of the others is at least as good in qualities and time, and better in one."""
    criteria: tuple[Criterion, ...] = ("q_avg", "q_eoi", "time")
    for other in others:
        figures = ((_CRITERIA[name](other), _CRITERIA[name](one)) for name in criteria)
        pairs = [(round(a, _DECIMALS), round(b, _DECIMALS)) for a, b in figures if a is not None and b is not None]
        if all(a <= b for a, b in pairs) and any(a < b for a, b in pairs):
            return False
    return True
