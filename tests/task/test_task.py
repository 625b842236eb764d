from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.feasibility import feasible_motion, unmet_preconditions
from sqrp_cli.task.task import impossible_tasks, read_task
from tests.cells import ROOT, edit, read_cases, refused

BAD_TASKS = read_cases("bad_tasks.yaml")


@pytest.fixture(scope="module")
def workspace() -> Workspace:
    return load_workspace(ROOT / "workspaces/tabletop")


@pytest.mark.parametrize("case", BAD_TASKS, ids=[case["task"] or "empty" for case in BAD_TASKS])
def test_a_bad_task_is_refused_with_what_would_be_right(case: dict, workspace: Workspace) -> None:
    problem = refused(read_task, case["task"], workspace)
    assert problem.code == case["code"]
    for fragment in case["fragments"]:
        assert fragment in problem.message
    assert case.get("mend", "") in (problem.mend or "")
    assert not (case.get("no_mend") and problem.mend)


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        ("pickup green", ["g1", "g2", "g3", "g4", "g5", "g6"]),
        ("pickup green cube", ["g1", "g2", "g3", "g4", "g5", "g6"]),
        ("pickup red can", ["r1", "r2"]),
        ("pickup G2", ["g2"]),
        ("pickup object=g3", ["g3"]),
        ("pickup object=g3,r1,g1", ["g3", "r1", "g1"]),
        ("pickup", None),  # every object of the right type
    ],
)
def test_words_and_settings_filter_objects(task: str, expected: list[str] | None, workspace: Workspace) -> None:
    movable = [name for name, thing in workspace.objects.items() if not thing.fixed]
    found = [candidate.binding["object"] for candidate in read_task(task, workspace).candidates]
    assert found == (movable if expected is None else expected)


def test_a_part_on_itself_is_no_candidate_unless_nothing_else_is_asked_for(workspace: Workspace) -> None:
    names = [one.name for one in read_task("stack green", workspace).candidates]
    assert "g1 g2" in names
    assert not [name for name in names if len(set(name.split())) == 1]
    assert [one.name for one in read_task("stack g1 g1", workspace).candidates] == ["g1 g1"]


def test_a_motion_parameter_is_set_with_its_unit(workspace: Workspace) -> None:
    (candidate,) = read_task("pickup g1 lift=5cm speed=0.5", workspace).candidates
    assert candidate.parameters.items() >= {"object": "g1", "approach_yaw": "any", "lift": 0.05, "speed": 0.5}.items()
    assert candidate.name == "g1"


def test_several_values_of_a_parameter_are_tried_in_all_combinations(workspace: Workspace) -> None:
    candidates = read_task("pickup g1 lift=5cm,0.1 elbow=up,down approach_yaw=0,90deg", workspace).candidates
    assert [candidate.name for candidate in candidates][:3] == [
        "g1 approach_yaw=0 lift=50mm elbow=up",
        "g1 approach_yaw=0 lift=50mm elbow=down",
        "g1 approach_yaw=0 lift=100mm elbow=up",
    ]
    assert len(candidates) == 8
    assert {candidate.parameters["lift"] for candidate in candidates} == {0.05, 0.1}


def test_a_candidate_is_found_again_by_its_name(workspace: Workspace) -> None:
    """What tells candidates apart can be written in a task, so that the same one comes of it."""
    for candidate in read_task("pickup g1 lift=5cm,0.1 approach_yaw=0,30deg wrist=flip,any", workspace).candidates:
        (again,) = read_task(f"pickup {candidate.name}", workspace).candidates
        assert again.parameters == pytest.approx(candidate.parameters)


@pytest.mark.parametrize(
    ("count", "task", "says"),
    [
        (
            1,
            "pickup lift=" + ",".join(f"{k}mm" for k in range(1, 90_000)),
            "most of all for `lift` of `pickup`, with 89,999",
        ),
        (16, "pickup red", "candidates, the limit is 100,000; name fewer objects or values"),
        (60, "pickup", "the task has more than 10^12 candidates, the limit is 100,000"),
        (1000, "pickup red", "1 word may be meant for 1,001 parameters of `pickup` in too many ways"),
    ],
)
def test_a_skill_of_many_parameters_is_refused_before_all_of_them_are_combined(
    count: int, task: str, says: str, tmp_path: Path
) -> None:
    cell = shutil.copytree(ROOT / "tests/cases/cell", tmp_path / "cell")
    path = cell / "pickup" / "pickup.pddl"
    more = " ".join(f"?v{k}" for k in range(count))
    edit(path, ":parameters (?object - movable)", f":parameters (?object {more} - movable)")
    assert says in refused(read_task, task, load_workspace(cell)).message


