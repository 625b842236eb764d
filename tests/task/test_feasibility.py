from __future__ import annotations

import dataclasses

import pytest

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.feasibility import feasible_motion, unmet_preconditions
from sqrp_cli.task.task import Candidate, read_task


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


@pytest.fixture(scope="module")
def candidate(cell: Cell) -> Candidate:
    return read_task("pickup g2", cell.workspace).candidates[0]


@pytest.fixture
def world(cell: Cell) -> World:
    return cell.initial_world


def reasons(cell: Cell, candidate: Candidate, world: World) -> tuple[str, ...]:
    result = feasible_motion(cell, candidate, world)
    assert isinstance(result, Infeasible)
    return result.reasons


def test_every_unmet_literal_of_the_precondition_is_named(cell: Cell, candidate: Candidate, world: World) -> None:
    nothing = dataclasses.replace(world, facts=frozenset())
    assert unmet_preconditions(cell, candidate, nothing) == (
        "`pickup` needs `obj_on_table(g2)`, which does not hold",
        "`pickup` needs `hand_empty`, which does not hold",
    )
    assert reasons(cell, candidate, nothing) == unmet_preconditions(cell, candidate, nothing)


def test_an_object_of_unknown_pose_is_infeasible(cell: Cell, candidate: Candidate, world: World) -> None:
    elsewhere = {name: X for name, X in world.X_WO.items() if name != "g2"}
    lost = dataclasses.replace(world, X_WO=elsewhere)
    assert reasons(cell, candidate, lost) == ("it is not known where `g2` is",)


def test_an_arm_that_touches_something_to_begin_with_is_infeasible(
    cell: Cell, candidate: Candidate, world: World
) -> None:
    crate_at_tool = {**world.X_WO, "crate": cell.model.tool_pose(cell.model.home)}
    (reason,) = reasons(cell, candidate, dataclasses.replace(world, X_WO=crate_at_tool))
    assert "hits crate before anything moves" in reason
