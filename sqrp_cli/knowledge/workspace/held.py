"""The object in the tool at the beginning, found from the facts of a workspace."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.scene import BoxSide, Held, SceneObject
from sqrp_cli.knowledge.skill.settings import Reference, number_of, side_of
from sqrp_cli.knowledge.skill.skill import Grasp, GraspWaypoint, Release, Skill
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.logic.domain import Variable
from sqrp_cli.logic.literal import Atom


def holding_skills(skills: Iterable[Skill], objects: Collection[str]) -> dict[str, tuple[Skill, ...]]:
    """The predicates that mean that the tool holds an object, such as `hold`, each with the skills that make it true.

    Such a predicate is an effect of a skill on the object that it ends with in the tool, and its target has a box in
    the tool; one with boxes elsewhere, such as that the object has left the table, does not count. A single effect
    without a target counts if there is no other. Skills are ordered by name.
    """
    found: dict[str, tuple[Skill, ...]] = {}
    for skill in sorted(skills, key=lambda skill: skill.name):
        if (held := _held_at_the_end(skill)) is None:
            continue
        added = [change.predicate for change in skill.action.effect.adds if change.terms == (Variable(held),)]
        elsewhere = {WORLD, *objects, *(parameter.name for parameter in skill.action.parameters)}
        seen = [
            predicate
            for predicate in added
            for box in (skill.targets[predicate].boxes if predicate in skill.targets else ())
            if (box.fits == held or held in (box.encloses or ())) and not box.frame.at_start
            if box.frame not in elsewhere
        ]
        unseen = [predicate for predicate in added if predicate not in skill.targets]
        for predicate in dict.fromkeys(seen or (unseen if len(unseen) == 1 else ())):
            found[predicate] = (*found.get(predicate, ()), skill)
    return found


def _held_at_the_end(skill: Skill) -> str | None:
    """The parameter of the object that a skill holds at its end, or None."""
    held = None
    for primitive in skill.primitives:
        if isinstance(primitive, Grasp | Release):
            held = primitive.object if isinstance(primitive, Grasp) else None
    return held


class ObjectsAtStart(NamedTuple):
    """The objects, with what the facts say of the one in the tool."""

    objects: dict[str, SceneObject]
    warnings: tuple[Problem, ...]


class _Grip(NamedTuple):
    """How a skill, which makes a fact true, holds an object, and the object's pose in the tool frame, (4, 4)."""

    fact: Atom
    skill: Skill
    held: Held
    X_TO: Array


def with_held_by_facts(
    objects: Mapping[str, SceneObject], facts: Mapping[Atom, int], skills: Collection[Skill], document: SourceDocument
) -> ObjectsAtStart:
    """The objects, with the held one placed in the tool by the facts; and a warning if its entry does not state that.

    facts: each with its place in the list. It is held as the skills that make the fact true would grasp it, with
    default parameters. Raises InputError, with the place, for facts that contradict it, and if skills would hold it
    differently.
    """
    holding = holding_skills(skills, objects)
    if contradictions := tuple(_contradictions(facts, holding, skills, document)):
        raise InputError(*contradictions)
    stated = sorted((fact for fact in facts if fact.predicate in holding), key=str)
    names = {fact.arguments[0] for fact in stated}
    if len(names) != 1 or any(obj.X_TO is not None for obj in objects.values()):
        return ObjectsAtStart(dict(objects), ())
    (name,) = names
    grips = []
    for use in [(fact, skill) for fact in stated for skill in holding[fact.predicate]]:
        skill = use[1]
        of_it = (w for w in skill.waypoints.values() if isinstance(w, GraspWaypoint))
        grasp = next((waypoint for waypoint in of_it if waypoint.object == _held_at_the_end(skill)), None)
        if grasp is not None:
            settings = (grasp.side, grasp.yaw, grasp.depth)
            side, yaw, depth = (
                skill.defaults[one.parameter] if isinstance(one, Reference) else one for one in settings
            )
            how = Held(held=cast("BoxSide", side_of(side)), yaw=number_of(yaw), depth=number_of(depth))
            grips.append(_Grip(*use, how, how.X_TO(objects[name].size)))
    if not grips:
        return ObjectsAtStart(dict(objects), ())
    path, first = ("objects", name, "pose"), grips[0]
    side = first.held.held
    for other in grips[1:]:
        if not np.allclose(first.X_TO, other.X_TO, rtol=0.0, atol=1e-9):
            both = " and ".join(f"`{fact}`" for fact in dict.fromkeys((first.fact, other.fact)))
            message = (
                f"the state has {both}, so `{name}` begins in the tool, but `{first.skill.name}` holds it by its side"
                f" {side} and `{other.skill.name}` in another way, by its side {other.held.held}"
            )
            mend = f"say how it is held: `pose: {{held: {side}}}`, with `yaw` and `depth` as needed"
            raise document.error("ambiguous-hold", path, message, mend)
    message = (
        f"the state has `{first.fact}`, so `{name}` begins in the tool,"
        f" held by its side {side} as `{first.skill.name}` does it"
    )
    warning = document.problem("held-by-the-facts", path, message, f"write `pose: {{held: {side}}}`")
    found = {**objects, name: replace(objects[name], pose=first.held)}
    return ObjectsAtStart(found, (replace(warning, severity="warning"),))


def _contradictions(
    facts: Mapping[Atom, int],
    holding: Mapping[str, tuple[Skill, ...]],
    skills: Collection[Skill],
    document: SourceDocument,
) -> Iterator[Problem]:
    """Facts that no sequence of skills can make true together with the fact that an object is held."""

    def excludes(one: str, other: str) -> bool:
        """Whether every skill that makes one of the two predicates true makes the other false."""
        for skill in skills:
            adds = {use.predicate for use in skill.action.effect.adds}
            deletes = {use.predicate for use in skill.action.effect.deletes}
            if (one in adds and other not in deletes) or (other in adds and one not in deletes):
                return False
        return True

    for fact in facts:
        for skill in holding.get(fact.predicate, ())[:1]:
            held = Variable(_held_at_the_end(skill) or "")
            for lost in skill.action.effect.deletes:
                if not excludes(fact.predicate, lost.predicate):
                    continue
                for other in facts:
                    # What the skill deletes, with the held object for its parameter, and any for the other ones.
                    if other.predicate == lost.predicate and all(
                        argument == (fact.arguments[0] if term == held else term.name)
                        for term, argument in zip(lost.terms, other.arguments, strict=True)
                        if term == held or not isinstance(term, Variable)
                    ):
                        message = (
                            f"the state has `{other}` and `{fact}`, but `{skill.name}`, which makes `{fact}` true,"
                            f" makes `{other}` false"
                        )
                        mend = f"remove `{fact}` or `{other}` from the state"
                        yield document.problem("contradictory-facts", ("state", facts[other]), message, mend)
