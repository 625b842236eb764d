"""The paper's real-world set-up, computed by the real pipeline: two screws and a gripper with two fingers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study.sampling import FixedStep
from sqrp_cli.task.task import read_task
from tests.reproduction.summary import Summary, feasible_study, hidden_by_the_robot

WORKSPACE = Path("workspaces/screws")
TASK = "pickup_two_finger screw"
EVERY_SECOND = FixedStep(1.0)


@dataclass(frozen=True, eq=False)
class Screws:
    """What came out, with a sample every second.

    of: the candidates, by their object. hide_red2: cameras from which the robot hides red2 during all of the lift.
    """

    of: Mapping[str, Summary]
    hide_red2: frozenset[str]


def screws_cell() -> Cell:
    """The cell as it is shipped."""
    return Cell.load(load_workspace(WORKSPACE))


def pick_screws(cell: Cell) -> Screws:
    """Both candidates."""
    candidates = {candidate.name: candidate for candidate in read_task(TASK, cell.workspace).candidates}
    return Screws(
        {name: Summary.of(feasible_study(cell, candidate, EVERY_SECOND)) for name, candidate in candidates.items()},
        hidden_by_the_robot(cell, feasible_study(cell, candidates["red2"], EVERY_SECOND, full=True), "obj_on_table"),
    )
