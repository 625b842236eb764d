"""What is said about ways around, in a cell where a wall stands between the arm and what it picks up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli import open_cell
from sqrp_cli.show.pages.assembly import tidy
from tests.cells import write_cell
from tests.cli.conftest import Outcome
from tests.cli.pages import detail_in


@pytest.fixture
def walled(tmp_path: Path, tabletop_cell: dict[str, Any]) -> Path:
    """The tabletop with one cube behind a wall, and one behind the arm that keeps it from turning all the way round."""
    cell, things = tabletop_cell, tabletop_cell["objects"]
    cube = {**things["g1"], "pose": {"position": [0.45, -0.25, 0.02]}}
    wall = {"type": "wall", "size": [0.6, 0.02, 0.4], "pose": {"position": [0.62, -0.08, 0.2]}, "fixed": True}
    back = {"type": "wall", "size": [0.02, 1.2, 1.2], "pose": {"position": [-0.3, 0, 0.6]}, "fixed": True}
    cell["objects"] = {"table": things["table"], "g1": cube, "wall": wall, "back": back}
    cell["state"] = ["hand_empty", "obj_on_table(g1)"]
    cell["tasks"] = [{"task": "pickup"}]
    write_cell(cell, tmp_path)
    return tmp_path


def test_every_command_names_what_goes_around_what(sqrp: Callable[..., Outcome], walled: Path) -> None:
    ranking = open_cell(walled).rank("pickup", ways="fastest")
    for shown in (sqrp("check", walled, "pickup").out, f"{ranking}\n"):
        assert "g1: a1 goes around wall, a5 goes around wall\n" in shown
    assert "On the way a1 goes around wall, a5 goes around wall." in " ".join(
        sqrp("explain", walled, "pickup", "--ways", "fastest").out.split()
    )
    (candidate,) = ranking.candidates
    assert candidate.verdict.endswith("On the way a1 goes around wall, a5 goes around wall.")


def test_the_planner_says_nothing_and_the_seed_decides(
    sqrp: Callable[..., Outcome], sqrp_process: Callable[..., Outcome], walled: Path
) -> None:
    first, second, other = (
        start("rank", walled, "pickup", "--json", "--samples", 5, "--ways", "fastest", "--seed", seed)
        for start, seed in ((sqrp_process, 0), (sqrp, 0), (sqrp, 3))
    )
    assert first.code == 0
    assert "nanobind" not in first.err
    assert "Info:" not in first.err
    assert first.out == second.out != other.out


def test_a_page_of_scores_shows_the_motions_that_were_scored(
    sqrp: Callable[..., Outcome], walled: Path, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    options = ("--samples", 5, "--seed", 3)
    assert sqrp("score", walled, "--report", page, *options).code == 0
    assert (
        detail_in(page)["primitives"]
        == tidy(sqrp("explain", walled, "pickup", "--json", *options).document)["primitives"]
    )


def test_a_limit_of_time_is_shown_by_a_time_that_motions_take(sqrp, tabletop):
    refused = sqrp("rank", tabletop, "pickup green", "--max-time", "fast")
    assert refused.code == 2
    assert "a time such as `20 s`" in refused.err
