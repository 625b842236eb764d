"""A run in which the robot has to move on before its cameras can judge a retry, and one with a camera on the arm."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
ARM = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")


def workspace_of(name: str) -> dict[str, Any]:
    text = (ROOT / "workspaces" / name / "workspace.yaml").read_text(encoding="utf-8")
    found = yaml.safe_load(text.replace(" on: ", " 'on': "))  # YAML 1.1 takes a bare `on` for a truth value
    found["robot"]["tool"]["urdf"] = str(ROOT / "workspaces" / "robots" / Path(found["robot"]["tool"]["urdf"]).name)
    found["skills"] = [str(ROOT / "skills" / Path(skill).name) for skill in found["skills"]]
    return found


@pytest.fixture(scope="module")
def moved_on(sqrp: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A slip of red2 in a lift that is out of sight; a faster arm, fewer cameras and fewer images than usual."""
    folder = tmp_path_factory.mktemp("screws")
    cell = workspace_of("screws")
    cell["cameras"] = {name: {**cell["cameras"][name], "rate": "5 Hz"} for name in ("cam3", "cam4")}
    for limit, value in (("velocity", "60 deg/s"), ("acceleration", "300 deg/s^2"), ("jerk", "2000 deg/s^3")):
        cell["robot"]["limits"][limit] |= dict.fromkeys(ARM, value)
    (folder / "workspace.yaml").write_text(yaml.safe_dump(cell, sort_keys=False), encoding="utf-8")
    program = folder / "pick.yaml"
    assert sqrp("rank", folder, "pickup_two_finger red2", "--program", program).code == 0
    return sqrp("run", program, "--sim", "--fault", "slip@a4+1.7", "--json", "--log", folder / "run.jsonl")


def test_the_robot_moves_on_to_where_the_retry_can_be_judged(moved_on: Any) -> None:
    assert moved_on.code == 0, moved_on.document["reason"]
    (fault,) = moved_on.document["faults"]
    assert moved_on.document["steps"][0]["attempts"] == 2
    assert fault["moved_on"] > 0.3
    assert fault["detected"] + fault["moved_on"] < fault["acted"] < fault["recovered"]
