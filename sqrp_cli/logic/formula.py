"""Formulas of Metric Temporal Logic (MTL) as trees, and printing them.

`origin` is the place of a node in its file; comparisons ignore it, and it is None for formulas made by a program.
"""

from __future__ import annotations

from dataclasses import field, replace
from typing import TypeAlias

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
