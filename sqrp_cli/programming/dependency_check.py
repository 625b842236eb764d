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

    reasons: why not, most useful first. time: of its motion [s], None if infeasible. ways_around: what goes around
    what, such as `a1 goes around wall`, where the direct move is blocked. suggestion: how to establish its
    precondition.
    """

    candidate: Candidate
    feasible: bool
    reasons: tuple[str, ...]
    time: float | None
    suggestion: Suggestion
    ways_around: tuple[str, ...] = ()


def check_candidate(cell: Cell, candidate: Candidate, world: World) -> Feasibility:
    """Check one candidate in a world: its precondition, and whether the robot can move as the skill asks."""
    suggestion = suggest(cell, candidate, world)
    motion = feasible_motion(cell, candidate, world)
    if isinstance(motion, Infeasible):
        return Feasibility(candidate, feasible=False, reasons=motion.reasons, time=None, suggestion=suggestion)
    return Feasibility(candidate, True, (), motion.time, suggestion, motion.ways_around)
