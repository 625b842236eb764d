"""Tasks of several steps: which choices for the steps go together, each a candidate of the whole task."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.conditions import apply_effect, failing_literals
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.candidate import THEN, Candidate, Task

_BETWEEN = re.compile(r"(?:^|(?<=\s))then(?=\s|$)")

MOST_WHOLE = 1000
"""Most candidates of a task of several steps."""


def split_steps(text: str) -> list[str]:
    """The texts of the steps of a task: those between the words `then`. Raises InputError where nothing is there."""
    parts = [part.strip() for part in _BETWEEN.split(text)]
    if len(parts) > 1 and not all(parts):
        index = parts.index("")
        where = "stands before the first `then`" if index == 0 else f"follows `then` number {index}"
        where = "follows `then`" if len(parts) == 2 and index else where
        mend = "leave this `then` out, or name a step there: `pickup peg1 then insert peg1 socket`"
        raise InputError(Problem("empty-task", f"nothing {where} in `{text.strip()}`", mend=mend))
    return parts


def whole_task(text: str, steps: Sequence[Task], workspace: Workspace, facts: frozenset[Atom] | None) -> Task:
    """A task of several steps: a candidate for every choice in each step whose preconditions hold one after the other.

    If there is none, every combination is a candidate, so that each says what it lacks. Raises InputError for too many.
    """
    facts = workspace.state if facts is None else facts
    skill = whole_skill([step.skill for step in steps])
    found = [whole_candidate(skill, chosen) for chosen in _limited(_possible(steps, workspace, facts))]
    if not found:
        first = next(_possible(steps, workspace, None))
        found = [whole_candidate(skill, first)]
    return Task(text, skill, tuple(found))


def whole_candidate(skill: Skill, steps: Sequence[Candidate]) -> Candidate:
    """One choice for all steps as a candidate, whose parameters say which step they belong to: `2.peg`."""
    numbered = list(enumerate(steps, 1))
    return Candidate(
        skill=skill,
        binding={f"{n}.{key}": value for n, step in numbered for key, value in step.binding.items()},
        values={f"{n}.{key}": value for n, step in numbered for key, value in step.values.items()},
        name=THEN.join(f"{step.skill.name} {step.name}" for step in steps),
        vias={f"{n}.{key}": value for n, step in numbered for key, value in step.vias.items()},
        branch={f"{n}.{key}": value for n, step in numbered for key, value in step.branch.items()},
        steps=tuple(steps),
    )


def whole_skill(skills: Sequence[Skill]) -> Skill:
    """What the skills of the steps are together: their parameters and faults, with the numbers of the steps."""
    numbered = list(enumerate(skills, 1))
    return replace(
        skills[-1],
        name=THEN.join(skill.name for skill in skills),
        motion_parameters=tuple(
            replace(one, name=f"{n}.{one.name}") for n, skill in numbered for one in skill.motion_parameters
        ),
        waypoints={},
        primitives=(),
        requirements=tuple(
            replace(one, name=f"{n}.{one.name}") for n, skill in numbered for one in skill.requirements if one.name
        ),
        targets={},
    )


def _possible(
    steps: Sequence[Task], workspace: Workspace, facts: frozenset[Atom] | None
) -> Iterator[tuple[Candidate, ...]]:
    """The choices for steps that can follow each other by their preconditions and effects; all without facts."""
    if not steps:
        yield ()
        return
    objects = {name: frozenset(obj.types) for name, obj in workspace.objects.items()}
    for candidate in steps[0].candidates:
        skill, after = candidate.skill, facts
        if facts is not None:
            if failing_literals(skill.action, candidate.binding, facts, objects, skill.domain):
                continue
            after = apply_effect(skill.action, candidate.binding, facts)
        for others in _possible(steps[1:], workspace, after):
            yield (candidate, *others)


def _limited(choices: Iterator[tuple[Candidate, ...]]) -> Iterator[tuple[Candidate, ...]]:
    for number, chosen in enumerate(choices):
        if number >= MOST_WHOLE:
            message = f"the task has more than {MOST_WHOLE:,} candidates, as its steps go together in so many ways"
            mend = "name fewer objects or values in its steps"
            raise InputError(Problem("too-many-candidates", message, mend=mend))
        yield chosen
