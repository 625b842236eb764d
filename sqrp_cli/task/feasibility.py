"""Feasibility in a world: of a candidate, by precondition and motion, and of every skill with every object."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import Infeasible, InputError
from sqrp_cli.logic.conditions import UnmetPart
from sqrp_cli.logic.literal import Literal
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion, plan_motion
from sqrp_cli.task.task import Candidate, read_task


def feasible_motion(cell: Cell, candidate: Candidate, world: World) -> Motion | Infeasible:
    """The motion of a candidate whose precondition holds in a world: of what it leaves free, the fastest branch."""
    obstacle = impossible_start(cell, candidate, world)
    return obstacle or plan_motion(candidate, world, cell.collision, cell.seed)


def impossible_start(cell: Cell, candidate: Candidate, world: World, *, contacts: bool = True) -> Infeasible | None:
    """Why a candidate cannot even begin in a world: its precondition, where its objects are, contacts; None if it can.

    contacts: whether anything that touches is looked for. A recorded motion is what it is.
    """
    if candidate.skill.recorded is not None:
        return None
    if unmet := unmet_preconditions(cell, candidate, world):
        return Infeasible(unmet)
    if lost := [name for name in candidate.binding.values() if name not in world.X_WO]:
        return Infeasible(tuple(f"it is not known where `{name}` is" for name in lost))
    contact = cell.collision.contact_in(world) if contacts else None
    return Infeasible((f"{contact} before anything moves",)) if contact else None


def unmet_preconditions(cell: Cell, candidate: Candidate, world: World) -> tuple[str, ...]:
    """Sentences about the failing parts of the candidate's precondition in a world; empty if it holds."""
    needs = f"`{candidate.skill.name}` needs"
    failing = candidate.lacks(cell.workspace, world.facts)
    return tuple(f"{needs} `{part}`{_remedy(cell.workspace, world, part)}" for part in failing)


def _remedy(workspace: Workspace, world: World, lacking: UnmetPart) -> str:
    """What to write for a fact that the workspace does not tell at its beginning, unless its cell says it is false."""
    false, skills = ", which does not hold", workspace.skills.values()
    if not isinstance(lacking, Literal) or not lacking.positive or world.facts != workspace.state:
        return false
    predicate, names = lacking.atom.predicate, lacking.atom.arguments
    meaning = next((skill.initially[predicate] for skill in skills if predicate in skill.initially), None)
    if meaning in ("stands on a fixture", "stands on the other"):
        fixed = next((item.name for item in workspace.objects.values() if item.fixed), "table")
        item = workspace.objects[names[0]]
        stands = item.on or item.X_TO is not None
        return false if stands else f": add `{lacking}` under `state:`, or `on: {[*names, fixed][1]}` to `{names[0]}`"
    done = meaning or any(added.predicate == predicate for skill in skills for added in skill.action.adds)
    return false if done else f": add `{lacking}` under `state:`"


MOST_WAYS = 4  # Most candidates of a task that are tried to find a feasible one; ranking tries all


def possibilities(cell: Cell, world: World) -> Iterator[tuple[Candidate, bool, Motion | Infeasible]]:
    """Every skill with every binding to different objects, in the order of the workspace: the first candidate of each.

    With whether its precondition holds; and the motion of the first candidate that can be done, or why the very first
    cannot.
    """
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
            unmet = found[0].lacks(cell.workspace, world.facts)
            first = motion = feasible_motion(cell, found[0], world)
            for way in () if unmet else found[1:MOST_WAYS]:
                if not isinstance(motion, Infeasible):
                    break
                motion = feasible_motion(cell, way, world)
            yield found[0], not unmet, first if isinstance(motion, Infeasible) else motion
