"""Formulas of Metric Temporal Logic (MTL) as trees: printing them, checking their names, and binding these to objects.

`origin` is the place of a node in its file; comparisons ignore it, and it is None for formulas made by a program. A
predicate's arguments may be left out if the skill's action uses the predicate with only one list of arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import TypeAlias

from sqrp_cli.errors import Place, Problem, expected_names
from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.source_text import TextOrigin
from sqrp_cli.records import dataclass


@dataclass(frozen=True)
class Instant:
    """A bound of an interval: the start or end of a primitive action plus `offset` [s], or a time [s].

    primitive and edge ("start" or "end") are both None for a time.
    """

    primitive: str | None = None
    edge: str | None = None
    offset: float = 0.0
    origin: TextOrigin | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        if self.primitive is None:
            return _number(self.offset)
        if not self.offset:
            return f"{self.primitive}.{self.edge}"
        return f"{self.primitive}.{self.edge} {'+' if self.offset > 0 else '-'} {_number(abs(self.offset))}"


@dataclass(frozen=True)
class Interval:
    """The closed interval of a temporal operator, relative to the instant at which the operator is evaluated."""

    start: Instant
    end: Instant

    def __str__(self) -> str:
        return f"[{self.start}, {self.end}]"


class _Printed:
    """A formula; `str` prints it in ASCII such that parsing gives the same formula back."""

    def __str__(self) -> str:
        return _print(self)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Predicate(_Printed):
    """A predicate with its arguments; None if they were left out, to be filled in from the skill."""

    name: str
    arguments: tuple[str, ...] | None = None
    origin: TextOrigin | None = field(default=None, compare=False, repr=False)

    @property
    def atom(self) -> Atom:
        """The ground atom; meaningful once arguments are filled in and bound to objects."""
        if self.arguments is None:
            raise ValueError(f"the arguments of `{self.name}` are not filled in")
        return Atom(self.name, self.arguments)


@dataclass(frozen=True)
class Not(_Printed):
    """Negation."""

    operand: Formula


@dataclass(frozen=True)
class Joined(_Printed):
    """Two or more formulas taken together."""

    operands: tuple[Formula, ...]


class And(Joined):
    """Conjunction."""


class Or(Joined):
    """Disjunction."""


@dataclass(frozen=True)
class Implies(_Printed):
    """Implication."""

    premise: Formula
    conclusion: Formula


@dataclass(frozen=True)
class Temporal(_Printed):
    """What holds of `operand` over `interval`."""

    interval: Interval
    operand: Formula
    origin: TextOrigin | None = field(default=None, compare=False, repr=False)


class Always(Temporal):
    """`operand` holds at every instant of `interval`."""


class Eventually(Temporal):
    """`operand` holds at some instant of `interval`; the interval is an event of interest."""


Formula: TypeAlias = Predicate | Not | And | Or | Implies | Always | Eventually


def children(formula: Formula) -> tuple[Formula, ...]:
    """The direct sub-formulas, from left to right."""
    match formula:
        case Predicate():
            return ()
        case Not(operand) | Temporal(operand=operand):
            return (operand,)
        case Joined(operands):
            return operands
        case Implies(premise, conclusion):
            return (premise, conclusion)


def with_children(formula: Formula, parts: tuple[Formula, ...]) -> Formula:
    """The same formula with other direct sub-formulas, in the order of `children`."""
    match formula:
        case Predicate():
            return formula
        case Joined():
            return replace(formula, operands=parts)
        case Implies():
            return Implies(*parts)
        case Not() | Temporal():
            return replace(formula, operand=parts[0])


_SIGNS = {Not: "not ", And: " and ", Or: " or ", Implies: " -> ", Always: "always", Eventually: "eventually"}
_BINDING = {Implies: 0, Or: 1, And: 2, Not: 3, Always: 3, Eventually: 3, Predicate: 4}
"""How tightly each kind of formula binds."""


def _print(formula: Formula) -> str:
    def enclosed(part: Formula, least_binding: int) -> str:
        text = _print(part)
        return text if _BINDING[type(part)] >= least_binding else f"({text})"

    sign = _SIGNS.get(type(formula), "")
    match formula:
        case Predicate(name, arguments):
            return name if not arguments else f"{name}({', '.join(arguments)})"
        case Not(operand):
            return sign + enclosed(operand, 3)
        case Temporal(interval, operand):
            return f"{sign}{interval} {enclosed(operand, 3)}"
        case Joined(operands):
            return sign.join(enclosed(operand, _BINDING[type(formula)] + 1) for operand in operands)
        case Implies(premise, conclusion):
            return enclosed(premise, 1) + sign + enclosed(conclusion, 0)


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


ArgumentLists = Mapping[str, tuple[tuple[str, ...], ...]]
"""For each predicate in an action, its different lists of arguments: names of parameters and constants, and `?name` for
the variable of a quantifier."""


def argument_lists(action: pddl.Action) -> ArgumentLists:
    """The predicates of the action's precondition and effect with their arguments."""
    parameters = {parameter.name for parameter in action.parameters}
    lists: dict[str, dict[tuple[str, ...], None]] = {}
    conditions = (use for use in pddl.nested(action.precondition) if isinstance(use, pddl.Holds))
    for use in (*conditions, *action.effect.adds, *action.effect.deletes):
        arguments = tuple(
            term.name if isinstance(term, pddl.Constant) or term.name in parameters else str(term) for term in use.terms
        )
        lists.setdefault(use.predicate, {})[arguments] = None
    return {predicate: tuple(found) for predicate, found in lists.items()}


