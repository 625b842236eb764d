"""The Python interface answers what the commands answer, figure by figure and line by line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sqrp_cli import OpenCell, new_cell, open_cell, open_program, read_run
from sqrp_cli.errors import InputError
from sqrp_cli.programming.coverage.robustness import Calibration
from sqrp_cli.programming.coverage.sampling import Adaptive, FixedCount

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"


@pytest.fixture(scope="module")
def cell() -> OpenCell:
    return open_cell(TABLETOP)


@pytest.fixture(autouse=True)
def at_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")


def printed(sqrp, *arguments: object) -> str:
    return sqrp(*arguments).out.rstrip("\n")


def test_a_ranking_is_the_table_and_the_document_of_rank(sqrp, cell):
    ranking = cell.rank("pickup green")
    assert str(ranking) == printed(sqrp, "rank", TABLETOP, "pickup green")
    assert ranking.to_json() == printed(sqrp, "rank", TABLETOP, "pickup green", "--json")
    assert [one.parameters["object"] for one in ranking.candidates] == ["g2", "g5", "g3", "g4", "g1", "g6"]


def test_an_explanation_is_that_of_explain(sqrp, cell):
    explanation = cell.explain("pickup green", "g1")
    assert str(explanation) == printed(sqrp, "explain", TABLETOP, "pickup green", "--choose", "g1")
    assert explanation.to_json() == printed(sqrp, "explain", TABLETOP, "pickup green", "--choose", "g1", "--json")


def test_all_candidates_can_be_compared(sqrp, cell):
    assert str(cell.explain("pickup green", None)) == printed(sqrp, "explain", TABLETOP, "pickup green", "--all")


@pytest.mark.parametrize("task", [(), ("pickup green",)], ids=["workspace", "task"])
def test_a_check_is_that_of_check(sqrp, cell, task):
    arguments = ("check", TABLETOP, *task)
    assert cell.check(*task).to_json() == printed(sqrp, *arguments, "--json")
    assert str(cell.check(*task)) == printed(sqrp, *arguments)


def test_scores_are_those_of_score(sqrp, cell):
    scores = cell.score()
    assert scores.passed
    assert str(scores) == printed(sqrp, "score", TABLETOP)
    assert scores.to_json() == printed(sqrp, "score", TABLETOP, "--json")


def test_a_scene_is_that_of_show(sqrp, cell):
    assert str(cell.scene()) == printed(sqrp, "show", TABLETOP)
    assert json.loads(cell.scene().to_json())["workspace"] == "tabletop"


def test_a_notebook_shows_the_table_with_colours(cell):
    html = cell.rank("pickup g2")._repr_html_()
    assert html.startswith("<pre")
    assert "Q_eoi" in html
    assert "color:" in html


def test_a_workspace_with_errors_is_not_opened(tmp_path):
    (tmp_path / "workspace.yaml").write_text("robot: 1\n")
    with pytest.raises(InputError, match=r"workspace\.yaml:1"):
        open_cell(tmp_path)


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (lambda cell: cell.rank(None), "task is None, expected a skill and what to do it with"),
        (lambda cell: cell.rank("pickup g2", sampling=0.01), "sampling is 0.01, expected Adaptive(tolerance)"),
        (lambda cell: cell.rank("pickup g2", sampling=FixedCount(1)), "sampling is FixedCount(samples=1), expected"),
        (lambda cell: cell.rank("pickup g2", sampling=Adaptive(float("nan"))), "sampling is Adaptive(tolerance=nan)"),
        (lambda cell: cell.rank("pickup g2", calibration="5 mm"), "calibration is '5 mm', expected Calibration("),
        (lambda cell: cell.rank("pickup g2", calibration=Calibration(5, 0.5, 0)), "up to 1 m and up to 1 rad"),
        (lambda cell: cell.rank("pickup g2", by="speed"), "by is 'speed', expected one of q_eoi, q_avg"),
        (lambda cell: cell.rank("pickup g2", jobs=0), "jobs is 0, expected a whole number from 1 on"),
        (lambda cell: cell.explain("pickup g2", 2), "choose is 2, expected the name of a candidate"),
        (lambda cell: cell.explain("pickup g2", jobs=1.5), "jobs is 1.5"),
        (lambda cell: cell.check("pickup g2", jobs=True), "jobs is True"),
        (lambda cell: cell.check(7), "task is 7"),
        (lambda cell: cell.check("pickup g2", after=7), "after is 7, expected a path"),
        (lambda cell: cell.score(jobs=-1), "jobs is -1"),
        (lambda _: open_cell(None), "path is None, expected a path"),
        (lambda _: open_cell(TABLETOP, seed=-1), "seed is -1, expected a whole number from 0 on"),
        (lambda _: open_program(7), "path is 7"),
        (lambda _: read_run(None), "log is None"),
        (lambda _: new_cell(""), "folder is '', expected a path"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_with_what_was_expected(cell, question, said):
    with pytest.raises(InputError) as refused:
        question(cell)
    assert said in str(refused.value)


def test_a_new_cell_is_that_of_init_and_can_be_opened(sqrp, tmp_path):
    made = new_cell(tmp_path / "one")
    assert str(made).replace("/one", "/two") == printed(sqrp, "init", tmp_path / "two")
    assert made.to_json().replace("/one", "/three") == printed(sqrp, "init", tmp_path / "three", "--json")
    assert open_cell(made.path).check().valid


def test_a_ranking_writes_the_program_that_rank_writes(sqrp, cell, tmp_path):
    cell.rank("pickup green").write(tmp_path / "one.yaml", "g5")
    sqrp("rank", TABLETOP, "pickup green", "--choose", "g5", "--program", tmp_path / "two.yaml")
    assert (tmp_path / "one.yaml").read_text() == (tmp_path / "two.yaml").read_text()
    with pytest.raises(InputError, match=r"g6 is infeasible .*, so .*three.yaml was not written"):
        cell.rank("pickup green").write(tmp_path / "three.yaml", "g6")


def test_a_program_runs_and_its_log_and_frames_tell_the_same(sqrp, quick_cell, tmp_path):
    program = open_program(quick_cell.program)
    log, frames = tmp_path / "log", tmp_path / "frames"
    run = program.run(log=log, frames=frames)
    assert run.done
    assert str(run) == printed(sqrp, "run", quick_cell.program, "--sim")
    assert read_run(log).document.steps == run.document.steps
    audit = program.audit(frames)
    assert audit.to_json() == printed(sqrp, "audit", quick_cell.program, frames, "--json")
    for fault in (7, ["sli@a1"]):
        with pytest.raises(InputError):
            program.run(fault)
