"""A task that needs others first, planned as one of several steps."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.conditions import failing_literals
from sqrp_cli.logic.domain import merge_domains
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import Plan, find_plan
from sqrp_cli.logic.planning_task import PlanStep
from sqrp_cli.programming.candidate import THEN, Candidate, Task
from sqrp_cli.programming.task import read_task

MOST_PLANNED = 20
"""Most choices of objects for which a plan is sought; the shortest plan counts."""


def with_first_steps(task: Task, workspace: Workspace, facts: frozenset[Atom] | None = None) -> Task:
    """The task, with what has to be done first if the preconditions of none of its candidates hold.

    What that is is found as `check` does. The task stays as it is where nothing is needed or nothing helps. facts: that
    hold before it, by default those of the workspace.
    """
    facts = workspace.state if facts is None else facts
    if task.candidates[0].steps or any(not _lacks(one, workspace, facts) for one in task.candidates):
        return task
    plans = sorted(_plans(task, workspace, facts), key=lambda found: len(found[0]))
    if not plans:
        return task
    steps, last = plans[0]
    settings = [word for word in task.text.split()[1:] if "=" in word]
    names = [f"{name}={value}" for name, value in last.binding.items()]
    kept = [word for word in settings if word.split("=", 1)[0] not in last.binding]
    return read_task(THEN.join([*steps, " ".join([last.skill.name, *names, *kept])]), workspace, facts)


def _lacks(candidate: Candidate, workspace: Workspace, facts: frozenset[Atom]) -> bool:
    objects = {name: frozenset(obj.types) for name, obj in workspace.objects.items()}
    action = candidate.skill.action
    return bool(failing_literals(action, candidate.binding, facts, objects, candidate.skill.domain))


def _plans(task: Task, workspace: Workspace, facts: frozenset[Atom]) -> Iterator[tuple[list[str], Candidate]]:
    """Plans for the different choices of objects: the tasks to do first, and the candidate."""
    domain = merge_domains([skill.domain for skill in workspace.skills.values()])
    objects = {name: frozenset(obj.types) for name, obj in workspace.objects.items()}
    different = {tuple(one.binding.values()): one for one in reversed(task.candidates)}
    for candidate in list(reversed(different.values()))[:MOST_PLANNED]:
        goal = candidate.skill.action.precondition
        found = find_plan(domain, objects, facts, goal, candidate.binding)
        if isinstance(found, Plan):
            yield [_text(step, workspace) for step in found.steps], candidate


def _text(step: PlanStep, workspace: Workspace) -> str:
    skill = next(skill for skill in workspace.skills.values() if skill.action.name == step.action)
    bound = zip((parameter.name for parameter in skill.action.parameters), step.arguments, strict=True)
    return " ".join([skill.name, *(f"{name}={value}" for name, value in bound)])
