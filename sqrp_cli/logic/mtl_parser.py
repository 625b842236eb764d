"""Reading formulas of Metric Temporal Logic.

Grammar, from the loosest to the tightest binding; `and` and `or` join any number of formulas, `->` groups to the right:

    formula     = formula -> formula  |  formula or formula  |  formula and formula
                | not formula  |  always[instant, instant] formula  |  eventually[instant, instant] formula
                | predicate  |  predicate(name, ...)  |  (formula)
    instant     = primitive.start  |  primitive.end  |  either of them + seconds or - seconds  |  seconds

Other spellings: `G` `F` `□` `◇` for the temporal operators, `!` `¬`, `&` `∧`, `|` `∨`, `→`.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

from sqrp_cli.errors import InputError, Place, Problem, bad_input, nearest
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import SourceText, TextOrigin, character_name, is_token

if TYPE_CHECKING:
    from lark import Lark, Token, Tree
    from lark.exceptions import UnexpectedInput

MAX_DEPTH = 50
"""Deepest nesting of a formula."""

MAX_LENGTH = 20_000
"""Most characters of a formula."""

_EXPECTED = {
    "ALWAYS": "`always`", "EVENTUALLY": "`eventually`", "NOT": "`not`", "AND": "`and`", "OR": "`or`",
    "IMPLIES": "`->`", "EDGE": "`start` or `end`", "SIGN": "`+`, `-`", "NUMBER": "a number of seconds",
    "NAME": "a name", "LPAR": "`(`", "RPAR": "`)`", "LSQB": "`[`", "RSQB": "`]`", "COMMA": "`,`", "DOT": "`.`",
    "$END": "the end of the formula",
}  # fmt: skip
"""Names of the grammar's terminals in messages, in the order of their listing."""

_KEYWORDS = {
    "ALWAYS": "always", "EVENTUALLY": "eventually", "NOT": "not", "AND": "and", "OR": "or", "IMPLIES": "implies",
}  # fmt: skip


def parse_formula(text: str, place: Place, indent: int = 0) -> mtl.Formula:
    """Reads a formula of the language described above.

    place: where the text starts. indent: columns before every further line of the text in the file that are not part of
    it. Raises InputError with line, column and an excerpt of the text. `check_formula` checks the names.
    """
    from lark.exceptions import UnexpectedInput

    source = SourceText(text, place, indent)
    if len(text) > MAX_LENGTH:
        raise bad_input("mtl-too-long", f"the formula has {len(text)} characters; at most {MAX_LENGTH} are read", place)
    try:
        tree = _tree(text)
    except UnexpectedInput as error:
        raise InputError(_syntax_problem(source, error)) from None
    return _formula(tree, source, 1)


@cache
def _parser() -> Lark:
    from lark import Lark

    grammar = files("sqrp_cli.logic").joinpath("mtl.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", maybe_placeholders=False)


@lru_cache(maxsize=256)
def _tree(text: str) -> Tree[Token]:
    """The syntax tree of a text, cached: cells often share the texts of skills."""
    return _parser().parse(text)


def _formula(tree: Tree[Token], source: SourceText, level: int) -> mtl.Formula:
    if level > MAX_DEPTH:
        raise InputError(source.problem("mtl-too-deep", f"the formula is nested deeper than {MAX_DEPTH} levels", 0))
    trees = [part for part in tree.children if not is_token(part)]
    tokens = [part for part in tree.children if is_token(part)]
    match tree.data:
        case "bare_predicate":
            return mtl.Predicate(str(tokens[0]), None, _origin(tokens[0], source))
        case "predicate":
            return mtl.Predicate(str(tokens[0]), tuple(map(str, tokens[1:])), _origin(tokens[0], source))
        case "always" | "eventually" as kind:
            start, end = (_instant(bound, source) for bound in trees[0].children if not is_token(bound))
            operator = mtl.Always if kind == "always" else mtl.Eventually
            return operator(mtl.Interval(start, end), _formula(trees[1], source, level + 1), _origin(tokens[0], source))
    parts = tuple(_formula(part, source, level + 1) for part in trees)
    if tree.data in ("and_", "or_"):
        return mtl.And(parts) if tree.data == "and_" else mtl.Or(parts)
    return mtl.Not(*parts) if tree.data == "not_" else mtl.Implies(*parts)


def _instant(node: Tree[Token], source: SourceText) -> mtl.Instant:
    tokens = [part for part in node.children if is_token(part)]
    first, last = tokens[0], tokens[-1]
    seconds = float(last) if last.type == "NUMBER" else 0.0
    if not math.isfinite(seconds):
        raise InputError(_origin(last, source).problem("mtl-number", f"`{last}` is too large for a time in seconds"))
    if node.data == "time":
        return mtl.Instant(offset=seconds, origin=_origin(first, source))
    if len(tokens) > 2 and tokens[2] != "+":
        seconds = -seconds
    return mtl.Instant(str(first), str(tokens[1]), seconds, _origin(first, source))


def _origin(token: Token, source: SourceText) -> TextOrigin:
    return TextOrigin(source, token.start_pos or 0)


def _syntax_problem(source: SourceText, error: UnexpectedInput) -> Problem:
    from lark.exceptions import UnexpectedToken

    if not isinstance(error, UnexpectedToken):
        offset = error.pos_in_stream or 0
        return source.problem("mtl-syntax", f"unexpected character {character_name(source.text[offset])}", offset)
    token = error.token
    expected = [words for name, words in _EXPECTED.items() if name in error.expected]
    listed = " or ".join([", ".join(expected[:-1]), expected[-1]] if len(expected) > 1 else expected)
    if token.type == "$END":
        end = len(source.text.rstrip())
        found = "the formula ends too early" if end else "the formula is empty"
        return source.problem("mtl-syntax", f"{found}; expected {listed}", end)
    offset = token.start_pos or 0
    before = error.token_history[-1] if error.token_history else None
    if token.type == "LSQB" and before is not None and before.type == "NAME":
        hint = nearest(before, ["always", "eventually", "G", "F"])
        advice = f"did you mean `{hint}`?" if hint else "expected `always` or `eventually`"
        message = f"`{before}` is no temporal operator but has an interval; {advice}"
        return source.problem("mtl-syntax", message, before.start_pos or 0)
    keywords = [keyword for name, keyword in _KEYWORDS.items() if name in error.expected]
    hint = nearest(token, keywords) if token.type == "NAME" else None
    advice = f"did you mean `{hint}`?" if hint else f"expected {listed}"
    return source.problem("mtl-syntax", f"unexpected `{token}`; {advice}", offset)
