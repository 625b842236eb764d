"""What the tool holds at the beginning: stated as a pose, or told from the facts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sqrp_cli.knowledge.lint import lint
from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.knowledge.workspace import Workspace

Damage = Callable[[dict[str, Any]], Path]


def loaded(damaged: Damage, **replace: str) -> Workspace:
    texts = {"state": "  - on_table(red)", "pose": "pose: {position: [0.4, 0, 2 cm]}"}
    edits = {texts[key]: value for key, value in replace.items()}
    return load_workspace(damaged({"file": "workspace.yaml", "replace": edits}))


@pytest.mark.parametrize(
    ("pose", "center", "up"),
    [
        ("pose: {held: +z}", [0, 0, 0.02], [0, 0, -1]),  # by its top: upside down before the tool
        ("pose: {held: -x, depth: 1 cm}", [0, 0, 0.01], [0, 1, 0]),
        ("pose: {held: +z, yaw: 90 deg}", [0, 0, 0.02], [0, 0, -1]),
    ],
)
def test_what_is_held_lies_before_the_tool_as_its_side_says(
    damaged: Damage, pose: str, center: list[float], up: list[float]
) -> None:
    world = loaded(damaged, pose=pose, state="  - hold(red)").stated_world
    assert world.held == "red"
    assert world.X_TO is not None
    assert world.X_TO[:3, 3] == pytest.approx(center, abs=1e-12)
    assert np.abs(world.X_TO[:3, 2]) == pytest.approx(np.abs(up), abs=1e-12)
    assert "red" not in world.X_WO


def test_a_fact_that_a_grasp_makes_true_puts_the_object_into_the_tool_with_a_warning(damaged: Damage) -> None:
    workspace = loaded(damaged, state="  - hold(red)")
    told = [warning for warning in workspace.warnings if warning.code == "held-by-the-facts"]
    assert [warning.severity for warning in told] == ["warning"]
    assert told[0].mend == "write `pose: {held: +z}`"
    world = workspace.stated_world
    assert world.held == "red"
    assert world.X_TO is not None
    assert world.X_TO[:3, 3] == pytest.approx([0, 0, 0.02])


def test_without_such_a_fact_nothing_is_held(cell: Path) -> None:
    workspace = load_workspace(cell)
    assert workspace.stated_world.held is None
    assert not [warning for warning in workspace.warnings if warning.code == "held-by-the-facts"]


@pytest.mark.parametrize("facts", ["  - moved(red)", "  - moved(red)\n  - moved(blue)"])
def test_a_fact_of_a_skill_that_lets_go_again_says_nothing_about_the_tool(damaged: Damage, facts: str) -> None:
    released = "- {name: a5, joint_move: home}\n  - {name: a6, release: 1 s}"
    action = {"(hand_empty))\n  (:a": "(hand_empty) (moved ?object - movable))\n  (:a", "(and (hold ?": "(and (moved ?"}
    edits = [
        {"file": "pickup/skill.yaml", "replace": {"- {name: a5, joint_move: home}": released}},
        {"file": "pickup/pickup.pddl", "replace": action},
        {"file": "workspace.yaml", "replace": {"  - on_table(red)": facts}},
    ]
    workspace = load_workspace(damaged({"edits": edits}))
    assert workspace.stated_world.held is None
    assert workspace.objects["red"].X_WO is not None
    codes = [problem.code for problem in (*workspace.warnings, *lint(workspace))]
    assert not {"held-by-the-facts", "held-against-the-facts"} & set(codes)
