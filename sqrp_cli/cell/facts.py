"""The facts of a workspace: what it states, what follows from its cell, and what its facts say of the tool."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import cast

import numpy as np

from sqrp_cli.cell.read_robot import RobotReader
from sqrp_cli.cell.scene import BoxSide, Held, SceneObject
from sqrp_cli.cell.workspace import WorkspaceFile
from sqrp_cli.errors import InputError, Problem, expected_names, no_such
from sqrp_cli.files.frames import AT_START, WORLD
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.logic.domain import Domain
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.skill.settings import Reference, number_of, side_of
from sqrp_cli.skill.skill import Grasp, GraspWaypoint, Meaning, Release, Skill

_FACT = re.compile(r"\s*(not\s+)?([A-Za-z][\w-]*)\s*(?:\(\s*([^()]*?)\s*\))?\s*")


def read_facts(reader: RobotReader, file: WorkspaceFile, domain: Domain) -> dict[Literal, int]:
    """The literals of `state`, each with its place in the list from 0, checked against the skills' common domain."""
    facts: dict[Literal, int] = {}
    for index, text in enumerate(file.state):
        path, signatures = ("state", index), domain.predicates
        match = _FACT.fullmatch(text)
        if match is None:
            message = f"found `{text}`, expected a fact such as `hand_empty` or `on(g1, table)`"
            reader.report("wrong-fact", path, message)
            continue
        predicate = match[2].lower()
        arguments = tuple(word.strip() for word in match[3].split(",")) if match[3] else ()
        if predicate not in signatures:
            expected = expected_names(predicate, signatures)
            message = f"found `{match[2]}`, which is no predicate of a skill; {expected}"
            reader.report("unknown-predicate", path, message)
            continue
        signature = signatures[predicate]
        if len(arguments) != len(signature.parameters):
            stated = f"{len(arguments)} argument{'s' * (len(arguments) != 1)}"
            message = f"`{predicate}` has {stated}, expected {len(signature.parameters)}: {signature}"
            reader.report("wrong-arity", path, message)
            continue
        for argument, parameter in zip(arguments, signature.parameters, strict=True):
            entry = file.objects.get(argument)
            if entry is None:
                reader.report("unknown-object", path, no_such(argument, "object", file.objects))
            elif not domain.fits(entry.types, parameter.type):
                message = f"`{argument}` is of type `{entry.type}`, expected `{parameter.type}`: {signature}"
                reader.report("wrong-object-type", path, message)
        fact = Literal(Atom(predicate, arguments), not match[1])
        if fact in facts:
            reader.report("repeated-value", path, f"`{fact}` is stated twice")
        elif fact.negated() in facts:
            reader.report("contradictory-facts", path, f"the state has both `{fact}` and `{fact.negated()}`")
        facts.setdefault(fact, index)
    return facts


