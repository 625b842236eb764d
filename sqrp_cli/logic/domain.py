"""A PDDL domain: types, predicates and actions, with the conditions and effects of the actions as trees.

PDDL ignores case; every name here is in lower case.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from itertools import product
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.records import dataclass

OBJECT = "object"  # The type that every object has


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

    def mismatch(self, arguments: Sequence[object]) -> str | None:
        """The message for a use with a wrong number of arguments; None if the number is right."""
        found, expected = len(arguments), len(self.parameters)
        if found == expected:
            return None
        return f"`{self.name}` has {found} argument{'s' * (found != 1)}; expected {expected}: {self}"

    def __str__(self) -> str:
        return f"({' '.join([self.name, *map(str, self.parameters)])})"


EQUAL = "="  # The predicate that is true if its two terms are the same object


@dataclass(frozen=True)
class Holds:
    """True if the predicate holds for its arguments."""

    predicate: str
    terms: tuple[str, ...]  # Variables with their question mark, such as `?object`, and names of constants

    def __str__(self) -> str:
        if self.predicate == EQUAL:
            return " = ".join(self.terms)
        return f"{self.predicate}({', '.join(self.terms)})" if self.terms else self.predicate


@dataclass(frozen=True)
class Compound:
    """A condition made of others, its parts."""

    kind: Literal["not", "and", "or", "forall", "exists"]  # `and` without parts is true, `or` without parts is false
    parts: tuple[Condition, ...] = ()
    """One of `not`; of a quantifier, which is about all or some objects of its variables' types, its body."""
    variables: tuple[Parameter, ...] = ()  # Of a quantifier

    def __str__(self) -> str:
        if self.variables:
            whose = "all" if self.kind == "forall" else "some"
            return f"for {whose} {', '.join(map(str, self.variables))}: {self.parts[0]}"
        if self.kind == "not":
            plain = isinstance(self.parts[0], Holds) and self.parts[0].predicate != EQUAL
            return f"not {self.parts[0]}" if plain else f"not ({self.parts[0]})"
        other = "or" if self.kind == "and" else "and"
        mixed = (isinstance(part, Compound) and part.kind == other for part in self.parts)
        texts = [f"({part})" if loose else str(part) for part, loose in zip(self.parts, mixed, strict=True)]
        return f" {self.kind} ".join(texts)


Condition: TypeAlias = Holds | Compound
Tree = TypeVar("Tree")


def nested(whole: Tree) -> Iterator[Tree]:
    """A condition or a formula, and all in it: outer before inner, from left to right."""
    yield whole
    for part in getattr(whole, "parts", ()):
        yield from nested(part)


@dataclass(frozen=True)
class Action:
    """An action with its precondition and its unconditional effect: `deletes` become false, then `adds` true."""

    name: str
    parameters: tuple[Parameter, ...]
    precondition: Condition
    adds: tuple[Holds, ...]
    deletes: tuple[Holds, ...]
    place: Place = field(compare=False)  # Place of its name


@dataclass(frozen=True, eq=False)
class Domain:
    """A PDDL domain."""

    path: Path
    types: Mapping[str, str]  # Each declared type with its parent; `object` is the root and not among them
    constants: Mapping[str, str]  # Each with its type
    predicates: Mapping[str, Signature]
    actions: Mapping[str, Action]

    def fits(self, object_types: Iterable[str], parameter_type: str) -> bool:
        """Whether an object with all of `object_types` fits a parameter of `parameter_type`.

        Types that this domain does not declare are compared by name, so a workspace may have finer types than a skill.
        """
        for name in object_types:
            above = name
            while above != parameter_type and above in self.types:
                above = self.types[above]
            if above == parameter_type:
                return True
        return parameter_type == OBJECT


def merge_domains(domains: Sequence[Domain]) -> Domain:
    """One domain with the types, constants, predicates and actions of several, such as those of a workspace's skills.

    Raises InputError if two of them use a name differently: predicates may differ only in the names of their
    parameters, types and constants not at all, and every action needs its own name.
    """
    merged: dict[str, dict[str, Any]] = {part: {} for part in ("types", "constants", "predicates", "actions")}
    owners: dict[tuple[str, str], Domain] = {}
    for (part, entries), domain in product(merged.items(), domains):
        for name, entry in getattr(domain, part).items():
            if name in entries:
                same = entry == entries[name]
                if part == "predicates":
                    same = [one.type for one in entry.parameters] == [one.type for one in entries[name].parameters]
                if not same or part == "actions":
                    message = f"{part.removesuffix('s')} `{name}` is also defined in {owners[part, name].path}"
                    message += "" if part == "actions" else f", as `{entries[name]}` there and `{entry}` here"
                    raise bad_input("pddl-conflict", message, Place(domain.path))
            entries.setdefault(name, entry)
            owners.setdefault((part, name), domain)
    return Domain(domains[0].path, **merged)
