from __future__ import annotations

import dataclasses
from random import Random
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.figures import FaultMetrics, Qualities
from sqrp_cli.study.ranking import contenders, rank, winners
from sqrp_cli.study.result import CRITERIA, CandidateResult, Criterion
from sqrp_cli.task.task import Candidate, read_task
from tests.cells import read_cases
from tests.conftest import TABLETOP

CANDIDATES: tuple[Candidate, ...] = read_task("pickup green", load_workspace(TABLETOP)).candidates


def assessed(index: int, q_eoi: float | None, q_avg: float | None, time: float, delay: float = 1.0) -> CandidateResult:
    fault = FaultMetrics(delay, 2 * delay, delay, 0.0, time + delay)
    figures = {"time": time, "q_avg": q_avg, "q_eoi": q_eoi, "faults": {"slip": fault}, "retried": ("slip",)}
    return dataclasses.replace(CandidateResult.infeasible(CANDIDATES[index], ()), feasible=True, **figures)


def infeasible(index: int) -> CandidateResult:
    return CandidateResult.infeasible(CANDIDATES[index], ("too far",))


def names(results: list[CandidateResult], by: str = "q_eoi") -> list[str]:
    return [ranked.candidate.name for ranked in rank(results, by)]  # type: ignore[arg-type]


@pytest.mark.parametrize(("first", "second", "by", "best"), read_cases("scores.yaml")["order"])
def test_candidates_are_in_the_defined_order(first: Any, second: Any, by: Criterion, best: str) -> None:
    one, other = assessed(0, *first), assessed(1, *second)
    assert names([one, other], by)[0] == names([other, one], by)[0] == best


def test_what_may_never_be_noticed_comes_after_every_delay() -> None:
    never = FaultMetrics(0.01, None, 0.0, 0.02, None)
    late = assessed(1, 1.0, 0.5, 9.0, 9)
    missed = dataclasses.replace(assessed(0, 1.0, 0.5, 9.0), faults={"slip": never})
    for criterion in ("delay", "expected_time"):
        assert names([missed, late], criterion) == ["g2", "g1"]
    assert names([missed, late], "q_eoi") == ["g2", "g1"], "the worst delay breaks ties"
    both = dataclasses.replace(missed, faults={"slip": FaultMetrics(None, None, 1.0, 1.0, None)})
    assert [one.rank for one in rank([both, missed, late], "delay")] == [1, 2, 3]


def test_only_faults_that_are_retried_count_for_when_all_is_done() -> None:
    stops = FaultMetrics(1.0, 2.0, 1.0, 0.0, 99.0)
    soon = assessed(0, 1.0, 0.5, 9.0)
    soon = dataclasses.replace(soon, faults={**soon.faults, "broken": stops})
    late = assessed(1, 1.0, 0.5, 9.0, 3.0)
    assert "broken" not in soon.candidate.skill.retried_faults
    assert names([late, soon], "expected_time") == ["g1", "g2"]


def test_infeasible_candidates_come_last_without_a_rank() -> None:
    ranking = rank([infeasible(0), assessed(1, 0.1, 0.1, 9.0), infeasible(2)], "q_eoi")
    assert [(one.candidate.name, one.rank) for one in ranking] == [("g2", 1), ("g1", None), ("g3", None)]
    assert not any(ranked.pareto for ranked in ranking if ranked.rank is None)


figures = st.tuples(st.integers(0, 10), st.integers(0, 10), st.integers(1, 5))


@given(st.lists(figures, min_size=1, max_size=6), st.sampled_from(CRITERIA), st.randoms())
def test_pareto_is_whoever_nobody_beats_and_the_order_of_the_input_does_not_matter(
    rows: list[tuple[int, int, int]], by: str, random: Random
) -> None:
    results = [assessed(i, eoi / 10, avg / 10, float(time)) for i, (eoi, avg, time) in enumerate(rows)]
    assert names(random.sample(results, len(results)), by) == names(results, by)
    for ranked in rank(results, by):  # type: ignore[arg-type]
        eoi, avg, time = rows[CANDIDATES.index(ranked.candidate)]
        beaten = any(e >= eoi and a >= avg and t <= time and (e, a, t) != (eoi, avg, time) for e, a, t in rows)
        assert ranked.pareto == (not beaten)


@given(
    st.lists(st.tuples(*[st.integers(0, 2)] * 4), min_size=1, max_size=6), st.sampled_from(("q_eoi", "q_avg", "time"))
)
@example([(2, 1, 0, 1), (1, 1, 0, 0)], "time")
def test_whatever_its_delays_no_other_than_a_contender_is_first_or_pareto_optimal(
    rows: list[tuple[int, int, int, int]], by: Criterion
) -> None:
    found = [assessed(i, e / 2, a / 2, 5.0 + t, 1.0 + late) for i, (e, a, t, late) in enumerate(rows)]
    kept = contenders([dataclasses.replace(one, faults={}, retried=()) for one in found], by)
    whole, less = rank(found, by), rank([one for one, named in zip(found, kept, strict=True) if named], by)
    assert less[0].candidate is whole[0].candidate
    optimal = [[one.candidate for one in ranking if one.pareto] for ranking in (whole, less)]
    assert optimal[0] == optimal[1]


def test_winners_counts_who_is_first_in_each_draw() -> None:
    first, second = assessed(0, 1.0, 1.0, 9.0), assessed(1, 0.5, 0.5, 9.0)
    better, worse = Qualities(0.9, 0.9), Qualities(0.1, 0.1)
    first = dataclasses.replace(first, recalibrated=(better, worse, better))
    second = dataclasses.replace(second, recalibrated=(worse, better, worse))
    assert winners([first, second], "q_eoi") == {"g1": 2, "g2": 1}
