"""Errors: exit codes, problems of the input, the exception that carries them, and infeasibility as a value."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Literal

from sqrp_cli.records import dataclass

_LONG_QUOTE = re.compile(r'(`)(?!sqrp )([^`]{60})[^`]{200,}`|(")([^`"]{60})[^`"]{200,}"')
"""A quoted name or value of more than a few lines; commands stay whole, because users type them."""
MOST_PROBLEMS = 20  # Most problems that an error carries: a file may have one in each line
SURE = 0.7  # How alike a name and the nearest valid one are, of 0 to 1, so that the others need no mention
SHORT = 3  # Letters of names such as `g1`, of which one that is wrong is half of the name
MOST_NAMES = 20  # Most names that a message lists


class ExitCode(IntEnum):
    """Exit codes of the command line; scripts depend on them."""

    OK = 0
    NONE_FEASIBLE = 1
    BAD_INPUT = 2
    STOPPED_ON_FAULT = 3
    INTERNAL_ERROR = 70
    INTERRUPTED = 130


@dataclass(frozen=True)
class Place:
    """A position in an input file; line and column count from 1, None means the whole file."""

    file: Path
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)


@dataclass(frozen=True)
class Finding:
    """Something that is wrong or doubtful in the input."""

    code: str
    """Name of the kind of finding, such as `unknown-key`; `sqrp rules CODE` explains it."""
    message: str
    """What was found and what was expected, in one sentence."""


@dataclass(frozen=True)
class Problem(Finding):
    """A finding with its place, and how to mend it."""

    place: Place | None = None
    """Where; None for the command line itself."""
    severity: Literal["error", "warning"] = "error"
    mend: str | None = None
    """What the user can type or change to mend it, if known."""
    excerpt: str | None = None
    """The offending line with a caret under it, for inputs with a grammar."""

    def __post_init__(self) -> None:
        """Shorten quotes in the message: names and values may be as long as a file."""
        object.__setattr__(self, "message", _LONG_QUOTE.sub(r"\1\3\2\4...\1\3", self.message))

    @property
    def position(self) -> tuple[int, int]:
        """Line and column of its place, to sort the problems of a file; 0 where there is none."""
        return (self.place.line or 0, self.place.column or 0) if self.place else (0, 0)

    def __str__(self) -> str:
        return f"{self.place}: {self.message}" if self.place else self.message


class SqrpError(Exception):
    """Root of every error that SQRP raises on purpose."""


class InputError(SqrpError):
    """The input cannot be used; carries the problems that were found, most important first."""

    def __init__(self, *problems: Problem) -> None:
        problems = tuple(dict.fromkeys(problems))  # several entries may name one file
        if len(problems) > MOST_PROBLEMS:
            more = Problem("more-problems", f"{len(problems) - MOST_PROBLEMS:,} more problems are not listed")
            problems = (*problems[:MOST_PROBLEMS], more)
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


def bad_input(code: str, message: str, place: Place | None = None, *, mend: str | None = None) -> InputError:
    """The error of one finding, with the fields of `Problem`."""
    return InputError(Problem(code, message, place, mend=mend))


def bad_option(message: str, place: Place | None = None, *, mend: str | None = None) -> InputError:
    """The error of an option, or an argument, that cannot be used as it is."""
    return bad_input("bad-option", message, place, mend=mend)


@contextmanager
def needed(message: str, mend: str, place: Place | None = None) -> Iterator[None]:
    """Imports of a library that may not be installed: an ImportError becomes an InputError with the mend.

    message: what needs it; `{}` in it stands for the ImportError. place: of the file that needs it.
    """
    try:
        yield
    except ImportError as error:
        raise bad_input("missing-extra", message.format(error), place, mend=mend) from error


@dataclass(frozen=True)
class Infeasible:
    """Why something cannot be done: sentences with figures, the most useful first."""

    reasons: tuple[str, ...]
    tried: int = 0  # How many ways were tried


def counted(count: int) -> str:
    """A count for a message, short even for huge numbers."""
    return f"{count:,}" if count < 10**12 else "more than 10^12"


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that `name` is with typing errors, or None: one letter of a short name, few of a long one."""
    matches = difflib.get_close_matches(name, list(valid), n=1, cutoff=0.5 if len(name) <= SHORT else 0.6)
    return matches[0] if matches else None


def misspelt(name: str, valid: Iterable[str]) -> str | None:
    """As `nearest`, of names of robots, packages and files: none with other numbers, or alike only by shared words."""

    def apart(one: str, other: str) -> str:
        return "_".join(w for w in one.split("_") if w.rstrip("s") not in [v.rstrip("s") for v in other.split("_")])

    alike = [one for one in valid if re.findall(r"\d+", one) == re.findall(r"\d+", name)]
    return nearest(name, [one for one in alike if nearest(apart(name, one), [apart(one, name)]) is not None])


def expected_names(name: str, valid: Iterable[str]) -> str:
    """The second half of an "unknown name" message: the nearest valid name; where that is no help the valid names.

    Those with the word in them come first.
    """
    names = sorted(valid, key=lambda one: (name not in one, one))
    close = nearest(name, names)
    if close is not None and difflib.SequenceMatcher(None, close, name).ratio() >= SURE:
        return f"did you mean `{close}`?"
    if not names:
        return "none is defined"
    listed = f"expected one of {first_names(names)}"
    return listed if close is None else f"{listed}; did you mean `{close}`?"


def first_names(names: Iterable[str], most: int = MOST_NAMES) -> str:
    """The first of some names, and how many there are more."""
    first, more = [f"`{name}`" for name in names], ""
    if len(first) > most:
        more = f" and {len(first) - most} more"
    return ", ".join(first[:most]) + more


def no_such(name: str, what: str, known: Iterable[str]) -> str:
    """The message about a name that nothing of a kind has; what: the kind, such as `link`; known: those that exist."""
    return f"found `{name}`, which is no {what}; {expected_names(name, known)}"
