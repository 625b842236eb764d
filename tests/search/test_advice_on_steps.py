"""Advice on tasks of several steps: the least change of the cell with which the whole meets a goal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.ask.api.advice import changed_file
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import displacement
from sqrp_cli.search.advice_result import AdviceDocument
from sqrp_cli.search.bound import CameraBound
from sqrp_cli.search.goal import read_goal
from sqrp_cli.search.question import ProposedChange, analysed_again
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.whole_analysis import WholeAnalysis, whole_analysis
from sqrp_cli.task.task import read_task

pytestmark = pytest.mark.slow

CELL = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"
TASK = "pickup peg2 then insert peg2 socket yaw=0"


def with_one_camera(degrees: float) -> OpenCell:
    """The cell of pegs with a camera that looks past the middle."""
    before, after = CELL.read_text(encoding="utf-8").split("\n  front:")
    left = after.split("\n  left:")[1].replace("0.4, 0, 0.1]}", "0.3, 0.1, 0.1]}")
    text = f"{before}\n  left:{left}".replace("36 deg", f"{degrees} deg")
    return OpenCell(CELL, load_workspace(CELL, text.encode()), content=text.encode())


@pytest.fixture(scope="module")
def cell() -> OpenCell:
    return with_one_camera(28)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def advice(cell: OpenCell, kept: Path) -> AdviceDocument:
    return cell.advise(TASK, want="q_eoi 100 %, q_avg 95 %", kinds=["way", "lens"], out=kept)


def whole(cell: OpenCell, found: AdviceDocument) -> WholeAnalysis:
    """The way that an advice is about, in a cell."""
    studied = whole_analysis(cell.cell, found.advice[0].found.way, cell.cell.initial_world, Adaptive(), full=True)
    assert isinstance(studied, WholeAnalysis)
    return studied


def test_the_advised_lens_meets_the_goal_and_one_a_little_narrower_does_not(advice: AdviceDocument) -> None:
    (lens,) = [one for one in advice.advice if one.kind == "lens"]
    view = 28 + np.degrees(lens.change[0])
    assert view > 28
    found = whole(with_one_camera(round(view, 2)), advice).result
    assert advice.want.met(found)
    assert (lens.q_eoi, lens.q_avg, lens.time) == pytest.approx((found.q_eoi, found.q_avg, found.time), abs=2e-3)
    assert not advice.want.met(whole(with_one_camera(round(view - 0.1, 2)), advice).result)


def test_figures_before_are_those_of_rank(cell: OpenCell, advice: AdviceDocument) -> None:
    ranked = cell.rank(TASK, ways="fastest").best
    before = advice.before
    assert (before.q_eoi, before.q_avg, before.time) == (ranked.q_eoi, ranked.q_avg, ranked.time)


def test_listed_tasks_of_several_steps_and_those_that_need_others_first_are_among_those_it_may_cost(
    advice: AdviceDocument,
) -> None:
    (lens,) = [one for one in advice.advice if one.kind == "lens"]
    names = {effect.task: [one.candidate for one in effect.candidates] for effect in lens.tasks}
    assert names == {
        "pickup peg then insert peg socket yaw=0": [
            f"pickup {one} then insert {one} socket" for one in ("peg1", "peg2")
        ],
        "insert peg2 socket yaw=0": ["pickup peg2 then insert peg2 socket"],
        TASK: ["pickup peg2 then insert peg2 socket"],
    }


def test_a_kept_answer_is_read_as_it_was_found(cell: OpenCell, advice: AdviceDocument, kept: Path) -> None:
    files = {file: file.stat().st_mtime_ns for file in kept.glob("*/*.json")}
    assert len(files) == 2
    again = cell.advise(TASK, want="q_eoi 100 %, q_avg 95 %", kinds=["way", "lens"], out=kept)
    assert again.to_json() == advice.to_json()
    assert {file: file.stat().st_mtime_ns for file in files} == files


def test_the_nearest_way_says_what_each_step_does_and_its_task_has_it_alone(
    advice: AdviceDocument,
) -> None:
    (nearest,) = [one.nearest for one in advice.kinds if one.kind == "way"]
    assert nearest is not None
    assert "step 1 " in nearest.words
    assert ", step 2 " in nearest.words
    assert nearest.limit.startswith("step ")
    changed = load_workspace(CELL, changed_file(advice.question, advice.file, nearest.proposed))
    assert changed.tasks[-1].steps[1].startswith("insert peg2 socket")
    (candidate,) = read_task(changed.tasks[-1].task, changed).candidates
    assert {**candidate.all_parameters, **nearest.proposed.parameters} == candidate.all_parameters


@pytest.mark.parametrize("goal", ["q_eoi 90 %", "q_avg 80 %, delay 1 s", "q_eoi 100 %"])
def test_what_meets_a_goal_about_all_steps_passes_the_bound(cell: OpenCell, advice: AdviceDocument, goal: str) -> None:
    studied, wanted, rng = whole(cell, advice), read_goal(goal), np.random.default_rng(len(goal))
    camera = cell.workspace.cameras["left"]
    bound = CameraBound(cell.cell, studied.steps, wanted, 0)
    poses = np.array([camera.X_FC @ displacement(*(0.08 * rng.normal(size=(2, 3)))) for _ in range(12)])
    passes = bound.passes([camera], poses)
    assert 0 < passes.sum() < len(poses)
    for X_FC, passed in zip(poses, passes, strict=True):
        moved = replace(camera, X_FC=X_FC)
        change = ProposedChange(kind="position", target="left", size=0.0, unit="m", camera=moved)
        met = wanted.met(analysed_again(change.in_cell(cell.cell), studied, Adaptive()).result)
        assert passed or not met
