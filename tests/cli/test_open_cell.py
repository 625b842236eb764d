"""The front door answers what the commands answer, figure by figure and line by line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sqrp_cli import OpenCell, open_cell
from sqrp_cli.errors import InputError

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
