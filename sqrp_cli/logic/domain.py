"""A PDDL domain: types, predicates and actions, with the conditions and effects of the actions as trees.

PDDL ignores case; every name here is in lower case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TypeAlias, TypeVar

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.records import dataclass

OBJECT = "object"
"""The type that every object has."""


@dataclass(frozen=True)
class Parameter:
    """A typed variable of a predicate, an action or a quantifier; `name` is without the question mark."""

    name: str
    type: str = OBJECT

    def __str__(self) -> str:
        return f"?{self.name} - {self.type}"


@dataclass(frozen=True)
class Signature:
    """A declared predicate."""

    name: str
    parameters: tuple[Parameter, ...]

    @property
    def types(self) -> tuple[str, ...]:
        """Types of the parameters."""
        return tuple(parameter.type for parameter in self.parameters)

    def mismatch(self, arguments: Sequence[object]) -> str | None:
        """The message for a use with a wrong number of arguments; None if the number is right."""
        found, expected = len(arguments), len(self.parameters)
        if found == expected:
            return None
        return f"`{self.name}` has {found} argument{'s' * (found != 1)}; expected {expected}: {self}"

    def __str__(self) -> str:
        return f"({' '.join([self.name, *map(str, self.parameters)])})"


@dataclass(frozen=True)
class Variable:
    """A variable as an argument; `name` is without the question mark."""

    name: str

    def __str__(self) -> str:
        return f"?{self.name}"


@dataclass(frozen=True)
class Constant:
    """The name of an object as an argument."""

    name: str

    def __str__(self) -> str:
        return self.name


Term: TypeAlias = Variable | Constant


@dataclass(frozen=True)
class Holds:
    """True if the predicate holds for its arguments."""

    predicate: str
    terms: tuple[Term, ...]

    def __str__(self) -> str:
        return f"{self.predicate}({', '.join(map(str, self.terms))})" if self.terms else self.predicate


@dataclass(frozen=True)
class Equal:
    """True if both terms are the same object."""

    left: Term
    right: Term

    def __str__(self) -> str:
        return f"{self.left} = {self.right}"


@dataclass(frozen=True)
class Negation:
    """True if the part is false."""

    part: Condition

    def __str__(self) -> str:
        return f"not {self.part}" if isinstance(self.part, Holds) else f"not ({self.part})"


@dataclass(frozen=True)
class Combination:
    """Conditions taken together."""

    parts: tuple[Condition, ...] = ()


class Conjunction(Combination):
    """True if all parts are; without parts, always."""

    def __str__(self) -> str:
        return " and ".join(f"({part})" if isinstance(part, Disjunction) else str(part) for part in self.parts)


class Disjunction(Combination):
    """True if one part is; without parts, never."""

    def __str__(self) -> str:
        return " or ".join(f"({part})" if isinstance(part, Conjunction) else str(part) for part in self.parts)


@dataclass(frozen=True)
class Quantified:
    """A condition of the objects of some variables' types."""

    variables: tuple[Parameter, ...]
    body: Condition


class ForAll(Quantified):
    """True if the body is true for all objects of the variables' types."""

    def __str__(self) -> str:
        return f"for all {', '.join(map(str, self.variables))}: {self.body}"


class Exists(Quantified):
    """True if the body is true for some objects of the variables' types."""

    def __str__(self) -> str:
        return f"for some {', '.join(map(str, self.variables))}: {self.body}"


Condition: TypeAlias = Holds | Equal | Negation | Conjunction | Disjunction | ForAll | Exists


def nested(condition: Condition) -> Iterator[Condition]:
    """A condition, and all in it, from left to right."""
    yield condition
    match condition:
        case Negation(part) | Quantified(body=part):
            yield from nested(part)
        case Combination(parts):
            for part in parts:
                yield from nested(part)


@dataclass(frozen=True)
class Effect:
    """What an action does: `deletes` become false, then `adds` become true."""

    adds: tuple[Holds, ...]
    deletes: tuple[Holds, ...]


@dataclass(frozen=True)
class Action:
    """An action with its precondition and its unconditional effect."""

    name: str
    parameters: tuple[Parameter, ...]
    precondition: Condition
    effect: Effect
    place: Place = field(compare=False)
    """Place of its name."""


@dataclass(frozen=True, eq=False)
class Domain:
    """A PDDL domain."""

    name: str
    path: Path
    requirements: frozenset[str]
    """As declared, such as `:typing`."""
    types: Mapping[str, str]
    """Each declared type with its parent; `object` is the root and not among them."""
    constants: Mapping[str, str]
    """Each with its type."""
    predicates: Mapping[str, Signature]
    actions: Mapping[str, Action]

    def fits(self, object_types: Iterable[str], parameter_type: str) -> bool:
        """Whether an object with all of `object_types` fits a parameter of `parameter_type`.

        Types that this domain does not declare are compared by name, so a workspace may have finer types than a skill.
        """
        return parameter_type == OBJECT or any(
            parameter_type in with_ancestors(name, self.types) for name in object_types
        )


def with_ancestors(type_name: str, parents: Mapping[str, str]) -> frozenset[str]:
    """The type and every type above it; one without a parent is right below `object`. `parents` has no cycles."""
    above = {type_name, OBJECT}
    while type_name in parents:
        type_name = parents[type_name]
        above.add(type_name)
    return frozenset(above)


def merge_domains(domains: Sequence[Domain]) -> Domain:
    """One domain with the types, constants, predicates and actions of several, such as those of a workspace's skills.

    Raises InputError if two of them use a name differently: predicates may differ only in the names of their
    parameters, types and constants not at all, and every action needs its own name.
    """
    return Domain(
        name="-".join(domain.name for domain in domains),
        path=domains[0].path,
        requirements=frozenset(requirement for domain in domains for requirement in domain.requirements),
        types=_merge("type", domains, lambda domain: domain.types, lambda parent: parent),
        constants=_merge("constant", domains, lambda domain: domain.constants, lambda type_name: type_name),
        predicates=_merge("predicate", domains, lambda domain: domain.predicates, lambda signature: signature.types),
        actions=_merge("action", domains, lambda domain: domain.actions, lambda _: None),
    )


_Entry = TypeVar("_Entry")


def _merge(
    kind: str,
    domains: Sequence[Domain],
    part: Callable[[Domain], Mapping[str, _Entry]],
    meaning: Callable[[_Entry], object],
) -> Mapping[str, _Entry]:
    """Joins the entries; entries of the same name must have the same meaning, and None differs from everything."""
    merged: dict[str, _Entry] = {}
    owners: dict[str, Domain] = {}
    for domain in domains:
        for name, entry in part(domain).items():
            if name in merged and (meaning(entry) is None or meaning(entry) != meaning(merged[name])):
                message = f"{kind} `{name}` is also defined in {owners[name].path}"
                if meaning(entry) is not None:
                    message += f", as `{merged[name]}` there and `{entry}` here"
                raise bad_input("pddl-conflict", message, Place(domain.path))
            merged.setdefault(name, entry)
            owners.setdefault(name, domain)
    return merged
