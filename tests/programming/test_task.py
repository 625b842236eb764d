from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.task import read_task

ROOT = Path(__file__).parents[2]
BAD_TASKS = yaml.safe_load((ROOT / "tests/cases/bad_tasks.yaml").read_text())


@pytest.fixture(scope="module")
def workspace() -> Workspace:
    return load_workspace(ROOT / "workspaces/tabletop")


def objects(task: str, workspace: Workspace) -> list[str]:
    return [candidate.objects["object"] for candidate in read_task(task, workspace).candidates]


@pytest.mark.parametrize("case", BAD_TASKS, ids=[case["task"] or "empty" for case in BAD_TASKS])
def test_a_bad_task_is_refused_with_what_would_be_right(case: dict, workspace: Workspace) -> None:
    with pytest.raises(InputError) as caught:
        read_task(case["task"], workspace)
    (problem,) = caught.value.problems
    assert problem.code == case["code"]
    for fragment in case["fragments"]:
        assert fragment in problem.message


def test_words_filter_objects_by_name_type_and_colour(workspace: Workspace) -> None:
    assert objects("pickup green", workspace) == ["g1", "g2", "g3", "g4", "g5", "g6"]
    assert objects("pickup green cube", workspace) == objects("pickup green", workspace)
    assert objects("pickup red can", workspace) == ["r1", "r2"]
    assert objects("pickup G2", workspace) == ["g2"]


def test_without_a_filter_every_object_of_the_right_type_is_a_candidate(workspace: Workspace) -> None:
    movable = [name for name, thing in workspace.objects.items() if not thing.fixed]
    assert objects("pickup", workspace) == movable


def test_a_parameter_can_be_named(workspace: Workspace) -> None:
    assert objects("pickup object=g3", workspace) == ["g3"]


def test_a_motion_parameter_is_set_with_its_unit(workspace: Workspace) -> None:
    (candidate,) = read_task("pickup g1 lift=5cm speed=0.5", workspace).candidates
    assert candidate.parameters.items() >= {"object": "g1", "approach_yaw": 0.0, "lift": 0.05, "speed": 0.5}.items()
    assert candidate.name == "g1"
