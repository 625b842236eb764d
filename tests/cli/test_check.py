"""What `sqrp check` says of a workspace, of plans, and of a part that is out of reach."""

from __future__ import annotations

import math
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.program.file import load_program
from tests.cells import edit, write_cell
from tests.cli.conftest import ROOT, Outcome

SHIPPED = sorted(path.parent for path in (ROOT / "workspaces").glob("*/workspace.yaml"))
CASES = [ROOT / "tests" / "cases" / name for name in ("cell", "gripper", "watch")]


def _codes(outcome: Outcome) -> set[str]:
    return {problem["code"] for problem in outcome.document["problems"]}


@pytest.mark.parametrize("cell", [*SHIPPED, *CASES], ids=lambda path: path.name)
def test_the_cells_that_come_with_the_program_work_as_they_are_meant(sqrp, cell):
    assert _codes(sqrp("check", cell, "--json")) <= {"assumed-limit"}


def test_show_says_what_is_doubted_of_the_files_as_check_does(sqrp, tmp_path):
    cell = Path(shutil.copytree(ROOT / "tests" / "cases" / "cell", tmp_path / "cell"))
    stated = "    frame: wrist\n    pose: {position: [0, 0.05, 0], quaternion: [0, 0, 0, 1]}\n"
    edit(cell, stated, f"    hand_eye: {ROOT / 'tests' / 'cases' / 'cameras' / 'easy_handeye_early.yaml'}\n")
    for command in ("check", "show"):
        assert "does not sound like an optical frame" in sqrp(command, cell).err.replace("\n", " "), command


@pytest.fixture
def program(holding):
    path = holding.with_name("program.yaml")
    shutil.copy(holding, path)
    yield path
    path.unlink()


def test_a_plan_is_what_ranking_its_steps_gives_and_the_best_after_it_is_written(sqrp, laying, holding, program):
    # The plan of the document is what ranking its step gives.
    (candidate,) = sqrp("check", laying, "pickup g3", "--after", holding, "--json").document["candidates"]
    best = sqrp("rank", laying, "lay g2", "--after", holding, "--json").document["candidates"][0]
    (step,) = candidate["plan"]
    assert candidate["planning"] == "plan"
    figures = ("feasible", "q_avg", "q_eoi", "time", "reasons")
    assert step == {"task": "lay g2", "action": "lay(g2)", **{name: best[name] for name in figures}}
    # Of several candidates the best after its plan is written.
    task = "pickup object=g1,g3"
    assert sqrp("check", laying, task, "--program", program).code == 0
    laid, written = load_program(program).steps[-2:]
    assert laid.short_task == "lay g2"
    program.write_bytes(holding.read_bytes())
    assert sqrp("rank", laying, "lay g2", "--program", program).code == 0
    best = sqrp("rank", laying, task, "--after", program, "--json").document["candidates"][0]
    assert written.parameters == best["ways"]["pareto"][0]["parameters"]
    assert (written.q_eoi, written.q_avg, written.time) == (best["q_eoi"], best["q_avg"], best["time"])


def test_a_planner_without_the_library_names_the_command_that_installs_it(sqrp, laying, holding, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "unified_planning"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "unified_planning", None)
    outcome = sqrp("check", laying, "pickup g3", "--after", holding, "--planner", "fast-downward")
    assert (outcome.code, outcome.out) == (2, "")
    assert "pip install unified-planning" in outcome.err


def missing_reach(candidate: dict[str, Any]) -> float | None:
    """By how much [m] a candidate is said to be too far, None where it is not for that."""
    figure = re.search(r"(\d+(?:\.\d+)?) m\b", candidate["reasons"][0] if candidate["reasons"] else "")
    return float(figure[1]) if figure and "out of reach" in candidate["reasons"][0] else None


def test_the_reason_of_g6_says_by_how_much_it_is_out_of_reach_and_moving_it_by_less_does_not_help(
    ranked, sqrp, tabletop_cell, tmp_path
):
    # The reason of g6 says by how much it is out of reach.
    figure = missing_reach(ranked.document["candidates"][-1])
    assert figure is not None
    assert figure > 0.0
    # Moving an object by less than it is too far does not help.
    x, y, z = tabletop_cell["objects"]["g6"]["pose"]["position"]
    away = math.hypot(x, y)
    closer = 0.9 * (figure - 0.005)  # the figure is rounded
    tabletop_cell["objects"]["g6"]["pose"]["position"] = [x - closer * x / away, y - closer * y / away, z]
    write_cell(tabletop_cell, tmp_path)
    (g6,) = sqrp("check", tmp_path, "pickup g6", "--json").document["candidates"]
    assert 0.0 <= missing_reach(g6) < figure
