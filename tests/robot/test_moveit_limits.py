"""Limits of MoveIt are taken over exactly, and what is no limit is named."""

from __future__ import annotations

import re
from math import radians
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.robot.moveit import read_moveit_limits
from tests.cells import FILES

LIMITS = (FILES / "joint_limits.yaml").read_text()


def written(folder: Path, text: str) -> Path:
    (folder / "joint_limits.yaml").write_text(text, encoding="utf-8")
    return folder / "joint_limits.yaml"


def loaded(cell: Path, limits: str) -> Workspace:
    """The cell of the tests with other limits."""
    written(cell, LIMITS)
    text = (cell / "workspace.yaml").read_text(encoding="utf-8")
    text = re.sub("  limits: .*", f"  limits: {limits}", text)
    assert limits in text
    (cell / "workspace.yaml").write_text(text, encoding="utf-8")
    return load_workspace(cell)


def test_what_is_switched_on_is_stated_and_nothing_else(tmp_path):
    limits = read_moveit_limits(written(tmp_path, LIMITS))
    assert limits.stated == {
        "velocity": {"shoulder": 2.175, "finger_of_another_gripper": 0.2},
        "acceleration": {"shoulder": 0.52},
        "jerk": {"shoulder": 300.0},
    }
    assert limits.positions == {"elbow": (radians(-45), 1.5)}
    assert limits.scaling == {"velocity": 0.5, "acceleration": 0.1}


@pytest.mark.parametrize("above", ["robot_description_planning", "/**"])
def test_a_namespace_around_it_does_not_matter(tmp_path, above):
    inner = "".join(f"  {line}\n" for line in LIMITS.splitlines())
    limits = read_moveit_limits(written(tmp_path, f"{above}:\n{inner}"))
    assert limits.stated["jerk"] == {"shoulder": 300.0}
    assert limits.scaling["velocity"] == 0.5


def test_a_workspace_takes_them_with_their_scaling(cell):
    workspace = loaded(cell, "{moveit: joint_limits.yaml, jerk: {elbow: 40}, acceleration: {slide: 3}}")
    limits = workspace.robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (0.5 * 2.175, 0.1 * 0.52)
    assert limits["shoulder"].jerk == 300.0
    assert (limits["slide"].velocity, limits["slide"].acceleration) == (0.5 * 0.5, 3.0)
    assert limits["elbow"].jerk == 40.0
    assert (limits["elbow"].lower, limits["elbow"].upper) == (radians(-45), 1.5)
    (warning,) = [warning for warning in workspace.warnings if warning.code == "unknown-joint"]
    assert "finger_of_another_gripper" in warning.message


def test_a_workspace_may_scale_otherwise(cell):
    limits = loaded(cell, "{moveit: joint_limits.yaml, velocity_scaling: 1, acceleration_scaling: 0.25}").robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (2.175, 0.25 * 0.52)
