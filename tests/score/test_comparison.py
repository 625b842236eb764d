"""Tasks compared with a baseline, and the sentences about it; expectations that are not met."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import TypeAdapter

from sqrp_cli.cell.workspace import ExpectedTask
from sqrp_cli.figures import FaultMetrics, LateReason
from sqrp_cli.score.baseline import WayRecord
from sqrp_cli.score.comparison import compare_versions
from sqrp_cli.score.compute import Means, open_computer
from sqrp_cli.score.result import LostView, Shift, WayChange
from sqrp_cli.score.score import ScoredCell, read_cell, shortcomings
from sqrp_cli.show.terminal.search_tables import print_difference
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import with_verdict

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop" / "workspace.yaml"
SLOWER = Shift("delay", 0.69, 0.71, worse=True)
SEES_MORE = Shift("q_avg", 0.881, 0.888, worse=False)


def test_another_way_is_said_and_what_got_better_is_not_hidden():
    change = WayChange("g4", "g4", "g4", (SEES_MORE, SLOWER), choice_before="left, 90 deg", choice="left, -90 deg")
    assert str(change) == (
        "g4: the longest time until a fault is noticed rose from 0.69 s to 0.71 s, "
        "but time seen rose from 88.1 % to 88.8 %; "
        "g4 now goes another way: left, -90 deg instead of left, 90 deg"
    )
    named = WayChange("g4", "g4 a", "g4 b", (SLOWER,), choice_before="as at home", choice="left")
    assert str(named).endswith("g4 now goes another way: g4 b, left instead of g4 a")


@pytest.mark.parametrize(
    ("shifts", "mark"), [((SEES_MORE, SLOWER), "mixed"), ((SLOWER,), "worse"), ((SEES_MORE,), "better")]
)
def test_a_difference_is_called_worse_only_where_nothing_got_better(capsys, shifts, mark):
    comparison = SimpleNamespace(ways=[WayChange("g4", "g4", "g4", shifts)], verdict="regressed", gone=())
    result = SimpleNamespace(baseline=comparison, task="pickup g4")
    print_difference(SimpleNamespace(interrupted=False, changes={}, results=[result], vanished=()))
    assert f"{mark:6}  pickup g4 for g4: " in capsys.readouterr().out


def test_an_old_baseline_names_no_way_and_a_short_loss_has_two_ends():
    for before in ("left", None):
        assert not WayChange("g4", "g4", "g4", (SLOWER,), choice_before=before, choice="left").another_way
    assert TypeAdapter(WayRecord).validate_python({"candidate": "g4", "feasible": True}).choice is None
    for start, end, said in ((5.002, 5.016, "5.002 s to 5.016 s"), (1.0, 2.5, "1.0 s to 2.5 s")):
        assert f"from {said}:" in str(LostView("hold(g4)", "cam6", start, end, "hidden by suction_cup"))


def with_camera_at(height: str) -> ScoredCell:
    """The cell of `tabletop` with its second camera at a height [m], and one object to pick up."""
    text = TABLETOP.read_text(encoding="utf-8").split("\ntasks:")[0]
    changed = text.replace(" 1.404]", f" {height}]", 1)
    assert changed.count(f" {height}]") == 1
    return read_cell(TABLETOP, "tabletop", f"{changed}\ntasks:\n  - {{task: pickup g4}}\n".encode())


def test_no_camera_is_blamed_where_the_robot_moves_in_another_way():
    with open_computer(Means(Adaptive())) as computer:
        found = compare_versions(
            with_camera_at("1.404"), with_camera_at("1.504"), computer, 0.5, lambda *_: nullcontext(lambda _: None)
        )
    (result,) = found.results
    (change,) = result.baseline.ways
    assert result.ways["g4"].way.values["approach_yaw"] == pytest.approx(-math.pi / 2)
    assert (change.worse, change.another_way, change.lost) == (True, True, ())
    (reason,) = result.reasons
    assert "tool turned -90 deg instead of shoulder left, wrist flipped, tool turned 90 deg" in reason
    assert "no longer sees" not in reason


@pytest.mark.parametrize(
    ("shift", "said"),
    [
        (
            Shift("delay", 0.4132, 0.4099, worse=False),
            "the longest time until a fault is noticed fell from 0.4132 s to 0.4099 s",
        ),
        (Shift("q_eoi", 0.88012, 0.88041, worse=False), "critical time seen rose from 88.012 % to 88.041 %"),
        (Shift("time", 9.9, 10.1, worse=True), "its time rose from 9.90 s to 10.10 s"),
    ],
)
def test_figures_that_differ_never_look_alike(shift, said):
    assert str(shift) == said


def test_the_severity_of_a_change_is_its_largest_worsening():
    fell = Shift("q_eoi", 0.62, 0.0, worse=True)
    slower = Shift("time", 10.0, 11.0, worse=True)
    better = Shift("q_avg", 0.1, 0.9, worse=False)
    assert WayChange("g4", "g4", "g4", (slower, fell, better)).severity == pytest.approx(0.62)
    assert WayChange("g5", "g5", "g5", (slower, better)).severity == pytest.approx(0.1)
    assert WayChange("g6", "g6", "g6", (Shift("feasible", 1.0, 0.0, worse=True),)).severity == 1.0
    assert WayChange("g7", "g7", "g7", (better,)).severity == 0.0


EXPECTED = ExpectedTask(task="pickup", max_delay=0.1)


def assessed(*, blind: float) -> CandidateResult:
    candidate = SimpleNamespace(name="g1", objects={"object": "g1"})
    why = LateReason(kind="hardly_apart", camera="cam1", at=1.0, after=0.1, words="tool and part have to part")
    slip = FaultMetrics(0.15 + blind / 2, 0.15 + blind, blind, 0.0, 20.0, why)
    without = CandidateResult.infeasible(candidate, ())
    blind_spot = "cam1 cannot see hold(g1) behind forearm_link"
    return replace(
        without,
        feasible=True,
        blind_spot=blind_spot,
        time=9.0,
        faults={"slip": slip},
    )


@pytest.mark.parametrize(
    ("blind", "blind_spot", "says"),
    [
        (2.0, "", "only after 2.15 s, expected at most 0.1 s: cam1 cannot see hold(g1)"),
        (0.0, "", "only after 0.15 s, expected at most 0.1 s: tool and part have to part"),
        (2.0, NOTHING_MISSING, "only after 2.15 s, expected at most 0.1 s: tool and part have to part"),
    ],
)
def test_a_delay_is_explained_by_what_hides_the_fault_or_by_what_takes_so_long(blind, blind_spot, says):
    found = assessed(blind=blind)
    (sentence,) = shortcomings(replace(found, blind_spot=blind_spot or found.blind_spot), EXPECTED, "")
    assert says in sentence


def test_what_a_motion_goes_around_hides_no_fault():
    none = np.zeros(1, dtype=bool)
    samples, seen = SimpleNamespace(t=none), SimpleNamespace(blind=none)
    planned = SimpleNamespace(
        candidate=SimpleNamespace(skill=SimpleNamespace(in_pieces=str)),
        motion=SimpleNamespace(doubts=(), remarks=("a1 goes around wall",)),
    )
    timeline = SimpleNamespace(planned=planned, samples=samples, observation=seen, of_interest=none)
    found = with_verdict(None, timeline, assessed(blind=2.0))
    assert found.verdict == f"{NOTHING_MISSING}. On the way a1 goes around wall."
    (sentence,) = shortcomings(found, EXPECTED, "")
    assert sentence.endswith("tool and part have to part")


def test_a_quality_that_is_whole_but_for_rounding_is_whole():
    expected = ExpectedTask(task="pickup", min_q_eoi=1.0, min_q_avg=1.0)
    whole = replace(assessed(blind=0.0), q_eoi=0.9999999999999998, q_avg=0.9999999999999999)
    assert shortcomings(whole, expected, "") == ()
    (sentence,) = shortcomings(replace(whole, q_eoi=0.999999), expected, "")
    assert "critical time seen of g1 is 100.0 %, expected at least 100 %" in sentence
