"""Formulas of Metric Temporal Logic (MTL) as trees: printing them, checking their names, and binding these to objects.

`origin` is the place of a node in its file; comparisons ignore it, and it is None for formulas made by a program. A
predicate's arguments may be left out if the skill's action uses the predicate with only one list of arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from typing import ClassVar, TypeAlias
from typing import Literal as OneOf

from sqrp_cli.errors import Place, Problem, expected_names
from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.source_text import TextOrigin
from sqrp_cli.records import dataclass

Operator = OneOf["not", "and", "or", "implies", "always", "eventually"]
BINDING: Mapping[str, int] = {"implies": 0, "or": 1, "and": 2, "not": 3, "always": 3, "eventually": 3}
"""How tightly operators bind."""


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
        seconds = repr(float(abs(self.offset))).removesuffix(".0")
        if self.primitive is None:
            return f"-{seconds}" if self.offset < 0 else seconds
        sign = f" {'+' if self.offset > 0 else '-'} {seconds}" if self.offset else ""
        return f"{self.primitive}.{self.edge}{sign}"

    def boundary(self, primitives: Sequence[str]) -> int:
        """How many of the primitive actions, named in order, are over at it without its offset; none at a time."""
        return 0 if self.primitive is None else primitives.index(self.primitive) + (self.edge == "end")


@dataclass(frozen=True)
class Interval:
    """The closed interval of a temporal operator, relative to the instant at which the operator is evaluated."""

    start: Instant
    end: Instant

    def __str__(self) -> str:
        return f"[{self.start}, {self.end}]"


@dataclass(frozen=True)
class Predicate:
    """A predicate with its arguments; None if they were left out, to be filled in from the skill."""

    name: str
    arguments: tuple[str, ...] | None = None
    origin: TextOrigin | None = field(default=None, compare=False, repr=False)
    parts: ClassVar[tuple[Formula, ...]] = ()
    interval: ClassVar[Interval | None] = None

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name

    @property
    def atom(self) -> Atom:
        """The ground atom; meaningful once arguments are filled in and bound to objects."""
        if self.arguments is None:
            raise ValueError(f"the arguments of `{self.name}` are not filled in")
        return Atom(self.name, self.arguments)


@dataclass(frozen=True)
class Operation:
    """An operator applied to formulas."""

    operator: Operator
    """`always`: the part holds throughout the interval; `eventually`: at some time, which is an event of interest."""
    parts: tuple[Formula, ...]
    """The direct sub-formulas, from left to right: two or more of `and` and `or`, two of `implies`, else one."""
    interval: Interval | None = None  # Of a temporal operator; None of any other
    origin: TextOrigin | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        """In ASCII, such that parsing gives the same formula back."""
        texts = []
        for number, part in enumerate(self.parts):
            # Prefixes may follow each other, and `->` groups to the right; any other operator needs a tighter part.
            nests = len(self.parts) == 1 or (self.operator == "implies" and number == 1)
            least = BINDING[self.operator] + (not nests)
            loose = isinstance(part, Operation) and BINDING[part.operator] < least
            texts.append(f"({part})" if loose else str(part))
        if len(texts) == 1:
            return f"{self.operator}{self.interval or ''} {texts[0]}"
        sign = "->" if self.operator == "implies" else self.operator
        return f" {sign} ".join(texts)


Formula: TypeAlias = Predicate | Operation
ArgumentLists = Mapping[str, tuple[tuple[str, ...], ...]]
"""For each predicate in an action, its different lists of arguments: names of parameters and constants, and `?name` for
the variable of a quantifier."""


def argument_lists(action: pddl.Action) -> ArgumentLists:
    """The predicates of the action's precondition and effect with their arguments."""
    parameters = {f"?{parameter.name}": parameter.name for parameter in action.parameters}
    lists: dict[str, dict[tuple[str, ...], None]] = {}
    conditions = (use for use in pddl.nested(action.precondition) if isinstance(use, pddl.Holds))
    for use in (*conditions, *action.adds, *action.deletes):
        if use.predicate != pddl.EQUAL:
            lists.setdefault(use.predicate, {})[tuple(parameters.get(term, term) for term in use.terms)] = None
    return {predicate: tuple(found) for predicate, found in lists.items()}