def check_formula(
    formula: Formula, domain: pddl.Domain, action: pddl.Action, primitives: Sequence[str]
) -> Iterator[Problem]:
    """Problems with the names in a skill's formula, and intervals that end before they start whatever the durations.

    primitives: names of the skill's primitive actions, in order of execution.
    """
    if isinstance(formula, Predicate):
        for code, message in _check_predicate(formula, domain, action):
            yield problem_at(formula.origin, code, message)
    if isinstance(formula, Temporal):
        interval, start, end = formula.interval, formula.interval.start, formula.interval.end
        unknown = [bound for bound in (start, end) if bound.primitive is not None and bound.primitive not in primitives]
        for bound in unknown:
            known = expected_names(str(bound.primitive), primitives)
            message = f"there is no primitive action `{bound.primitive}`; {known}"
            yield problem_at(bound.origin, "mtl-unknown-primitive", message)
        if not unknown and (start.primitive is None) == (end.primitive is None):
            begun, ended = (
                primitives.index(bound.primitive) + (bound.edge == "end") if bound.primitive else 0
                for bound in (start, end)
            )
            late = start.offset > end.offset or (begun > ended and start.offset == end.offset)
            if begun >= ended and late:
                message = f"the interval {interval} ends before it starts"
                yield problem_at(start.origin, "mtl-empty-interval", message)
    for part in children(formula):
        yield from check_formula(part, domain, action, primitives)


def bind(formula: Formula, binding: Mapping[str, str], lists: ArgumentLists) -> Formula:
    """The formula about objects: left-out arguments filled in, and parameters replaced by their objects.

    binding: object name by parameter name; names that are not in it (constants, objects) stay. lists: of the skill's
    action, see `argument_lists`. Raises ValueError for arguments that cannot be filled in; `check_formula` reports such
    formulas to the user.
    """
    if not isinstance(formula, Predicate):
        return with_children(formula, tuple(bind(part, binding, lists) for part in children(formula)))
    arguments = formula.arguments
    if arguments is None:
        if len(lists.get(formula.name, ())) != 1:
            raise ValueError(f"the arguments of `{formula.name}` cannot be left out")
        arguments = lists[formula.name][0]
    return Predicate(formula.name, tuple(binding.get(name, name) for name in arguments), formula.origin)


def problem_at(origin: TextOrigin | None, code: str, message: str, place: Place | None = None) -> Problem:
    """An error at the origin of a part; at the place if it has none."""
    return origin.problem(code, message) if origin else Problem(code, message, place)


def _check_predicate(use: Predicate, domain: pddl.Domain, action: pddl.Action) -> Iterator[tuple[str, str]]:
    """Codes and messages of what is wrong with a predicate's name and arguments."""
    lists = argument_lists(action)
    if use.name not in lists:
        known = expected_names(use.name, lists)
        yield "mtl-unknown-predicate", f"action `{action.name}` does not use a predicate `{use.name}`; {known}"
    elif use.arguments is None:
        if len(lists[use.name]) > 1 or any(name.startswith("?") for name in lists[use.name][0]):
            uses = ", ".join(f"{use.name}({', '.join(names)})" for names in lists[use.name])
            reason = f"because action `{action.name}` uses it as {uses}"
            yield "mtl-missing-arguments", f"the arguments of `{use.name}` must be given, {reason}"
    elif mismatch := domain.predicates[use.name].mismatch(use.arguments):
        yield "mtl-arity", mismatch
    else:
        types = dict(domain.constants) | {parameter.name: parameter.type for parameter in action.parameters}
        for name, expected in zip(use.arguments, domain.predicates[use.name].parameters, strict=True):
            if name not in types:
                known = expected_names(name, types)
                yield "mtl-unknown-argument", f"`{name}` is no parameter of `{action.name}` and no constant; {known}"
            elif not domain.fits([types[name]], expected.type):
                yield "mtl-type", f"`{name}` is of type `{types[name]}`, but `{use.name}` expects `{expected.type}`"
