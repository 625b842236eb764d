"""Reading nested lists of words in parentheses, the syntax of PDDL."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from sqrp_cli.errors import InputError, Problem, bad_input
from sqrp_cli.logic.source_text import SourceText, character_name, is_unseen

MAX_DEPTH = 50
"""Deepest nesting of lists."""

MAX_LENGTH = 1_000_000
"""Most characters of a file."""

_PART = re.compile(r";[^\n]*|[()]|[^ \t\f\r\n();]+")
"""A comment, a parenthesis or a word.

A word has all but parentheses and what is skipped, which is less than what Python calls space: it shows as part of a
wrong name.
"""

_NOT_PLAIN = re.compile(r";[^\n]*|[^\t\n\f\r -~]")
"""Comments, and characters that are neither printable ASCII nor white space between words."""


@dataclass(frozen=True)
class Word:
    """A word in lower case (PDDL ignores case), with the offset of its first character."""

    text: str
    offset: int


@dataclass(frozen=True)
class WordList:
    """A list."""

    items: tuple[Node, ...]
    offset: int
    """Offset of its opening parenthesis."""

    @property
    def head(self) -> str:
        """The first item if it is a word, else an empty text."""
        first = self.items[0] if self.items else None
        return first.text if isinstance(first, Word) else ""


Node: TypeAlias = Word | WordList


def read_list(source: SourceText) -> WordList:
    """The only list in the text.

    Raises InputError for invisible characters, unbalanced parentheses and text outside them, with line, column and
    excerpt.
    """
    if len(source.text) > MAX_LENGTH:
        message = f"the file has {len(source.text)} characters; at most {MAX_LENGTH} are read"
        raise bad_input("pddl-too-long", message, source.place)
    for found in _NOT_PLAIN.finditer(source.text):
        if not found[0].startswith(";") and is_unseen(found[0]):
            message = f"found the character {character_name(found[0])}, which no word of PDDL has"
            raise InputError(
                source.problem("pddl-character", message, found.start(), "remove it, or put a blank or an end of line")
            )
    nested = _nested(source.text)
    if nested is None:
        raise InputError(_syntax_problem(source))
    if nested.depth > MAX_DEPTH:
        raise InputError(source.problem("pddl-too-deep", f"lists are nested deeper than {MAX_DEPTH} levels", 0))
    return nested.whole


class _Nested(NamedTuple):
    """A list with the levels of lists in it."""

    whole: WordList
    depth: int


@lru_cache(maxsize=64)
def _nested(text: str) -> _Nested | None:
    """The list that a text is, None if it is anything else; cached: cells often share the texts of skills.

    Without recursion, so that no input exhausts the stack.
    """
    open_lists: list[tuple[list[Node], int]] = []
    whole, depth = None, 0
    for part, offset in _parts(text):
        if whole is not None or (part != "(" and not open_lists):
            return None
        if part == "(":
            open_lists.append(([], offset))
            depth = max(depth, len(open_lists))
        elif part != ")":
            open_lists[-1][0].append(Word(part.lower(), offset))
        else:
            items, start = open_lists.pop()
            ended = WordList(tuple(items), start)
            if open_lists:
                open_lists[-1][0].append(ended)
            else:
                whole = ended
    return _Nested(whole, depth) if whole is not None else None


def _parts(text: str) -> Iterator[tuple[str, int]]:
    """Parentheses and words, each with the offset of its first character."""
    return ((found[0], found.start()) for found in _PART.finditer(text) if not found[0].startswith(";"))


def _syntax_problem(source: SourceText) -> Problem:
    """The problem with the parentheses of a text that is not one list."""
    open_lists: list[int] = []  # offsets of their parentheses
    before = ""
    ended = False
    for part, offset in _parts(source.text):
        if ended:
            message = f"`{part}` follows after the end of the domain; is there a `)` too many before it?"
            return source.problem("pddl-syntax", message, offset)
        if part == "(":
            open_lists.append(offset)
        elif part == ")" and open_lists:
            open_lists.pop()
            ended = not open_lists
        elif not open_lists:
            return source.problem("pddl-syntax", f"expected `(define (domain ...`, found `{part}`", offset)
        elif before == "(" and part.startswith(":") and len(open_lists) > 2:
            line = source.place_at(open_lists[-2]).line
            message = f"`{part}` begins inside the list that line {line} opens; is a `)` missing before it?"
            return source.problem("pddl-syntax", message, open_lists[-1])
        before = part
    if not open_lists:
        return source.problem("pddl-syntax", "the file is empty; expected `(define (domain ...`", 0)
    return source.problem("pddl-syntax", "this parenthesis is never closed", open_lists[-1])
