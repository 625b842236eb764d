"""Candidates: what a person chooses between, and the task that they are of, of one step or several."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import bad_input
from sqrp_cli.geometry import Array
from sqrp_cli.logic.conditions import UnmetPart, apply_effect, failing_literals
from sqrp_cli.logic.literal import Atom
from sqrp_cli.records import dataclass
from sqrp_cli.skill.settings import ANY, DIRECT, SEEN, MotionValue, Reference
from sqrp_cli.skill.skill import JointMove, Skill, SkillChoice

THEN = " then "  # Between the steps of a task of several


@dataclass(frozen=True)
class Candidate(SkillChoice):
    """One binding of all parameters of a skill."""

    name: str = ""
    """Its distinguishing name among the candidates of its task, such as `g1` or `g1 lift=200mm`."""
    steps: tuple[Candidate, ...] = ()
    """Of a task of several steps: what is done in each; the candidate stands for all of them, see `whole_task`."""

    @property
    def parameters(self) -> dict[str, MotionValue]:
        """All parameters with their values, objects first; an implicit one only where it is not at its default."""
        unsaid = {p.name: p.values[0] for p in self.skill.motion_parameters if p.implicit}
        return {name: value for name, value in self.all_parameters.items() if unsaid.get(name) != value}

    @property
    def all_parameters(self) -> dict[str, MotionValue]:
        """The same with every implicit one."""
        return {**self.binding, **self.values, **self.branch}

    @property
    def task(self) -> str:
        """The task text for its skill and objects, such as `place g2 tray`."""
        if self.steps:
            return THEN.join(step.task for step in self.steps)
        return " ".join([self.skill.name, *self.binding.values()])

    def lacks(self, workspace: Workspace, facts: frozenset[Atom]) -> tuple[UnmetPart, ...]:
        """The parts of its precondition that do not hold in a workspace with these facts; empty if it holds."""
        return failing_literals(self.skill.action, self.binding, facts, workspace.types, self.skill.domain)

    @property
    def leaves_free(self) -> bool:
        """Whether there may be several ways of doing it: a motion parameter is free, or a path need not be direct."""
        return ANY in self.values.values() or bool(self.open_paths)

    @property
    def open_paths(self) -> frozenset[str]:
        """Names of the joint moves whose paths neither the candidate nor the skill says are direct."""
        paths = {one.name: one.path for one in self.skill.primitives if isinstance(one, JointMove)}
        stated = {p: self.values.get(p.parameter, DIRECT) for p in paths.values() if isinstance(p, Reference)}
        return frozenset(
            name for name, path in paths.items() if (stated[path] if isinstance(path, Reference) else path) != DIRECT
        )

    def with_paths(self, vias: Mapping[str, Array]) -> Candidate:
        """The way in which joint moves with open paths bend around vias, by the name of the move, if they have any.

        An open path becomes `seen` or `direct`; where moves share the parameter, the vias of any decide.
        """
        paths, still_open = dict[str, MotionValue](), self.open_paths
        for move in (one for one in self.skill.primitives if isinstance(one, JointMove) and one.name in still_open):
            if isinstance(move.path, Reference):
                paths[move.path.parameter] = SEEN if move.name in vias else paths.get(move.path.parameter, DIRECT)
        return replace(self, values={**self.values, **paths}, vias=vias)


@dataclass(frozen=True)
class Task:
    """A task with its candidates."""

    text: str  # As it was given
    skill: Skill
    candidates: tuple[Candidate, ...]


_BETWEEN = re.compile(r"(?:^|(?<=\s))then(?=\s|$)")
MOST_WHOLE = 1000  # Most candidates of a task of several steps


def split_steps(text: str) -> list[str]:
    """The texts of the steps of a task: those between the words `then`. Raises InputError where nothing is there."""
    parts = [part.strip() for part in _BETWEEN.split(text)]
    if len(parts) > 1 and not all(parts):
        index = parts.index("")
        where = f"follows `then` number {index}" if len(parts) > 2 else "follows `then`"
        where = where if index else "stands before the first `then`"
        mend = "leave this `then` out, or name a step there: `pickup peg1 then insert peg1 socket`"
        raise bad_input("empty-task", f"nothing {where} in `{text.strip()}`", mend=mend)
    return parts


def whole_task(text: str, steps: Sequence[Task], workspace: Workspace, facts: frozenset[Atom] | None) -> Task:
    """A task of several steps: a candidate for every choice in each step whose preconditions hold one after the other.

    If there is none, the first choice in each step is the candidate, so that it says what it lacks. Raises InputError
    for too many.
    """
    skill, known = whole_skill([step.skill for step in steps]), workspace.state if facts is None else facts
    found = list(islice(_possible(steps, workspace, known), MOST_WHOLE + 1))
    found = found or [tuple(step.candidates[0] for step in steps)]
    if len(found) > MOST_WHOLE:
        message = f"the task has more than {MOST_WHOLE:,} candidates, as its steps go together in so many ways"
        raise bad_input("too-many-candidates", message, mend="name fewer objects or values in its steps")
    return Task(text, skill, tuple(whole_candidate(skill, chosen) for chosen in found))


def whole_candidate(skill: Skill, steps: Sequence[Candidate]) -> Candidate:
    """One choice for all steps as a candidate, whose parameters say which step they belong to: `2.peg`."""
    own: dict[str, dict[str, Any]] = {
        field: {f"{n}.{key}": value for n, step in enumerate(steps, 1) for key, value in getattr(step, field).items()}
        for field in ("binding", "values", "vias", "branch")
    }
    name = THEN.join(f"{step.skill.name} {step.name}" for step in steps)
    return Candidate(skill=skill, name=name, steps=tuple(steps), **own)


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


def _possible(steps: Sequence[Task], workspace: Workspace, facts: frozenset[Atom]) -> Iterator[tuple[Candidate, ...]]:
    """The choices for steps that can follow each other by their preconditions and effects."""
    if not steps:
        yield ()
        return
    for candidate in (one for one in steps[0].candidates if not one.lacks(workspace, facts)):
        after = apply_effect(candidate.skill.action, candidate.binding, facts)
        for others in _possible(steps[1:], workspace, after):
            yield (candidate, *others)
