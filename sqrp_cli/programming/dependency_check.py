"""The dependency check: whether a candidate can be done, and if not why, and what would have to be done first."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.suggestion import Suggestion, suggest
from sqrp_cli.programming.task import Candidate


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Whether a candidate can be done.

    reasons: why not, most useful first. time: of its motion [s], None if infeasible. suggestion: how to establish its
    precondition.
    """

    candidate: Candidate
    feasible: bool
    reasons: tuple[str, ...]
    time: float | None
    suggestion: Suggestion


def check_candidate(cell: Cell, candidate: Candidate, world: World) -> Feasibility:
    """Check one candidate in a world: its precondition, and whether the robot can move as the skill asks."""
    suggestion = suggest(cell, candidate, world)
    motion = feasible_motion(cell, candidate, world)
    if isinstance(motion, Infeasible):
        return Feasibility(candidate, feasible=False, reasons=motion.reasons, time=None, suggestion=suggestion)
    return Feasibility(candidate, feasible=True, reasons=(), time=motion.time, suggestion=suggestion)
