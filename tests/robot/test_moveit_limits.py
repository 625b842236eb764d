"""Limits of MoveIt are taken over exactly, and what is no limit is named."""

from __future__ import annotations

import re
from math import radians
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.robot.moveit import read_moveit_limits

LIMITS = """\
default_velocity_scaling_factor: 0.5
default_acceleration_scaling_factor: 0.1
joint_limits:
  shoulder:
    has_velocity_limits: true
    max_velocity: 2.175
    has_acceleration_limits: true
    max_acceleration: 0.52
    has_jerk_limits: true
    max_jerk: 300
  elbow:
    has_velocity_limits: false
    max_velocity: 9
    has_acceleration_limits: false
    max_acceleration: 0
    min_position: !degrees -45
    max_position: 1.5
  finger_of_another_gripper:
    max_velocity: 0.2
"""


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


def test_what_is_switched_on_is_stated_and_nothing_else(tmp_path: Path) -> None:
    limits = read_moveit_limits(written(tmp_path, LIMITS))
    assert limits.stated == {
        "velocity": {"shoulder": 2.175, "finger_of_another_gripper": 0.2},
        "acceleration": {"shoulder": 0.52},
        "jerk": {"shoulder": 300.0},
    }
    assert limits.positions == {"elbow": (radians(-45), 1.5)}
    assert limits.scaling == {"velocity": 0.5, "acceleration": 0.1}


@pytest.mark.parametrize("above", ["robot_description_planning", "/**"])
def test_a_namespace_around_it_does_not_matter(tmp_path: Path, above: str) -> None:
    inner = "".join(f"  {line}\n" for line in LIMITS.splitlines())
    limits = read_moveit_limits(written(tmp_path, f"{above}:\n{inner}"))
    assert limits.stated["jerk"] == {"shoulder": 300.0}
    assert limits.scaling["velocity"] == 0.5


@pytest.mark.parametrize(
    ("old", "new", "code", "line", "said"),
    [
        ("joint_limits:", "joints:", "missing-key", None, "expected `joint_limits:`"),
        ("max_velocity: 2.175", "max_velocity: fast", "wrong-type", 6, "shoulder.max_velocity`: found `fast`"),
        ("max_velocity: 2.175", "max_velocity: -1", "wrong-value", 6, "found -1"),
        ("max_velocity: 2.175", "max_velocty: 1", "unknown-key", 6, "did you mean `max_velocity`"),
        ("has_velocity_limits: true", "has_velocity_limits: sure", "wrong-type", 5, "`true` or `false`"),
        ("max_position: 1.5", "max_position: -1.5", "wrong-value", 16, "above `max_position`"),
        ("factor: 0.5", "factor: 5", "wrong-value", 1, "at most 1"),
        ("  shoulder:\n", "  shoulder: 3\n  wrist:\n", "wrong-type", 4, "expected a mapping"),
        ("max_velocity: 2.175", "max_velocity: [2.175", "yaml-syntax", 6, ""),
    ],
)  # fmt: skip
def test_a_damaged_file_has_one_good_message(
    tmp_path: Path, old: str, new: str, code: str, line: int | None, said: str
) -> None:
    assert old in LIMITS
    with pytest.raises(InputError) as caught:
        read_moveit_limits(written(tmp_path, LIMITS.replace(old, new, 1)))
    problem = caught.value.problems[0]
    assert (problem.code, problem.place.line) == (code, line)
    assert said in problem.message


def test_a_workspace_takes_them_with_their_scaling(cell: Path) -> None:
    workspace = loaded(cell, "{moveit: joint_limits.yaml, jerk: {elbow: 40}, acceleration: {slide: 3}}")
    limits = workspace.robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (0.5 * 2.175, 0.1 * 0.52)
    assert limits["shoulder"].jerk == 300.0
    assert (limits["slide"].velocity, limits["slide"].acceleration) == (0.5 * 0.5, 3.0)
    assert limits["elbow"].jerk == 40.0
    assert (limits["elbow"].lower, limits["elbow"].upper) == (radians(-45), 1.5)
    (warning,) = [warning for warning in workspace.warnings if warning.code == "unknown-joint"]
    assert "finger_of_another_gripper" in warning.message


def test_a_workspace_may_scale_otherwise(cell: Path) -> None:
    limits = loaded(cell, "{moveit: joint_limits.yaml, velocity_scaling: 1, acceleration_scaling: 0.25}").robot.limits
    assert (limits["shoulder"].velocity, limits["shoulder"].acceleration) == (2.175, 0.25 * 0.52)
