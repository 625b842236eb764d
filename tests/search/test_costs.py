"""What a change costs, as sentences say it."""

from __future__ import annotations

from sqrp_cli.search.advice_result import AdviceFound, AdvisedFigures, ChangedCandidate, TaskEffect


def figures(q_eoi: float) -> AdvisedFigures:
    return AdvisedFigures(q_eoi=q_eoi, q_avg=None, time=1.0, delay_worst=None, unseen=None)


def effect(task: str, *candidates: ChangedCandidate) -> TaskEffect:
    return TaskEffect(task=task, first_before=None, first_after=None, candidates=candidates)


def test_a_cost_is_listed_once_and_other_candidates_of_a_later_task_still_are():
    g1 = ChangedCandidate(candidate="g1", before=figures(0.6), after=figures(0.1), worse=("q_eoi",))
    box = ChangedCandidate(candidate="box3", before=figures(1.0), after=figures(1.0), worse=("feasible",))
    found = AdviceFound(
        **vars(figures(1.0)), kind="aim", target="cam1", change=(), size=0.1, unit="rad", turn=0.1, words="",
        margin=None, worse=(),
        tasks=(effect("pickup green", g1), effect("pickup g1", g1), effect("pickup any", g1, box)),
    )  # fmt: skip
    assert found.costs == [
        "in pickup green: g1 Q_eoi 60.0 % to 10.0 %",
        "in pickup any: box3 can no longer be done",
    ]
