"""Whether a candidate can be done at all: its precondition, and the motion of the robot."""

from __future__ import annotations

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.conditions import failing_literals
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.motion.ground_primitives import SkillUse
from sqrp_cli.programming.motion.plan_motion import Motion, plan_motion
from sqrp_cli.programming.task import Candidate


def feasible_motion(cell: Cell, candidate: Candidate, world: World) -> Motion | Infeasible:
    """The motion of a candidate whose precondition holds in a world."""
    unmet = unmet_preconditions(cell, candidate, world)
    if unmet:
        return Infeasible(unmet)
    lost = [name for name in candidate.objects.values() if name not in world.X_WO]
    if lost:
        return Infeasible(tuple(f"it is not known where `{name}` is" for name in lost))
    contact = cell.collision.contact_in(world)
    if contact is not None:
        return Infeasible((f"{contact} before anything moves",))
    use = SkillUse(candidate.skill, candidate.objects, candidate.motion, cell.workspace.objects, world)
    return plan_motion(use, cell.collision, cell.seed)


def unmet_preconditions(cell: Cell, candidate: Candidate, world: World) -> tuple[str, ...]:
    """Sentences about what of the candidate's precondition does not hold in a world; empty if it holds."""
    objects = {name: frozenset(thing.types) for name, thing in cell.workspace.objects.items()}
    skill = candidate.skill
    failing = failing_literals(skill.action, candidate.objects, world.facts, objects, skill.domain)
    return tuple(f"`{skill.name}` needs `{literal}`, which does not hold" for literal in failing)
