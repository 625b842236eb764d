"""Requests: frozen records of what is asked, each field stated once for the command line, Python and the studio.

A field is declared with `option` or `argument`: the word of the command line, its help, and the `FieldKind` that reads
it from words and from values of Python alike.
"""

# ruff: noqa: A002, ANN401 - `help` as Typer calls it; a field may hold anything
from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import FrozenInstanceError
from functools import partial
from typing import Any, ClassVar, Concatenate, NamedTuple, ParamSpec, Self, TypeVar, dataclass_transform

from sqrp_cli.errors import expected_names

Cell = TypeVar("Cell")
Asked = TypeVar("Asked", bound="Request")
Answered = TypeVar("Answered")
Given = ParamSpec("Given")
NEEDED: Any = inspect.Parameter.empty  # in place of a default: the field has none


class Words(dict[str, Any]):
    """Several words of a command line, by their names: a mapping that Python gives is none."""


class FieldKind(NamedTuple):
    """What a field holds."""

    words: Any
    """What a word of the command line is read as: `str`, `int`, `float`, `bool`, `Path`, or a list of one of them."""
    read: Callable[[Any, str], Any]
    """Makes the field of a value, called by the name that messages use; what it has made it leaves as it is.

    Raises InputError for what says nothing sensible.
    """
    metavar: str | None = None  # how help names the value, unless the option says it


class OptionWord:
    """An option or argument of the command line.

    flags: how it is called, without its value. value: how help names its value. name: as Python calls it. words: see
    `FieldKind`. complete: the function of `cli.completion` that proposes values.
    """

    def __init__(
        self, said: str, help: str, words: Any = str, metavar: str | None = None, complete: str | None = None
    ) -> None:
        """said: such as `--by`, `--jobs N`, `--run/--no-run`, or `TASK` for an argument."""
        self.flags, _, value = said.partition(" ")
        self.help, self.words, self.value, self.complete = help, words, value or metavar, complete
        self.is_argument = not said.startswith("-")
        first = self.flags.split("/")[0].split("|")[0].split(":=")[0].rstrip(".")
        self.name = first.lstrip("-").lower().replace("-", "_").replace("=", "_")


class Field(NamedTuple):
    """A field of a request."""

    words: tuple[OptionWord, ...]  # none for what only Python says; several are read together, by their names
    kind: FieldKind
    default: Any
    kw_only: bool = True
    uses: tuple[str, ...] = ()  # names of further words that it needs
    absent: Callable[[], Any] | None = None
    """Its value where a command line does not say it, if that is not the default."""


def option(
    said: str,
    help: str,
    kind: FieldKind,
    *,
    default: Any = None,
    complete: str | None = None,
    absent: Callable[[], Any] | None = None,
    kw_only: bool = True,
) -> Any:
    """A field that one option says, such as `--jobs N`, or an argument by its place, such as `TASK`."""
    return Field((OptionWord(said, help, kind.words, kind.metavar, complete),), kind, default, kw_only, absent=absent)


argument = partial(option, default=NEEDED)  # a field that is said by its place
flag: Any = partial(option, kind=FieldKind(bool, lambda value, _: value), default=False)  # true where it is given
optional: Any = option  # a field that may be left out, then it is None: types of requests need no default of it


def options(*words: OptionWord, kind: FieldKind, default: Any = None, uses: tuple[str, ...] = ()) -> Any:
    """A field that several options say, read together by their names. uses: names of other words that it needs."""
    return Field(words, kind, default, uses=uses)


def value(kind: FieldKind, *, default: Any, absent: Callable[[], Any] | None = None) -> Any:
    """A field that only Python says."""
    return Field((), kind, default, absent=absent)


@dataclass_transform(
    kw_only_default=True, frozen_default=True, field_specifiers=(option, flag, argument, options, value)
)
class Request:
    """A question. Raises InputError for a value that says nothing sensible.

    It is no dataclass, as making those of all commands would take longer than `--help` may.
    """

    fields: ClassVar[Mapping[str, Field]] = {}  # by name, those of the last base first
    own_first: ClassVar[Sequence[str]] = ()  # the names of the fields, the record's own first
    asked_by: ClassVar[str] = ""
    """The function or method of Python that takes the fields: that of the record's name unless it says another."""

    def __init_subclass__(cls) -> None:
        found: dict[str, Field] = {}
        for base in reversed(cls.__mro__):
            found.update({name: one for name, one in vars(base).items() if isinstance(one, Field)})
        cls.fields = found
        cls.own_first = list(dict.fromkeys(name for base in cls.__mro__ for name in vars(base) if name in found))
        if "asked_by" not in vars(cls):
            cls.asked_by = cls.__name__.removesuffix("Request").lower()
        cls.__doc__ = cls.__doc__ or next(filter(None, (base.__doc__ for base in cls.__mro__)))

    by_words: ClassVar[bool] = False
    """Whether a command line asks it: messages then call its fields by their options, else by their names."""

    def __init__(self, *given: Any, by_words: bool = False, **named: Any) -> None:
        by_place = [name for name, one in self.fields.items() if not one.kw_only]
        unknown = [name for name in named if name not in self.fields]
        twice = [name for name in by_place[: len(given)] if name in named]
        named.update(zip(by_place, given, strict=False))
        missing = [name for name, one in self.fields.items() if one.default is NEEDED and name not in named]
        wrong = None
        if unknown:
            wrong = f"has no argument `{unknown[0]}`; {expected_names(unknown[0], self.fields)}"
        elif len(given) > len(by_place):
            example = next(name for name in self.own_first if name not in by_place)
            places = " and ".join(by_place) or "nothing"
            wrong = f"takes {places} by place; give the rest by name, such as {example}=..."
        elif twice:
            wrong = f"takes `{twice[0]}` once, by place or by name"
        elif missing:
            wrong = f"lacks {' and '.join(f'`{name}`' for name in missing)}"
        if wrong is not None:
            raise TypeError(f"{self.asked_by}() {wrong}")
        vars(self)["by_words"] = by_words
        for name, one in self.fields.items():
            found = named.get(name, one.default)
            vars(self)[name] = found if found is one.default else one.kind.read(found, self.called(name))

    def __setattr__(self, name: str, _value: object) -> None:
        raise FrozenInstanceError(f"cannot assign to field `{name}`")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={one!r}' for name, one in vars(self).items())})"

    def but(self, **changed: Any) -> Self:
        """The same question with some fields changed."""
        return type(self)(**{**vars(self), **changed})

    def called(self, name: str) -> str:
        """What messages call a field."""
        words = self.fields[name].words
        return words[0].flags.split("/")[0] if self.by_words and words else name

    def given(self, name: str, value: object) -> str:
        """How messages say that a field be given a value."""
        return f"{self.called(name)} {value}" if self.by_words else f"{name}={value}"


def question(
    record: Callable[Given, Asked], answer: Callable[[Cell, Asked], Answered]
) -> Callable[Concatenate[Cell, Given], Answered]:
    """A method that asks: it takes the fields of a request, and gives its answer."""

    def ask(self: Cell, /, *given: Given.args, **named: Given.kwargs) -> Answered:
        return answer(self, record(*given, **named))

    ask.__doc__ = record.__doc__
    return ask
