"""The object in the tool at the beginning, found from the facts of a workspace."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, cast

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.scene import BoxSide, Held, SceneObject
from sqrp_cli.knowledge.skill.settings import Reference, Setting, number_of, side_of
from sqrp_cli.knowledge.skill.skill import Grasp, GraspWaypoint, Release, Skill
from sqrp_cli.knowledge.skill.target_box import BoxSpec
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.logic.domain import Holds, Variable
from sqrp_cli.logic.literal import Atom

_Facts = Mapping[Atom, int]
"""The facts of a state, each with its place in the list."""


@dataclass(frozen=True, eq=False)
class _Grip:
    """How a skill holds an object, and the object's pose X_TO in the tool frame, shape (4, 4)."""

    fact: Atom
    skill: Skill
    held: Held
    X_TO: Array

    @property
    def side(self) -> str:
        """The side by which it is held."""
        return self.held.held


def holding_skills(skills: Iterable[Skill], objects: Collection[str]) -> dict[str, tuple[Skill, ...]]:
    """The predicates that mean that the tool holds an object, such as `hold`, each with the skills that make it true.

    Such a predicate is an effect of a skill on the object that it ends with in the tool, and its target has a box in
    the tool; one with boxes elsewhere, such as that the object has left the table, does not count. A single effect
    without a target counts if there is no other. Skills are ordered by name.
    """
    found: dict[str, tuple[Skill, ...]] = {}
    for skill in sorted(skills, key=lambda skill: skill.name):
        for predicate in _holding(skill, objects):
            found[predicate] = (*found.get(predicate, ()), skill)
    return found


class ObjectsAtStart(NamedTuple):
    """The objects, with what the facts say of the one in the tool."""

    objects: dict[str, SceneObject]
    warnings: tuple[Problem, ...]


def with_held_by_facts(
    objects: Mapping[str, SceneObject], facts: _Facts, skills: Collection[Skill], document: SourceDocument
) -> ObjectsAtStart:
    """The objects, with the held one placed in the tool by the facts; and a warning if its entry does not state that.

    It is held as the skills that make the fact true would grasp it, with default parameters. Raises InputError, with
    the place, for facts that contradict it, and if skills would hold it differently.
    """
    holding = holding_skills(skills, objects)
    contradictions = tuple(_contradictions(facts, holding, skills, document))
    if contradictions:
        raise InputError(*contradictions)
    stated = sorted((fact for fact in facts if fact.predicate in holding), key=str)
    names = {fact.arguments[0] for fact in stated}
    if len(names) != 1 or any(obj.X_TO is not None for obj in objects.values()):
        return ObjectsAtStart(dict(objects), ())
    (name,) = names
    grips = [grip for fact in stated for grip in _grips(fact, holding[fact.predicate], objects[name])]
    if not grips:
        return ObjectsAtStart(dict(objects), ())
    first = grips[0]
    for other in grips[1:]:
        if not np.allclose(first.X_TO, other.X_TO, rtol=0.0, atol=1e-9):
            raise InputError(_ambiguous(name, first, other, document))
    message = (
        f"the state has `{first.fact}`, so `{name}` begins in the tool,"
        f" held by its side {first.side} as `{first.skill.name}` does it"
    )
    mend = f"write `pose: {{held: {first.side}}}`"
    warning = document.problem("held-by-the-facts", ("objects", name, "pose"), message, mend)
    found = {**objects, name: replace(objects[name], pose=first.held)}
    return ObjectsAtStart(found, (replace(warning, severity="warning"),))


def _holding(skill: Skill, objects: Collection[str]) -> tuple[str, ...]:
    held = _held_at_the_end(skill)
    if held is None:
        return ()
    added = [change.predicate for change in skill.action.effect.adds if change.terms == (Variable(held),)]
    elsewhere = {WORLD, *objects, *(parameter.name for parameter in skill.action.parameters)}

    def in_the_tool(box: BoxSpec) -> bool:
        about = box.fits == held or held in (box.encloses or ())
        return about and not box.frame.at_start and box.frame not in elsewhere

    seen = tuple(p for p in added if p in skill.targets and any(map(in_the_tool, skill.targets[p].boxes)))
    unseen = tuple(p for p in added if p not in skill.targets)
    return seen or (unseen if len(unseen) == 1 else ())


