"""Reading nested lists of words in parentheses, the syntax of PDDL."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TypeAlias

from sqrp_cli.errors import InputError, bad_input
from sqrp_cli.logic.source_text import SourceText, character_name, is_unseen
from sqrp_cli.records import dataclass

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
    read = _read(source.text)
    if isinstance(read, Word):
        raise InputError(source.problem("pddl-syntax", read.text, read.offset))
    whole, depth = read
    if depth > MAX_DEPTH:
        raise InputError(source.problem("pddl-too-deep", f"lists are nested deeper than {MAX_DEPTH} levels", 0))
    return whole


@lru_cache(maxsize=64)
def _read(text: str) -> tuple[WordList, int] | Word:
    """The list that a text is with its levels of lists, or what is wrong with its parentheses and where.

    Cached: cells often share the texts of skills. Without recursion, so that no input exhausts the stack.
    """
    open_lists: list[tuple[list[Node], int]] = []
    whole, depth, before, suspect = None, 0, "", None
    for found in _PART.finditer(text):
        part, offset = found[0], found.start()
        if part.startswith(";"):
            continue
        if whole is not None:
            message = f"`{part}` follows after the end of the domain; is there a `)` too many before it?"
            return suspect or Word(message, offset)
        if part == "(":
            open_lists.append(([], offset))
            depth = max(depth, len(open_lists))
        elif not open_lists:
            return suspect or Word(f"expected `(define (domain ...`, found `{part}`", offset)
        elif part == ")":
            items, start = open_lists.pop()
            ended = WordList(tuple(items), start)
            if open_lists:
                open_lists[-1][0].append(ended)
            else:
                whole = ended
        else:
            if suspect is None and before == "(" and part.startswith(":") and len(open_lists) > 2:
                line = text.count("\n", 0, open_lists[-2][1]) + 1
                message = f"`{part}` begins inside the list that line {line} opens; is a `)` missing before it?"
                suspect = Word(message, open_lists[-1][1])
            open_lists[-1][0].append(Word(part.lower(), offset))
        before = part
    if whole is not None:
        return whole, depth
    if not open_lists:
        return Word("the file is empty; expected `(define (domain ...`", 0)
    return suspect or Word("this parenthesis is never closed", open_lists[-1][1])
