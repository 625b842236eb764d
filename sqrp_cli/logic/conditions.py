"""Conditions and effects in a world: which parts fail, and which facts change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import TypeAlias

from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.records import dataclass

Objects = Mapping[str, frozenset[str]]
"""The names of all objects with their types; ancestors of types in the domain may be left out."""

Binding = Mapping[str, str]
"""Object name by variable name, without question mark."""

MAX_LITERALS = 50_000
"""Most literals of an expanded condition; see `literal_count`."""


UnmetPart: TypeAlias = Literal | str
"""A failing part of a condition: a literal, or the text of another part, an equality or a disjunction."""


def failing_literals(
    action: pddl.Action, binding: Binding, facts: frozenset[Atom], objects: Objects, domain: pddl.Domain
) -> tuple[UnmetPart, ...]:
    """The parts of the grounded precondition that do not hold, once each, from left to right; empty if it holds.

    facts: the atoms that hold; every other atom is false.
    """

    def failing(part: GroundCondition) -> Iterator[UnmetPart]:
        match part:
            case Literal(atom, positive):
                if (atom in facts) != positive:
                    yield part
            case All(parts):
                for inner in parts:
                    yield from failing(inner)
            case Some(alternatives, text):
                if all(next(failing(alternative), None) for alternative in alternatives):
                    yield text

    return tuple(dict.fromkeys(failing(ground_condition(action.precondition, binding, objects, domain))))


def apply_effect(action: pddl.Action, binding: Binding, facts: frozenset[Atom]) -> frozenset[Atom]:
    """The facts after the action: first without what it deletes, then with what it adds."""
    deletes = {ground_atom(change, binding) for change in action.effect.deletes}
    adds = {ground_atom(change, binding) for change in action.effect.adds}
    return (facts - deletes) | adds


def ground_atom(use: pddl.Holds, binding: Binding) -> Atom:
    """The ground atom of a use of a predicate."""
    return Atom(use.predicate, tuple(_object(term, binding) for term in use.terms))


def fitting_objects(parameter: pddl.Parameter, objects: Objects, domain: pddl.Domain) -> tuple[str, ...]:
    """The objects that fit a variable's type, in the order of `objects`."""
    return tuple(name for name, types in objects.items() if domain.fits(types, parameter.type))


@dataclass(frozen=True)
class All:
    """A ground conjunction; without parts, always true."""

    parts: tuple[GroundCondition, ...]


@dataclass(frozen=True)
class Some:
    """A ground disjunction; without alternatives, never true."""

    alternatives: tuple[GroundCondition, ...]
    text: str
    """The condition in words, for messages."""


GroundCondition: TypeAlias = Literal | All | Some
"""A condition about objects in negation normal form, quantifiers expanded and equalities decided."""


def ground_condition(
    condition: pddl.Condition, binding: Binding, objects: Objects, domain: pddl.Domain
) -> GroundCondition:
    """The condition for the objects of the binding, with negations pushed down to the literals."""

    def ground(part: pddl.Condition, bound: Binding, positive: bool) -> GroundCondition:
        def combine(parts: Iterator[GroundCondition], every: bool) -> GroundCondition:
            return All(tuple(parts)) if every else Some(tuple(parts), _text(part, bound, positive))

        match part:
            case pddl.Holds():
                return Literal(ground_atom(part, bound), positive)
            case pddl.Equal(left, right):
                holds = (_object(left, bound) == _object(right, bound)) == positive
                return All(()) if holds else Some((), _text(part, bound, positive))
            case pddl.Negation(inner):
                return ground(inner, bound, not positive)
            case pddl.Combination(parts):
                every = isinstance(part, pddl.Conjunction) == positive
                return combine((ground(inner, bound, positive) for inner in parts), every)
            case pddl.Quantified(variables, body):
                every = isinstance(part, pddl.ForAll) == positive
                names = [variable.name for variable in variables]
                choices = product(*(fitting_objects(variable, objects, domain) for variable in variables))
                bindings = ({**bound, **dict(zip(names, chosen, strict=True))} for chosen in choices)
                return combine((ground(body, inner, positive) for inner in bindings), every)

    return ground(condition, binding, True)


def rules_out(condition: pddl.Condition, binding: Binding) -> bool:
    """Whether equalities alone make the condition false whatever the facts, such as `not (= ?object ?onto)`."""
    match condition:
        case pddl.Conjunction(parts):
            return any(rules_out(part, binding) for part in parts)
        case pddl.Equal(left, right):
            return _object(left, binding) != _object(right, binding)
        case pddl.Negation(pddl.Equal(left, right)):
            return _object(left, binding) == _object(right, binding)
    return False


def literal_count(condition: pddl.Condition, objects: Objects, domain: pddl.Domain) -> int:
    """Number of literals and equalities in the result of `ground_condition`, without computing it.

    A quantifier multiplies its body by the product of its variables' domain sizes.
    """
    match condition:
        case pddl.Negation(part):
            return literal_count(part, objects, domain)
        case pddl.Combination(parts):
            return sum(literal_count(part, objects, domain) for part in parts)
        case pddl.Quantified(variables, body):
            return prod(domain_sizes(variables, objects, domain)) * literal_count(body, objects, domain)
    return 1


def domain_sizes(variables: Sequence[pddl.Parameter], objects: Objects, domain: pddl.Domain) -> list[int]:
    """Number of objects that fit each variable."""
    return [len(fitting_objects(variable, objects, domain)) for variable in variables]


def largest_quantifier(
    condition: pddl.Condition, objects: Objects, domain: pddl.Domain
) -> pddl.ForAll | pddl.Exists | None:
    """The quantifier whose variables have the largest product of domain sizes; None if there is no quantifier."""
    quantifiers = (part for part in pddl.nested(condition) if isinstance(part, pddl.ForAll | pddl.Exists))
    return max(quantifiers, key=lambda q: prod(domain_sizes(q.variables, objects, domain)), default=None)


def _object(term: pddl.Term, binding: Binding) -> str:
    return term.name if isinstance(term, pddl.Constant) else binding[term.name]


def _text(condition: pddl.Condition, binding: Binding, positive: bool) -> str:
    """The condition in words, with objects in place of the variables that are bound."""

    def bound(part: pddl.Condition) -> pddl.Condition:
        match part:
            case pddl.Holds(predicate, terms):
                return pddl.Holds(predicate, tuple(map(named, terms)))
            case pddl.Equal(left, right):
                return pddl.Equal(named(left), named(right))
            case pddl.Negation(inner):
                return pddl.Negation(bound(inner))
            case pddl.Combination(parts):
                return type(part)(tuple(map(bound, parts)))
            case pddl.Quantified(variables, body):
                return type(part)(variables, bound(body))

    def named(term: pddl.Term) -> pddl.Term:
        return pddl.Constant(binding[term.name]) if isinstance(term, pddl.Variable) and term.name in binding else term

    return str(bound(condition) if positive else pddl.Negation(bound(condition)))
