"""What can be done in a world at all: every skill with every choice of objects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import feasible_motion, unmet_preconditions
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.suggestion import short_text
from sqrp_cli.programming.task import Candidate, read_task

MOST_WAYS = 4
"""Ways of a task that are tried to find one that can be done; ranking it tries all."""


@dataclass(frozen=True)
class Possibility:
    """A task for one binding of objects.

    skill: its name. time: of the first of its ways that can be done [s], None if none was found. allowed: whether its
    precondition holds. reason: why it cannot be done, empty if it can.
    """

    task: str
    skill: str
    time: float | None
    allowed: bool
    reason: str


def possibilities(cell: Cell, world: World) -> Iterator[Possibility]:
    """Every skill with every binding to different objects, in the order of the workspace."""
    for skill in cell.workspace.skills:
        ways: dict[tuple[str, ...], list[Candidate]] = {}
        try:
            candidates = read_task(skill, cell.workspace).candidates
        except InputError:  # no object fits a parameter, or there are too many ways to list
            continue
        for candidate in candidates:
            objects = tuple(candidate.objects.values())
            if len(set(objects)) == len(objects):
                ways.setdefault(objects, []).append(candidate)
        for found in ways.values():
            yield _possibility(cell, found, world)


def _possibility(cell: Cell, ways: list[Candidate], world: World) -> Possibility:
    task, skill = short_text(ways[0]), ways[0].skill.name
    if unmet := unmet_preconditions(cell, ways[0], world):
        return Possibility(task, skill, None, allowed=False, reason=unmet[0])
    reason = ""
    for candidate in ways[:MOST_WAYS]:
        motion = feasible_motion(cell, candidate, world)
        if not isinstance(motion, Infeasible):
            return Possibility(task, skill, motion.time, allowed=True, reason="")
        reason = reason or motion.reasons[0]
    return Possibility(task, skill, None, allowed=True, reason=reason)
