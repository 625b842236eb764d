"""Tasks of several steps: which choices go together, and figures over the whole."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from sqrp_cli.ask.api.cell import OpenCell, open_cell
from sqrp_cli.ask.api.program import open_program
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.program.file import load_program, stale
from sqrp_cli.show.documents.programs import ProgramDocument
from sqrp_cli.study.result import Ranking
from sqrp_cli.task.task import read_task

CELL = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"
TASK = "pickup peg then insert peg socket yaw=0"


@pytest.fixture(scope="module")
def cell() -> OpenCell:
    return open_cell(CELL)


@pytest.fixture(scope="module")
def ranking(cell: OpenCell) -> Ranking:
    return cell.rank(TASK, ways="fastest")


def test_only_choices_whose_preconditions_hold_one_after_the_other_are_candidates(cell: OpenCell) -> None:
    found = read_task(TASK, cell.workspace)
    assert [one.name for one in found.candidates] == [f"pickup peg{n} then insert peg{n} socket" for n in (1, 2)]
    assert found.candidates[0].parameters["2.into"] == "socket"
    assert [one.feasible for one in cell.check(TASK).candidates] == [True, True]


def test_a_task_whose_steps_do_not_go_together_says_what_is_missing(cell: OpenCell) -> None:
    (one,) = cell.rank("pickup peg1 then pickup peg2").candidates
    assert not one.feasible
    assert one.reasons[0].startswith("step 2, pickup peg2: `pickup` needs `hand_empty`")


def test_the_figures_of_the_whole_are_those_of_the_steps_by_hand(
    cell: OpenCell, ranking: Ranking, tmp_path: Path
) -> None:
    """The same steps for peg2, the second ranked from the program of the first."""
    first = cell.rank("pickup peg2", ways="fastest")
    first.write(tmp_path / "program.yaml")
    by_hand = [first, cell.rank("insert peg2 socket yaw=0", after=tmp_path / "program.yaml", ways="fastest")]
    whole = next(one for one in ranking.candidates if one.parameters["1.object"] == "peg2")
    assert whole.steps is not None
    for found, alone in zip(whole.steps, (one.best for one in by_hand), strict=True):
        figures = [(one.time, one.q_avg, one.q_eoi, one.states) for one in (found, alone)]
        assert figures[0] == pytest.approx(figures[1], rel=1e-9)
    assert whole.time == pytest.approx(sum(one.time for one in whole.steps))
    assert whole.t_total == pytest.approx(sum(one.t_total for one in whole.steps))
    assert whole.q_avg == pytest.approx(sum(one.q_avg * one.t_total for one in whole.steps) / whole.t_total)
    assert set(whole.faults) == {"1.slip", "2.dropped", "2.missed"}
    slip = whole.steps[0].faults["slip"]
    assert whole.faults["1.slip"].delay_worst == slip.delay_worst
    assert whole.faults["1.slip"].expected_time == pytest.approx(slip.expected_time + whole.steps[1].time)


def test_a_program_of_the_whole_has_its_steps_and_each_can_be_explained(
    ranking: Ranking, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "program.yaml"
    ranking.write(file)
    program = open_program(file)
    assert [step.short_task for step in program.program.steps] == ["pickup peg1", "insert peg1 socket"]
    second = program.explain(2)
    assert second.task == "insert peg1 socket"
    assert (second.time, second.q_avg) == pytest.approx((program.program.steps[1].time, program.program.steps[1].q_avg))
    second.show()
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("Step 2 of 2, insert peg1 socket: if `dropped` happens (to over), you never know")
    assert f"shoulder left (to over), critical time seen 100.0 %, time seen 100.0 %, time {second.time:.2f} s 0" in said
    with pytest.raises(InputError, match=r"^step is 3, but .* has 2 steps; expected 1 to 2"):
        program.explain(3)


def test_the_explanation_of_a_step_says_which_it_is_and_the_place_of_the_whole(
    cell: OpenCell, ranking: Ranking, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = ranking.candidates[1]
    assert (whole.parameters["1.object"], whole.rank, whole.pareto) == ("peg2", 2, False)
    second = cell.explain(TASK, step=2, ways="fastest")
    assert (second.task, second.samples[0].held) == ("insert peg1 socket", "peg1"), "in the world that the first leaves"
    found = cell.explain(TASK, "2", step=1, ways="fastest")
    found.show()
    said = " ".join(capsys.readouterr().out.split())
    whole_is = f", time {found.time:.2f} s The whole, pickup peg2 then insert peg2 socket, is rank 2. 0 "
    assert said.startswith("Step 1 of 2, pickup peg2: ")
    assert (said.count(whole_is), said.count("rank")) == (1, 1)
    document = json.loads(found.to_json())
    assert (document["task"], document["step"], document["rank"], document["pareto"]) == ("pickup peg2", 1, 2, False)
    assert whole.steps is not None
    assert document["time"] == whole.steps[0].time


def test_a_program_names_a_workspace_file_as_other_commands_do(ranking: Ranking, tmp_path: Path) -> None:
    """A file that is not `workspace.yaml` cannot be asked for by its folder."""
    file = tmp_path / "program.yaml"
    ranking.write(file)
    program = load_program(file)
    document = ProgramDocument.of(program, file, stale=False)
    assert document.workspace == "peg"
    assert str(document).startswith("program.yaml for peg: 2 steps")
    words = shlex.split(str(document).splitlines()[-1])
    assert (words[:2], Path(words[2]).resolve()) == (["sqrp", "rank"], CELL)
    changed = stale(program.model_copy(update={"digest": "0"}), file, load_workspace(CELL))
    assert changed is not None
    assert f"sqrp rank {CELL} 'pickup peg1'" in (changed.mend or "")


def test_a_listed_task_that_needs_another_first_is_planned_and_scored_as_a_whole(cell: OpenCell) -> None:
    first, second = cell.score().results
    assert (first.task, first.status) == (TASK, "passed")
    assert (second.task, second.status) == ("insert peg2 socket yaw=0", "passed")
    assert second.best is not None
    assert second.best.parameters["1.object"] == "peg2"
    assert second.best.time == pytest.approx(cell.rank("pickup peg2 then insert peg2 socket yaw=0").candidates[0].time)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("{}", "expected exactly one of the keys `task`, `steps`"),
        ("{task: pickup peg1, steps: [pickup peg1]}", "expected exactly one of the keys `task`, `steps`"),
        ("{steps: [pickup peg1, inset peg1]}", "found `inset`, which is no skill of this workspace"),
    ],
)
def test_a_listed_task_that_is_wrong_is_named(task: str, message: str) -> None:
    text = CELL.read_text(encoding="utf-8").split("\ntasks:")[0] + f"\ntasks: [{task}]\n"
    with pytest.raises(InputError, match=re.escape(message)):
        load_workspace(CELL, text.encode())