def _held_at_the_end(skill: Skill) -> str | None:
    """The parameter of the object that a skill holds at its end, or None."""
    held = None
    for primitive in skill.primitives:
        if isinstance(primitive, Grasp):
            held = primitive.object
        elif isinstance(primitive, Release):
            held = None
    return held


def _contradictions(
    facts: _Facts, holding: Mapping[str, tuple[Skill, ...]], skills: Collection[Skill], document: SourceDocument
) -> Iterator[Problem]:
    """Facts that no sequence of skills can make true together with the fact that an object is held."""
    for fact in facts:
        for skill in holding.get(fact.predicate, ())[:1]:
            for lost in skill.action.effect.deletes:
                if not _exclude_each_other(fact.predicate, lost.predicate, skills):
                    continue
                for other in facts:
                    if _matches(lost, other, _held_at_the_end(skill), fact.arguments[0]):
                        message = (
                            f"the state has `{other}` and `{fact}`, but `{skill.name}`, which makes `{fact}` true,"
                            f" makes `{other}` false"
                        )
                        yield document.problem(
                            "contradictory-facts",
                            ("state", facts[other]),
                            message,
                            f"remove `{fact}` or `{other}` from the state",
                        )


def _exclude_each_other(one: str, other: str, skills: Iterable[Skill]) -> bool:
    """Whether every skill that makes one of the two predicates true makes the other false."""

    def excludes(skill: Skill, this: str, that: str) -> bool:
        adds, deletes = skill.action.effect.adds, skill.action.effect.deletes
        return all(use.predicate != this for use in adds) or any(use.predicate == that for use in deletes)

    return all(excludes(skill, one, other) and excludes(skill, other, one) for skill in skills)


def _matches(use: Holds, fact: Atom, parameter: str | None, name: str) -> bool:
    """Whether a use of a predicate matches a fact if `parameter` is bound to the object `name`."""
    return use.predicate == fact.predicate and all(
        argument == name if term == Variable(parameter or "") else isinstance(term, Variable) or argument == term.name
        for term, argument in zip(use.terms, fact.arguments, strict=True)
    )


def _grips(fact: Atom, skills: Iterable[Skill], obj: SceneObject) -> Iterator[_Grip]:
    for skill in skills:
        held = _held_at_the_end(skill)
        grasp = next((w for w in skill.waypoints.values() if isinstance(w, GraspWaypoint) and w.object == held), None)
        if grasp is not None:
            how = _grasped(skill, grasp)
            yield _Grip(fact, skill, how, how.X_TO(obj.size))


def _ambiguous(name: str, one: _Grip, other: _Grip, document: SourceDocument) -> Problem:
    facts = " and ".join(f"`{fact}`" for fact in dict.fromkeys((one.fact, other.fact)))
    message = (
        f"the state has {facts}, so `{name}` begins in the tool, but `{one.skill.name}` holds it by its side {one.side}"
        f" and `{other.skill.name}` in another way, by its side {other.side}"
    )
    mend = f"say how it is held: `pose: {{held: {one.side}}}`, with `yaw` and `depth` as needed"
    return document.problem("ambiguous-hold", ("objects", name, "pose"), message, mend)


def _grasped(skill: Skill, grasp: GraspWaypoint) -> Held:
    def value(setting: Setting) -> float | str:
        return skill.defaults[setting.parameter] if isinstance(setting, Reference) else setting

    side = cast("BoxSide", side_of(value(grasp.side)))
    return Held(held=side, yaw=number_of(value(grasp.yaw)), depth=number_of(value(grasp.depth)))
