"""The sentence about an expectation that is not met says what is in the way, if anything is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from sqrp_cli.cell.workspace import ExpectedTask
from sqrp_cli.figures import FaultMetrics
from sqrp_cli.score.score import shortcomings
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult

EXPECTED = ExpectedTask(task="pickup", max_delay=0.1)


def assessed(*, blind: float) -> CandidateResult:
    candidate = SimpleNamespace(name="g1", objects={"object": "g1"})
    slip = FaultMetrics(0.15 + blind / 2, 0.15 + blind, blind, 0.0, 20.0)
    verdict = "cam1 cannot see hold(g1) behind forearm_link."
    without = CandidateResult.infeasible(candidate, (), verdict)
    return replace(without, feasible=True, time=9.0, faults={"slip": slip}, why_late="tool and part have to part")


def test_a_delay_is_explained_by_what_hides_the_fault():
    (sentence,) = shortcomings(assessed(blind=2.0), EXPECTED, "")
    assert "only after 2.15 s, expected at most 0.1 s: cam1 cannot see hold(g1)" in sentence


def test_a_delay_without_blind_time_is_explained_by_what_takes_so_long():
    (sentence,) = shortcomings(assessed(blind=0.0), EXPECTED, "")
    assert "only after 0.15 s, expected at most 0.1 s: tool and part have to part" in sentence


def test_a_delay_of_what_is_covered_all_the_time_is_not_explained_by_a_verdict_that_says_so():
    found = replace(assessed(blind=2.0), verdict=NOTHING_MISSING)
    (sentence,) = shortcomings(found, EXPECTED, "")
    assert "only after 2.15 s, expected at most 0.1 s: tool and part have to part" in sentence


def test_a_quality_that_is_whole_but_for_rounding_is_whole():
    expected = ExpectedTask(task="pickup", min_q_eoi=1.0, min_q_avg=1.0)
    whole = replace(assessed(blind=0.0), q_eoi=0.9999999999999998, q_avg=0.9999999999999999)
    assert shortcomings(whole, expected, "") == ()
    (sentence,) = shortcomings(replace(whole, q_eoi=0.999999), expected, "")
    assert "Q_eoi of g1 is 100.0 %, expected at least 100 %" in sentence
