"""Conditions and effects in a world: which parts fail, and which facts change."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import product
from math import prod
from typing import TypeAlias

from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.records import dataclass

Objects = Mapping[str, frozenset[str]]
"""The names of all objects with their types; ancestors of types in the domain may be left out."""
Binding = Mapping[str, str]  # Object name by variable name, without question mark
MAX_LITERALS = 50_000  # Most literals of an expanded condition; see `literal_count`
UnmetPart: TypeAlias = Literal | str
"""A failing part of a condition: a literal, or the text of another part, an equality or a disjunction."""


@dataclass(frozen=True)
class Joined:
    """Ground conditions taken together: true if every part is, or if some part is."""

    every: bool
    parts: tuple[GroundCondition, ...]
    text: str = ""  # The condition in words, for messages, if some part is enough


GroundCondition: TypeAlias = Literal | Joined
"""A condition about objects in negation normal form, quantifiers expanded and equalities decided."""


def failing_literals(
    action: pddl.Action, binding: Binding, facts: frozenset[Atom], objects: Objects, domain: pddl.Domain
) -> tuple[UnmetPart, ...]:
    """The parts of the grounded precondition that do not hold, once each, from left to right; empty if it holds.

    facts: the atoms that hold; every other atom is false.
    """
    return tuple(dict.fromkeys(_failing(ground_condition(action.precondition, binding, objects, domain), facts)))


def _failing(part: GroundCondition, facts: frozenset[Atom]) -> Iterator[UnmetPart]:
    """The parts of a condition that do not hold, from left to right."""
    if isinstance(part, Literal):
        if (part.atom in facts) != part.positive:
            yield part
    elif part.every:
        for inner in part.parts:
            yield from _failing(inner, facts)
    elif all(next(_failing(alternative, facts), None) for alternative in part.parts):
        yield part.text


def apply_effect(action: pddl.Action, binding: Binding, facts: frozenset[Atom]) -> frozenset[Atom]:
    """The facts after the action: first without what it deletes, then with what it adds."""
    deletes, adds = ({ground_atom(use, binding) for use in uses} for uses in (action.deletes, action.adds))
    return (facts - deletes) | adds


def ground_atom(use: pddl.Holds, binding: Binding) -> Atom:
    """The ground atom of a use of a predicate."""
    return Atom(use.predicate, tuple(binding[term[1:]] if term[0] == "?" else term for term in use.terms))


def fitting_objects(parameter: pddl.Parameter, objects: Objects, domain: pddl.Domain) -> tuple[str, ...]:
    """The objects that fit a variable's type, in the order of `objects`."""
    fitting = {types for types in set(objects.values()) if domain.fits(types, parameter.type)}  # few of many objects
    return tuple(name for name, types in objects.items() if types in fitting)


def ground_condition(
    condition: pddl.Condition, binding: Binding, objects: Objects, domain: pddl.Domain, *, positive: bool = True
) -> GroundCondition:
    """The condition for the objects of the binding, with negations pushed down to the literals.

    positive: false for its negation.
    """
    parts: tuple[GroundCondition, ...] = ()
    if isinstance(condition, pddl.Holds):
        atom = ground_atom(condition, binding)
        if condition.predicate != pddl.EQUAL:
            return Literal(atom, positive)
        every = (atom.arguments[0] == atom.arguments[1]) == positive
    elif condition.kind == "not":
        return ground_condition(condition.parts[0], binding, objects, domain, positive=not positive)
    else:
        every = (condition.kind in ("and", "forall")) == positive
        choices = product(*(fitting_objects(variable, objects, domain) for variable in condition.variables))
        names = [variable.name for variable in condition.variables]
        parts = tuple(
            ground_condition(
                part, {**binding, **dict(zip(names, chosen, strict=True))}, objects, domain, positive=positive
            )
            for chosen in choices
            for part in condition.parts
        )
    if every:
        return Joined(every, parts)
    text = re.sub(r"\?([\w-]+)", lambda found: binding.get(found[1], found[0]), str(condition))
    return Joined(every, parts, text if positive else f"not ({text})")


def rules_out(condition: pddl.Condition, binding: Binding) -> bool:
    """Whether equalities alone make the condition false whatever the facts, such as `not (= ?object ?onto)`."""
    if isinstance(condition, pddl.Compound) and condition.kind == "and":
        return any(rules_out(part, binding) for part in condition.parts)
    use, positive = condition, True
    if isinstance(use, pddl.Compound) and use.kind == "not":
        use, positive = use.parts[0], False
    if not isinstance(use, pddl.Holds) or use.predicate != pddl.EQUAL:
        return False
    left, right = ground_atom(use, binding).arguments
    return (left == right) != positive


def literal_count(condition: pddl.Condition, objects: Objects, domain: pddl.Domain) -> int:
    """Number of literals and equalities in the result of `ground_condition`, without computing it.

    A quantifier multiplies its body by the product of its variables' domain sizes.
    """
    if isinstance(condition, pddl.Holds):
        return 1
    choices = prod(len(fitting_objects(variable, objects, domain)) for variable in condition.variables)
    return choices * sum(literal_count(part, objects, domain) for part in condition.parts)