def check_formula(
    formula: Formula, domain: pddl.Domain, action: pddl.Action, primitives: Sequence[str]
) -> Iterator[Problem]:
    """Problems with the names in a skill's formula, and intervals that end before they start whatever the durations.

    primitives: names of the skill's primitive actions, in order of execution.
    """
    lists = argument_lists(action)
    types = dict(domain.constants) | {parameter.name: parameter.type for parameter in action.parameters}
    for part in pddl.nested(formula):
        if isinstance(part, Predicate):
            wrong = partial(problem_at, part.origin)
            if part.name not in lists:
                message = f"action `{action.name}` does not use a predicate `{part.name}`"
                yield wrong("mtl-unknown-predicate", f"{message}; {expected_names(part.name, lists)}")
            elif part.arguments is None:
                if len(lists[part.name]) > 1 or any(name.startswith("?") for name in lists[part.name][0]):
                    uses = ", ".join(f"{part.name}({', '.join(names)})" for names in lists[part.name])
                    reason = f"because action `{action.name}` uses it as {uses}"
                    yield wrong("mtl-missing-arguments", f"the arguments of `{part.name}` must be given, {reason}")
            elif mismatch := domain.predicates[part.name].mismatch(part.arguments):
                yield wrong("mtl-arity", mismatch)
            else:
                for name, parameter in zip(part.arguments, domain.predicates[part.name].parameters, strict=True):
                    if name not in types:
                        message = f"`{name}` is no parameter of `{action.name}` and no constant"
                        yield wrong("mtl-unknown-argument", f"{message}; {expected_names(name, types)}")
                    elif not domain.fits([types[name]], parameter.type):
                        message = f"`{name}` is of type `{types[name]}`, but `{part.name}` expects `{parameter.type}`"
                        yield wrong("mtl-type", message)
        elif (interval := part.interval) is not None:
            bounds = (interval.start, interval.end)
            unknown = [bound for bound in bounds if bound.primitive is not None and bound.primitive not in primitives]
            for bound in unknown:
                known = expected_names(str(bound.primitive), primitives)
                message = f"there is no primitive action `{bound.primitive}`; {known}"
                yield problem_at(bound.origin, "mtl-unknown-primitive", message)
            if not unknown and (interval.start.primitive is None) == (interval.end.primitive is None):
                begun, ended = (bound.boundary(primitives) for bound in bounds)
                later = interval.start.offset - interval.end.offset
                if begun >= ended and (later > 0 or (later == 0 and begun > ended)):
                    message = f"the interval {interval} ends before it starts"
                    yield problem_at(interval.start.origin, "mtl-empty-interval", message)


def bind(formula: Formula, binding: Mapping[str, str], lists: ArgumentLists) -> Formula:
    """The formula about objects: left-out arguments filled in, and parameters replaced by their objects.

    binding: object name by parameter name; names that are not in it (constants, objects) stay. lists: of the skill's
    action, see `argument_lists`. Raises ValueError for arguments that cannot be filled in; `check_formula` reports such
    formulas to the user.
    """
    if isinstance(formula, Operation):
        return replace(formula, parts=tuple(bind(part, binding, lists) for part in formula.parts))
    arguments = formula.arguments
    if arguments is None:
        if len(lists.get(formula.name, ())) != 1:
            raise ValueError(f"the arguments of `{formula.name}` cannot be left out")
        arguments = lists[formula.name][0]
    return Predicate(formula.name, tuple(binding.get(name, name) for name in arguments), formula.origin)


def problem_at(origin: TextOrigin | None, code: str, message: str, place: Place | None = None) -> Problem:
    """An error at the origin of a part; at the place if it has none."""
    if origin is None:
        return Problem(code, message, place)
    source, offset = origin
    return source.problem(code, message, offset)
