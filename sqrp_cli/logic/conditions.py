"""Conditions and effects in a world: which parts fail, and which facts change."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import TypeAlias

from sqrp_cli.logic.domain import (
    Action,
    Condition,
    Conjunction,
    Constant,
    Disjunction,
    Domain,
    Equal,
    Exists,
    ForAll,
    Holds,
    Negation,
    Parameter,
    Term,
    Variable,
)
from sqrp_cli.logic.literal import Atom, Literal

Objects = Mapping[str, frozenset[str]]
"""The names of all objects with their types; ancestors of types in the domain may be left out."""

Binding = Mapping[str, str]
"""Object name by variable name, without question mark."""


MAX_LITERALS = 50_000
"""Most literals of an expanded condition; see `literal_count`."""


@dataclass(frozen=True)
class UnmetCondition:
    """A failing part of a condition that is not a literal: an equality, or a disjunction."""

    text: str

    def __str__(self) -> str:
        return self.text


UnmetPart: TypeAlias = Literal | UnmetCondition


def failing_literals(
    action: Action, binding: Binding, facts: frozenset[Atom], objects: Objects, domain: Domain
) -> tuple[UnmetPart, ...]:
    """The parts of the grounded precondition that do not hold, once each, from left to right; empty if it holds.

    facts: the atoms that hold; every other atom is false.
    """
    return tuple(dict.fromkeys(failures(action.precondition, binding, facts, objects, domain)))


def failures(
    condition: Condition, binding: Binding, facts: frozenset[Atom], objects: Objects, domain: Domain
) -> Iterator[UnmetPart]:
    """The parts of a condition that do not hold, from left to right; none if the condition holds."""
    ground = ground_condition(condition, binding, objects, domain)

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
                    yield UnmetCondition(text)

    return failing(ground)


def apply_effect(action: Action, binding: Binding, facts: frozenset[Atom]) -> frozenset[Atom]:
    """The facts after the action: first without what it deletes, then with what it adds."""
    deletes = {ground_atom(change, binding) for change in action.effect.deletes}
    adds = {ground_atom(change, binding) for change in action.effect.adds}
    return (facts - deletes) | adds


def ground_atom(use: Holds, binding: Binding) -> Atom:
    """The ground atom of a use of a predicate."""
    return Atom(use.predicate, tuple(_object(term, binding) for term in use.terms))


def fitting_objects(parameter: Parameter, objects: Objects, domain: Domain) -> tuple[str, ...]:
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


def ground_condition(condition: Condition, binding: Binding, objects: Objects, domain: Domain) -> GroundCondition:
    """The condition for the objects of the binding, with negations pushed down to the literals."""

    def ground(part: Condition, bound: Binding, positive: bool) -> GroundCondition:
        def combine(parts: Iterator[GroundCondition], every: bool) -> GroundCondition:
            return All(tuple(parts)) if every else Some(tuple(parts), _text(part, bound, positive))

        match part:
            case Holds():
                return Literal(ground_atom(part, bound), positive)
            case Equal(left, right):
                holds = (_object(left, bound) == _object(right, bound)) == positive
                return All(()) if holds else Some((), _text(part, bound, positive))
            case Negation(inner):
                return ground(inner, bound, not positive)
            case Conjunction(parts):
                return combine((ground(inner, bound, positive) for inner in parts), every=positive)
            case Disjunction(parts):
                return combine((ground(inner, bound, positive) for inner in parts), every=not positive)
            case ForAll(variables, body):
                bindings = _extensions(bound, variables, objects, domain)
                return combine((ground(body, inner, positive) for inner in bindings), every=positive)
            case Exists(variables, body):
                bindings = _extensions(bound, variables, objects, domain)
                return combine((ground(body, inner, positive) for inner in bindings), every=not positive)

    return ground(condition, binding, True)


def literal_count(condition: Condition, objects: Objects, domain: Domain) -> int:
    """Number of literals and equalities in the result of `ground_condition`, without computing it.

    A quantifier multiplies its body by the product of its variables' domain sizes.
    """
    match condition:
        case Negation(part):
            return literal_count(part, objects, domain)
        case Conjunction(parts) | Disjunction(parts):
            return sum(literal_count(part, objects, domain) for part in parts)
        case ForAll(variables, body) | Exists(variables, body):
            return prod(domain_sizes(variables, objects, domain)) * literal_count(body, objects, domain)
    return 1


def domain_sizes(variables: Sequence[Parameter], objects: Objects, domain: Domain) -> list[int]:
    """Number of objects that fit each variable."""
    return [len(fitting_objects(variable, objects, domain)) for variable in variables]


def largest_quantifier(condition: Condition, objects: Objects, domain: Domain) -> ForAll | Exists | None:
    """The quantifier whose variables have the largest product of domain sizes; None if there is no quantifier."""
    match condition:
        case Negation(part):
            return largest_quantifier(part, objects, domain)
        case Conjunction(parts) | Disjunction(parts):
            found = [largest_quantifier(part, objects, domain) for part in parts]
        case ForAll(_, body) | Exists(_, body):
            found = [condition, largest_quantifier(body, objects, domain)]
        case _:
            return None
    quantifiers = [quantifier for quantifier in found if quantifier is not None]
    return max(quantifiers, key=lambda q: prod(domain_sizes(q.variables, objects, domain)), default=None)


def _extensions(
    binding: Binding, variables: tuple[Parameter, ...], objects: Objects, domain: Domain
) -> Iterator[Binding]:
    names = [variable.name for variable in variables]
    for chosen in product(*(fitting_objects(variable, objects, domain) for variable in variables)):
        yield {**binding, **dict(zip(names, chosen, strict=True))}


def _object(term: Term, binding: Binding) -> str:
    return term.name if isinstance(term, Constant) else binding[term.name]


def _text(condition: Condition, binding: Binding, positive: bool) -> str:
    """The condition in words, with objects in place of the variables that are bound."""

    def replace(term: Term) -> Term:
        return Constant(binding[term.name]) if isinstance(term, Variable) and term.name in binding else term

    bound = _substitute(condition, replace)
    return str(bound if positive else Negation(bound))


def _substitute(condition: Condition, replace: Callable[[Term], Term]) -> Condition:
    match condition:
        case Holds(predicate, terms):
            return Holds(predicate, tuple(map(replace, terms)))
        case Equal(left, right):
            return Equal(replace(left), replace(right))
        case Negation(part):
            return Negation(_substitute(part, replace))
        case Conjunction(parts):
            return Conjunction(tuple(_substitute(part, replace) for part in parts))
        case Disjunction(parts):
            return Disjunction(tuple(_substitute(part, replace) for part in parts))
        case ForAll(variables, body):
            return ForAll(variables, _substitute(body, replace))
        case Exists(variables, body):
            return Exists(variables, _substitute(body, replace))
