"""Goals: how they are written, and what misses them; what a change costs, as sentences say it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from sqrp_cli.cell.workspace import ExpectedTask
from sqrp_cli.errors import InputError
from sqrp_cli.search.advice_result import AdviceFound, AdvisedFigures, ChangedCandidate, TaskEffect
from sqrp_cli.search.goal import Goal, goal_of, read_goal


@pytest.mark.parametrize(
    ("text", "goal"),
    [
        ("q_eoi 100 %", Goal(q_eoi=1.0)),
        ("q_eoi 100%, time 20 s", Goal(q_eoi=1.0, time=20.0)),
        ("Q_avg 0.9,delay 500 ms", Goal(q_avg=0.9, delay=0.5)),
        ("time=20", Goal(time=20.0)),
    ],
)
def test_goals_are_read(text, goal):
    assert read_goal(text) == goal
    assert read_goal(str(goal)) == goal


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "empty"),
        ("q_eio 100 %", "q_eoi"),
        ("q_eoi", "share"),
        ("q_eoi 100", "at most 100 %"),
        ("q_eoi 20 s", "share"),
        ("time 20 %", "time"),
        ("time 0", "more than 0"),
        ("time -1", "time"),
        ("time 20 s, time 30 s", "twice"),
        ("q_eoi 100 %,", "empty"),
    ],
)
def test_others_are_refused_with_what_was_expected(text, word):
    with pytest.raises(InputError, match=word):
        read_goal(text)


def test_without_thresholds_all_events_are_to_be_seen():
    assert goal_of(None) == Goal(q_eoi=1.0)
    assert goal_of(ExpectedTask(task="pickup green")) == Goal(q_eoi=1.0)
    assert goal_of(ExpectedTask(task="pickup green", max_delay=1.0)) == Goal(delay=1.0)


@pytest.mark.parametrize(("delay", "nearer"), [(0.4099, False), (0.40, True), (0.43, False)])
def test_only_what_shows_in_the_figures_comes_nearer(delay, nearer):
    start, found = (SimpleNamespace(feasible=True, latest=worst, unseen=0.0) for worst in (0.4132, delay))
    assert Goal(delay=0.2).is_nearer(found, start) is nearer


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
        "g1 (critical time seen 50.0 points less) in pickup green",
        "box3 (can no longer be done) in pickup any",
    ]
