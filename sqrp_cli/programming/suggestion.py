"""What would have to be done first: a plan that establishes a failing precondition, each step checked and scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sqrp_cli.knowledge.workspace import World
from sqrp_cli.logic.domain import merge_domains
from sqrp_cli.logic.planner import AlreadySatisfied, GaveUp, Plan, ProvenImpossible, find_plan
from sqrp_cli.logic.planning_task import Step
from sqrp_cli.programming.assessment import study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.feasibility import unmet_preconditions
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.program_update import world_after
from sqrp_cli.programming.quality import Qualities
from sqrp_cli.programming.sampling import Adaptive
from sqrp_cli.programming.task import Candidate


@dataclass(frozen=True)
class SuggestedStep:
    """One step of a plan with its motion parameters at their defaults.

    reasons: why it is infeasible. qualities: None if it is.
    """

    action: str
    feasible: bool
    reasons: tuple[str, ...]
    qualities: Qualities | None


@dataclass(frozen=True)
class Suggestion:
    """How planning for a candidate's precondition ended, and the plan if there is one.

    explanation: one sentence; empty if the precondition holds already.
    """

    outcome: Literal["satisfied", "plan", "impossible", "gave_up"]
    steps: tuple[SuggestedStep, ...] | None
    explanation: str


def suggest(cell: Cell, candidate: Candidate, world: World) -> Suggestion:
    """Plan with the skills of the workspace from `world` to the candidate's precondition, and check every step."""
    if not unmet_preconditions(cell, candidate, world):
        return Suggestion("satisfied", None, "")
    workspace, action = cell.workspace, candidate.skill.action
    domain = merge_domains([skill.domain for skill in workspace.skills.values()])
    objects = {name: frozenset(thing.types) for name, thing in workspace.objects.items()}
    match find_plan(domain, objects, world.facts, action.precondition, candidate.objects):
        case AlreadySatisfied():
            return Suggestion("satisfied", None, "")
        case Plan(steps):
            checked = _checked(cell, steps, world)
            listed = ", then ".join(step.action for step in checked)
            return Suggestion("plan", checked, f"first do {listed}")
        case ProvenImpossible(never):
            parts = " and ".join(f"`{part}`" for part in never) or "all of it together"
            return Suggestion("impossible", None, f"no sequence of this workspace's skills can establish {parts}")
        case GaveUp(states):
            return Suggestion("gave_up", None, f"no plan was found among {states:,} states, which proves nothing")


def _checked(cell: Cell, steps: tuple[Step, ...], world: World) -> tuple[SuggestedStep, ...]:
    """Each step in the world that the steps before it leave, as far as they can be done."""
    checked: list[SuggestedStep] = []
    for step in steps:
        if checked and not checked[-1].feasible:
            checked.append(SuggestedStep(str(step), False, ("a step before it cannot be done",), None))
            continue
        result = study(cell, _default_candidate(cell, step), world, Adaptive(), full=False)
        if isinstance(result, Infeasible):
            checked.append(SuggestedStep(str(step), False, result.reasons, None))
            continue
        checked.append(SuggestedStep(str(step), True, (), Qualities.of(result.timeline)))
        world = world_after(result)
    return tuple(checked)


def _default_candidate(cell: Cell, step: Step) -> Candidate:
    skill = next(skill for skill in cell.workspace.skills.values() if skill.action.name == step.action)
    names = (parameter.name for parameter in skill.action.parameters)
    motion = {parameter.name: parameter.values[0] for parameter in skill.motion_parameters}
    return Candidate(skill, dict(zip(names, step.arguments, strict=True)), motion, str(step))
