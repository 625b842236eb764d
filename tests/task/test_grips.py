from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.grips import first_grip, grips
from sqrp_cli.task.task import read_task


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


def choices(cell: Cell, task: str, world: World | None = None) -> dict[str, list[object]]:
    """What the grips of a task's first candidate choose, angles in degrees."""
    candidate = read_task(task, cell.workspace).candidates[0]
    found: dict[str, list[object]] = {}
    for grip in grips(cell, candidate, world or cell.initial_world):
        for name, value in grip.values.items():
            if candidate.values[name] != value:
                found.setdefault(name, []).append(value if isinstance(value, str) else round(np.degrees(value)))
    return found


def test_a_round_cup_turns_at_home_and_does_not_stop_there(cell: Cell) -> None:
    assert choices(cell, "pickup g1") == {"approach_yaw": [0, 90, 180, -90], "via": ["direct"] * 4}


def test_elsewhere_a_stop_at_home_is_a_choice(cell: Cell) -> None:
    world = cell.initial_world
    away = replace(world, joints={name: q + 0.1 for name, q in world.joints.items()})
    assert choices(cell, "pickup g1", away)["via"] == ["direct", "home"] * 4


def test_what_a_task_states_is_no_choice(cell: Cell) -> None:
    assert choices(cell, "pickup g1 approach_yaw=45deg via=home") == {}


def test_what_is_put_down_turns_by_its_own_symmetry(cell: Cell) -> None:
    assert choices(cell, "place g1 crate via=direct")["yaw"] == [0, 90, 180, -90]


def test_the_first_grip_is_the_first_choice_of_each(cell: Cell) -> None:
    candidate = read_task("pickup g1", cell.workspace).candidates[0]
    first = first_grip(candidate).values
    assert (first["approach_yaw"], first["via"], first["elbow"]) == (0.0, "direct", "any")
    assert grips(cell, candidate, cell.initial_world)[0].values == first
