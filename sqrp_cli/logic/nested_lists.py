"""Reading nested lists of words in parentheses, the syntax of PDDL."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, TypeAlias

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.logic.source_text import SourceText, character_name, depth, is_token, is_unseen

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

MAX_DEPTH = 50
"""Deepest nesting of lists."""

MAX_LENGTH = 1_000_000
"""Most characters of a file."""


_NOT_PLAIN = re.compile(r";[^\n]*|[^\t\n\f\r -~]")
"""Comments, and characters that are neither printable ASCII nor white space of the grammar."""


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
    from lark.exceptions import UnexpectedInput

    if len(source.text) > MAX_LENGTH:
        message = f"the file has {len(source.text)} characters; at most {MAX_LENGTH} are read"
        raise InputError(Problem("pddl-too-long", message, source.place))
    for found in _NOT_PLAIN.finditer(source.text):
        if not found[0].startswith(";") and is_unseen(found[0]):
            message = f"found the character {character_name(found[0])}, which no word of PDDL has"
            raise InputError(
                source.problem("pddl-character", message, found.start(), "remove it, or put a blank or an end of line")
            )
    try:
        tree = _tree(source.text)
    except UnexpectedInput:
        raise InputError(_syntax_problem(source)) from None
    if depth(tree) > MAX_DEPTH:
        raise InputError(source.problem("pddl-too-deep", f"lists are nested deeper than {MAX_DEPTH} levels", 0))
    return _list(tree)


@lru_cache(maxsize=64)
def _tree(text: str) -> Tree[Token]:
    """The syntax tree of a text, cached: cells often share the texts of skills."""
    return _parser().parse(text)


@cache
def _parser() -> Lark:
    from lark import Lark

    grammar = files("sqrp_cli.logic").joinpath("pddl.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", start="list", propagate_positions=True)


def _list(tree: Tree[Token]) -> WordList:
    nodes = (Word(item.lower(), item.start_pos or 0) if is_token(item) else _list(item) for item in tree.children)
    return WordList(tuple(nodes), tree.meta.start_pos)


def _syntax_problem(source: SourceText) -> Problem:
    """The problem with the parentheses of a text that is not one list."""
    open_lists: list[Token] = []
    before = ""
    ended = False
    for token in _parser().lex(source.text):
        if ended:
            message = f"`{token}` follows after the end of the domain; is there a `)` too many before it?"
            return source.problem("pddl-syntax", message, _offset(token))
        if token.type == "_LPAR":
            open_lists.append(token)
        elif token.type == "_RPAR" and open_lists:
            open_lists.pop()
            ended = not open_lists
        elif not open_lists:
            return source.problem("pddl-syntax", f"expected `(define (domain ...`, found `{token}`", _offset(token))
        elif before == "(" and token.startswith(":") and len(open_lists) > 2:
            line = source.place_at(_offset(open_lists[-2])).line
            message = f"`{token}` begins inside the list that line {line} opens; is a `)` missing before it?"
            return source.problem("pddl-syntax", message, _offset(open_lists[-1]))
        before = str(token)
    if not open_lists:
        return source.problem("pddl-syntax", "the file is empty; expected `(define (domain ...`", 0)
    return source.problem("pddl-syntax", "this parenthesis is never closed", _offset(open_lists[-1]))


def _offset(token: Token) -> int:
    return token.start_pos or 0
