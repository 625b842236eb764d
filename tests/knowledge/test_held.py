"""What the tool holds at the beginning: stated as a pose, or told from the facts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
    world = loaded(damaged, pose=pose, state="  - hold(red)").initial_world
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
    world = workspace.initial_world
    assert world.held == "red"
    assert world.X_TO is not None
    assert world.X_TO[:3, 3] == pytest.approx([0, 0, 0.02])


def test_without_such_a_fact_nothing_is_held(cell: Path) -> None:
    workspace = load_workspace(cell)
    assert workspace.initial_world.held is None
    assert not [warning for warning in workspace.warnings if warning.code == "held-by-the-facts"]