def test_words_for_a_skill_of_fifteen_parameters_are_reported_apart_at_once(workspace: Workspace) -> None:
    skill = workspace.skills["pickup"]
    parameters = tuple(replace(skill.action.parameters[0], name=f"p{number}") for number in range(15))
    large = replace(workspace, skills={"pickup": replace(skill, action=replace(skill.action, parameters=parameters))})
    named = " ".join(f"p{number}=g1" for number in range(3, 15))
    (candidate,) = read_task(f"pickup g2 g3 g4 {named}", large).candidates
    assert list(candidate.binding.values())[:4] == ["g2", "g3", "g4", "g1"]
    assert "candidates, the limit is 100,000" in refused(read_task, "pickup g1 g2 g3", large).message
    problem = refused(read_task, "pickup g1 g2 g3 g1 g2 g3 g1 g2 g3", large)
    assert "9 words may be meant for 15 parameters of `pickup` in too many ways" in problem.message
    assert problem.mend == "say which parameter each is for: `name=object`"


FILE = ROOT / "workspaces" / "tabletop" / "workspace.yaml"
LISTED = "  - {task: pickup green, min_q_eoi: 0.5}"


@pytest.mark.parametrize(
    ("entry", "code", "at", "says"),
    [
        ("winner: crate", "impossible-winner", "winner", "no candidate of `pickup green` uses `crate`"),
        ("winner: r1", "impossible-winner", "winner", "did you mean `g1`?"),
        ("feasible: false, min_q_eoi: 0.5", "contradictory-expectations", "min_q_eoi", "`min_q_eoi` expected of"),
        ("max_time: 3, feasible: false, winner: g1", "contradictory-expectations", "max_time", "`winner` expected of"),
    ],
)
def test_an_expectation_that_cannot_be_met_is_reported_where_it_stands(
    entry: str, code: str, at: str, says: str
) -> None:
    line = f"  - {{task: pickup green, {entry}}}"
    text = FILE.read_text(encoding="utf-8").replace(LISTED, line)
    (problem,) = impossible_tasks(load_workspace(FILE, text.encode()))
    assert (problem.code, problem.severity) == (code, "warning")
    assert says in problem.message
    assert problem.mend
    number = text.splitlines().index(line) + 1
    assert str(problem.place) == f"{FILE}:{number}:{line.index(at) + 1}"


@pytest.mark.parametrize("entry", ["pickup green, feasible: false", "pickup green, winner: g2", "pickup red can"])
def test_other_expectations_are_left_alone(entry: str) -> None:
    text = FILE.read_text(encoding="utf-8").replace(LISTED, f"  - {{task: {entry}}}")
    assert list(impossible_tasks(load_workspace(FILE, text.encode()))) == []


def test_what_keeps_a_candidate_from_beginning_is_named(tabletop: Workspace) -> None:
    cell = Cell.load(tabletop)
    world, candidate = cell.initial_world, read_task("pickup g2", tabletop).candidates[0]
    nothing = replace(world, facts=frozenset())
    unmet = tuple(f"`pickup` needs `{one}`, which does not hold" for one in ("obj_on_table(g2)", "hand_empty"))
    assert unmet_preconditions(cell, candidate, nothing) == unmet
    lost = replace(world, X_WO={name: X for name, X in world.X_WO.items() if name != "g2"})
    crate_at_tool = replace(world, X_WO={**world.X_WO, "crate": cell.model.tool_pose(cell.model.home)})
    for begun, reasons in ((nothing, unmet), (lost, ("it is not known where `g2` is",)), (crate_at_tool, None)):
        found = feasible_motion(cell, candidate, begun)
        assert isinstance(found, Infeasible)
        if reasons is None:
            (reason,) = found.reasons
            assert "hits crate before anything moves" in reason
        else:
            assert found.reasons == reasons
