"""`sqrp check` proposes what has to be done first, scored, and `--program` writes it: all of it or nothing."""

from __future__ import annotations

import json
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from sqrp_cli.logic.literal import Atom
from sqrp_cli.program.file import load_program


@pytest.fixture
def program(holding) -> Path:
    path = holding.with_name("program.yaml")
    shutil.copy(holding, path)
    yield path
    path.unlink()


def test_a_full_hand_is_explained_and_a_scored_plan_offered(sqrp, laying, holding):
    outcome = sqrp("check", laying, "pickup g3", "--after", holding)
    assert outcome.code == 1
    text = " ".join(outcome.out.split())
    assert "`pickup` needs `hand_empty`, which does not hold" in text
    assert "first do lay(g2)" in text
    rows = [line.split() for line in outcome.out.splitlines() if line[:1].isdigit()]
    assert [row[:3] for row in rows] == [["1", "lay", "g2"], ["2", "pickup", "g3"]]
    assert all(float(row[-1]) > 0 for row in rows)
    assert "--program FILE" in outcome.out


def test_the_plan_of_the_document_is_what_ranking_its_step_gives(sqrp, laying, holding):
    (candidate,) = sqrp("check", laying, "pickup g3", "--after", holding, "--json").document["candidates"]
    best = sqrp("rank", laying, "lay g2", "--after", holding, "--json").document["candidates"][0]
    (step,) = candidate["plan"]
    assert candidate["planning"] == "plan"
    figures = ("feasible", "q_avg", "q_eoi", "time", "reasons")
    assert step == {"task": "lay g2", "action": "lay(g2)", **{name: best[name] for name in figures}}


def test_the_document_has_the_figures_that_are_printed(sqrp, laying, holding):
    command = ("check", laying, "pickup g3", "--after", holding)
    (candidate,) = sqrp(*command, "--json").document["candidates"]
    rows = [line.split() for line in sqrp(*command).out.splitlines() if line[:1].isdigit()]
    steps = [*candidate["plan"], candidate["last"]]
    assert [step["action"] for step in steps] == ["lay(g2)", "pickup(g3)"]
    assert [f"{step['time']:.2f}" for step in steps] == [row[-1] for row in rows]
    (candidate,) = sqrp("check", laying, "pickup g3", "--json").document["candidates"]
    row = sqrp("check", laying, "pickup g3").out.splitlines()[-1].split()
    assert (candidate["last"], row) == (None, ["g3", f"{candidate['time']:.2f}"])


def test_the_whole_suggestion_becomes_a_program(sqrp, laying, program):
    outcome = sqrp("check", laying, "pickup g3", "--program", program)
    assert outcome.code == 0
    steps = load_program(program).steps
    assert [step.short_task for step in steps] == ["pickup g2", "lay g2", "pickup g3"]
    worlds = [step.model_dump(include={"before", "after"}) for step in steps]
    assert all(before["after"] == after["before"] for before, after in pairwise(worlds))
    assert steps[1].parameters["speed"] == 0.5, "at half the speed more of it is seen"
    assert Atom("hold", ("g3",)) in steps[-1].after.facts


def test_of_several_candidates_the_best_after_its_plan_is_written(sqrp, laying, program, holding):
    task = "pickup object=g1,g3"
    assert sqrp("check", laying, task, "--program", program).code == 0
    laid, written = load_program(program).steps[-2:]
    assert laid.short_task == "lay g2"
    program.write_bytes(holding.read_bytes())
    assert sqrp("rank", laying, "lay g2", "--program", program).code == 0
    best = sqrp("rank", laying, task, "--after", program, "--json").document["candidates"][0]
    assert written.parameters == best["ways"]["pareto"][0]["parameters"]
    assert (written.q_eoi, written.q_avg, written.time) == (best["q_eoi"], best["q_avg"], best["time"])


def test_without_need_of_a_plan_the_best_candidate_is_written(sqrp, laying):
    program = laying / "fresh.yaml"
    assert sqrp("check", laying, "pickup object=g1,g3", "--program", program).code == 0
    (step,) = load_program(program).steps
    best = json.loads(sqrp("rank", laying, "pickup object=g1,g3", "--json").out)["candidates"][0]
    assert dict(step.parameters) == best["ways"]["pareto"][0]["parameters"]


def test_nothing_is_written_if_a_step_cannot_be_done(sqrp, laying, program):
    before = program.read_bytes()
    outcome = sqrp("check", laying, "pickup g6", "--program", program)
    assert outcome.code == 1
    assert "after that pickup g6 cannot be done" in " ".join(outcome.out.split())
    assert "too far" in outcome.out
    assert "left as it was" in outcome.err
    assert program.read_bytes() == before
    fresh = laying / "unreachable.yaml"
    assert sqrp("check", laying, "pickup g6", "--program", fresh).code == 1
    assert not fresh.exists()


def test_writing_a_suggestion_needs_a_task(sqrp, laying):
    for option in (["--program", laying / "x.yaml"], ["--planner", "fast-downward"]):
        outcome = sqrp("check", laying, *option)
        assert (outcome.code, outcome.out) == (2, "")
        assert "task" in outcome.err


def test_another_planner_finds_the_same_plan(sqrp, laying, holding):
    pytest.importorskip("up_fast_downward")
    own = sqrp("check", laying, "pickup g3", "--after", holding, "--json")
    other = sqrp("check", laying, "pickup g3", "--after", holding, "--json", "--planner", "fast-downward")
    assert (other.code, other.out) == (own.code, own.out)


def test_an_unknown_planner_is_refused_with_those_that_are_there(sqrp, laying, holding):
    pytest.importorskip("up_fast_downward")
    outcome = sqrp("check", laying, "pickup g3", "--after", holding, "--planner", "fast-downwart")
    assert (outcome.code, outcome.out) == (2, "")
    assert "did you mean `fast-downward`?" in outcome.err


def test_a_planner_without_the_library_names_the_command_that_installs_it(sqrp, laying, holding, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "unified_planning"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "unified_planning", None)
    outcome = sqrp("check", laying, "pickup g3", "--after", holding, "--planner", "fast-downward")
    assert (outcome.code, outcome.out) == (2, "")
    assert "pip install unified-planning" in outcome.err