def facts_of_cell(
    objects: Mapping[str, SceneObject],
    stated: Mapping[Literal, int],
    skills: Collection[Skill],
    domain: Domain,
    document: SourceDocument,
) -> dict[Atom, str]:
    """The facts that follow from the cell by what skills say of predicates (`initially`), each with from what.

    stated: literals of the state, each with its place in the list. They go first: nothing follows that one of them
    denies, nor where an object stands if one of them says that. Raises InputError, with the place, for facts that
    cannot be while an object is in the tool.
    """
    meanings = {predicate: meaning for skill in skills for predicate, meaning in skill.initially.items()}
    in_tool = next((name for name, item in objects.items() if item.X_TO is not None), None)
    said = {literal.atom: meanings.get(literal.atom.predicate) for literal in stated}
    placed = {atom.arguments[0] for atom, meaning in said.items() if meaning not in (None, "nothing held", "held")}
    holds = in_tool is not None or any(said[one.atom] == "held" and one.positive for one in stated)
    problems: list[Problem] = []
    for literal, index in stated.items() if in_tool is not None else ():
        atom, meaning = literal.atom, said[literal.atom] if literal.positive else None
        # That it stands somewhere, or that nothing is held.
        if meaning == "nothing held" or (meaning not in (None, "held") and atom.arguments[0] == in_tool):
            message = f"the state has `{atom}`, but `{in_tool}` is in the tool"
            mend = f"remove `{atom}` from the state, or state where `{in_tool}` stands instead of `held`"
            problems.append(document.problem("contradictory-facts", ("state", index), message, mend))
    if problems:
        raise InputError(*problems)
    standing = {
        item.name: item.on for item in objects.values() if item.on and item.X_TO is None and item.name not in placed
    }
    following: dict[Meaning, dict[tuple[str, ...], str]] = {
        "nothing held": {} if holds else {(): "an empty tool"},
        "held": {(item.name,): f"`held: {item.pose.held}`" for item in objects.values() if isinstance(item.pose, Held)},
        "stands on a fixture": {(name,): f"`on: {on}`" for name, on in standing.items() if objects[on].fixed},
        "stands on the other": {(name, on): f"`on: {on}`" for name, on in standing.items()},
    }
    found: dict[Atom, str] = {}
    for predicate, meaning in meanings.items():
        kinds = [parameter.type for parameter in domain.predicates[predicate].parameters]
        for names, why in following[meaning].items():
            fitting = (domain.fits(objects[name].types, kind) for name, kind in zip(names, kinds, strict=True))
            if (atom := Atom(predicate, names)) not in said and all(fitting):
                found[atom] = why
    return found


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
        added = [change.predicate for change in skill.action.adds if change.terms == (f"?{held}",)]
        elsewhere = {WORLD, *objects, *(parameter.name for parameter in skill.action.parameters)}
        seen = [
            predicate
            for predicate in added
            for box in (skill.targets[predicate].boxes if predicate in skill.targets else ())
            if (box.fits == held or held in (box.encloses or ())) and not box.frame.endswith(AT_START)
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


def with_held_by_facts(
    objects: dict[str, SceneObject], facts: Mapping[Atom, int], skills: Collection[Skill], document: SourceDocument
) -> tuple[dict[str, SceneObject], list[Problem]]:
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
        return objects, []
    (name,) = names
    grips: list[tuple[Atom, Skill, Held]] = []
    for fact, skill in [(one, skill) for one in stated for skill in holding[one.predicate]]:
        of_it = (w for w in skill.waypoints.values() if isinstance(w, GraspWaypoint))
        grasp = next((waypoint for waypoint in of_it if waypoint.object == _held_at_the_end(skill)), None)
        if grasp is not None:
            side, yaw, depth = (
                skill.defaults[one.parameter] if isinstance(one, Reference) else one
                for one in (grasp.side, grasp.yaw, grasp.depth)
            )
            beside = None if grasp.beside is None else 0.0
            held = Held(held=cast("BoxSide", side_of(side)), yaw=number_of(yaw), depth=number_of(depth), beside=beside)
            grips.append((fact, skill, held))
    if not grips:
        return objects, []
    path, size, (fact, skill, first) = ("objects", name, "pose"), objects[name].size, grips[0]
    for another, other_skill, other in grips[1:]:
        if not np.allclose(first.X_TO(size), other.X_TO(size), rtol=0.0, atol=1e-9):
            both = " and ".join(f"`{one}`" for one in dict.fromkeys((fact, another)))
            message = (
                f"the state has {both}, so `{name}` begins in the tool, but `{skill.name}` holds it by its side"
                f" {first.held} and `{other_skill.name}` in another way, by its side {other.held}"
            )
            mend = f"say how it is held: `pose: {{held: {first.held}}}`, with `yaw` and `depth` as needed"
            raise document.error("ambiguous-hold", path, message, mend)
    how = f"held by its side {first.held} as `{skill.name}` does it"
    message = f"the state has `{fact}`, so `{name}` begins in the tool, {how}"
    mend = f"write `pose: {{held: {first.held}}}`"
    warning = replace(document.problem("held-by-the-facts", path, message, mend), severity="warning")
    return {**objects, name: replace(objects[name], pose=first)}, [warning]


def _contradictions(
    facts: Mapping[Atom, int],
    holding: Mapping[str, tuple[Skill, ...]],
    skills: Collection[Skill],
    document: SourceDocument,
) -> Iterator[Problem]:
    """Facts that no sequence of skills can make true together with the fact that an object is held."""
    changes = [
        [{use.predicate for use in changed} for changed in (skill.action.adds, skill.action.deletes)]
        for skill in skills
    ]

    for fact in facts:
        for skill in holding.get(fact.predicate, ())[:1]:
            held = f"?{_held_at_the_end(skill) or ''}"
            for lost, other in product(skill.action.deletes, facts):
                # Every skill that makes one of the two predicates true makes the other false.
                pairs = ((fact.predicate, lost.predicate), (lost.predicate, fact.predicate))
                exclusive = all(a not in adds or b in deletes for adds, deletes in changes for a, b in pairs)
                # What the skill deletes, with the held object for its parameter, and any for the other ones.
                if (
                    exclusive
                    and other.predicate == lost.predicate
                    and all(
                        argument == (fact.arguments[0] if term == held else term)
                        for term, argument in zip(lost.terms, other.arguments, strict=True)
                        if term == held or not term.startswith("?")
                    )
                ):
                    message = f"the state has `{other}` and `{fact}`, but `{skill.name}`, which makes `{fact}` true,"
                    message, mend = f"{message} makes `{other}` false", f"remove `{fact}` or `{other}` from the state"
                    yield document.problem("contradictory-facts", ("state", facts[other]), message, mend)
