"""Feasibility in a world: of a candidate, by precondition and motion, and of every skill with every object."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible, InputError
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion, plan_motion
from sqrp_cli.records import dataclass
from sqrp_cli.task.task import Candidate, read_task


def feasible_motion(cell: Cell, candidate: Candidate, world: World) -> Motion | Infeasible:
    """The motion of a candidate whose precondition holds in a world: of what it leaves free, the fastest branch."""
    obstacle = impossible_start(cell, candidate, world)
    return obstacle or plan_motion(candidate, world, cell.collision, cell.seed)


def impossible_start(cell: Cell, candidate: Candidate, world: World, *, contacts: bool = True) -> Infeasible | None:
    """Why a candidate cannot even begin in a world: its precondition, where its objects are, contacts; None if it can.

    contacts: whether anything that touches is looked for.
    """
    if unmet := unmet_preconditions(cell, candidate, world):
        return Infeasible(unmet)
    if lost := [name for name in candidate.binding.values() if name not in world.X_WO]:
        return Infeasible(tuple(f"it is not known where `{name}` is" for name in lost))
    contact = cell.collision.contact_in(world) if contacts else None
    return Infeasible((f"{contact} before anything moves",)) if contact else None


def unmet_preconditions(cell: Cell, candidate: Candidate, world: World) -> tuple[str, ...]:
    """Sentences about the failing parts of the candidate's precondition in a world; empty if it holds."""
    failing = candidate.lacks(cell.workspace, world.facts)
    return tuple(f"`{candidate.skill.name}` needs `{literal}`, which does not hold" for literal in failing)


MOST_WAYS = 4
"""Most candidates of a task that are tried to find a feasible one; ranking tries all."""


@dataclass(frozen=True)
class Possibility:
    """A task for one binding of objects."""

    task: str
    skill: str
    """Its name."""
    time: float | None
    """Duration of its first feasible candidate [s]; None if none was found."""
    allowed: bool
    """Whether its precondition holds."""
    reason: str
    """Why it is infeasible; empty if it is feasible."""


def possibilities(cell: Cell, world: World) -> Iterator[Possibility]:
    """Every skill with every binding to different objects, in the order of the workspace."""
    for skill in cell.workspace.skills:
        ways: dict[tuple[str, ...], list[Candidate]] = {}
        try:
            candidates = read_task(skill, cell.workspace).candidates
        except InputError:  # no object fits a parameter, or there are too many ways to list
            continue
        for candidate in candidates:
            objects = tuple(candidate.binding.values())
            if len(set(objects)) == len(objects):
                ways.setdefault(objects, []).append(candidate)
        for found in ways.values():
            unmet = unmet_preconditions(cell, found[0], world)
            time, reasons = None, list(unmet)
            for way in () if unmet else found[:MOST_WAYS]:
                motion = feasible_motion(cell, way, world)
                if not isinstance(motion, Infeasible):
                    time, reasons = motion.time, [""]
                    break
                reasons += motion.reasons
            task = found[0].task
            yield Possibility(task=task, skill=skill, time=time, allowed=not unmet, reason=reasons[0])
