"""Ground atoms and literals."""

from __future__ import annotations

from sqrp_cli.records import dataclass

NOT = "not "  # How a negated literal begins


@dataclass(frozen=True, order=True)
class Atom:
    """A predicate applied to object names, such as `hold(g1)`; without arguments, `hand_empty`."""

    predicate: str
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.predicate}({', '.join(self.arguments)})" if self.arguments else self.predicate

    @classmethod
    def of(cls, text: str) -> Atom:
        """The atom with this text, as written by `str`."""
        predicate, _, rest = text.partition("(")
        arguments = rest.rstrip(")")
        return cls(predicate, tuple(part.strip() for part in arguments.split(",")) if arguments else ())


@dataclass(frozen=True, order=True)
class Literal:
    """An atom or its negation, such as `not hold(g1)`."""

    atom: Atom
    positive: bool = True

    def __str__(self) -> str:
        return str(self.atom) if self.positive else f"{NOT}{self.atom}"

    def negated(self) -> Literal:
        """The opposite literal."""
        return Literal(self.atom, not self.positive)
