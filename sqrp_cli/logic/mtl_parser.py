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
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from sqrp_cli.errors import InputError, Place, Problem, nearest
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import SourceText, TextOrigin, character_name

MAX_DEPTH = 50
"""Deepest nesting of a formula."""

MAX_LENGTH = 20_000
"""Most characters of a formula."""


class _Kind(NamedTuple):
    """A kind of word or sign."""

    pattern: re.Pattern[str]
    words: str
    """What it is called in messages."""


_WORD_ENDS = "(?!-?[A-Za-z0-9_])"
"""A hyphen belongs to a name only between letters or digits, so that `a->b` is an implication."""

_RESERVED = "always|eventually|not|and|or|implies|G|F"
"""Words that are no names."""

_KINDS = {
    name: _Kind(re.compile(pattern), words)
    for name, pattern, words in (
        ("ALWAYS", f"(always|G){_WORD_ENDS}|□", "`always`"),
        ("EVENTUALLY", f"(eventually|F){_WORD_ENDS}|◇", "`eventually`"),
        ("NOT", f"not{_WORD_ENDS}|!|¬", "`not`"),
        ("AND", f"and{_WORD_ENDS}|&&?|∧", "`and`"),
        ("OR", rf"or{_WORD_ENDS}|\|\|?|∨", "`or`"),
        ("IMPLIES", f"implies{_WORD_ENDS}|->|→", "`->`"),
        ("EDGE", "(start|end)(?![A-Za-z0-9_])", "`start` or `end`"),
        ("SIGN", "[+−-]", "`+`, `-`"),
        ("NUMBER", r"([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?", "a number of seconds"),
        ("NAME", rf"(?!({_RESERVED}){_WORD_ENDS})[A-Za-z_][A-Za-z0-9_]*(-[A-Za-z0-9_]+)*", "a name"),
        ("LPAR", r"\(", "`(`"),
        ("RPAR", r"\)", "`)`"),
        ("LSQB", r"\[", "`[`"),
        ("RSQB", r"\]", "`]`"),
        ("COMMA", ",", "`,`"),
        ("DOT", r"\.", "`.`"),
        ("END", r"\Z", "the end of the formula"),
    )
}
"""In the order in which messages list them; what can be of several kinds is of the first."""

_KEYWORDS = {
    "ALWAYS": "always", "EVENTUALLY": "eventually", "NOT": "not", "AND": "and", "OR": "or", "IMPLIES": "implies",
}  # fmt: skip

_SPACE = re.compile(r"[ \t\f\r\n]*")

_BEGINS = ("ALWAYS", "EVENTUALLY", "NOT", "NAME", "LPAR")
"""What a formula begins with."""


class _Token(NamedTuple):
    """A word or a sign of a formula."""

    kind: str
    text: str
    offset: int


def parse_formula(text: str, place: Place, indent: int = 0) -> mtl.Formula:
    """Reads a formula of the language described above.

    place: where the text starts. indent: columns before every further line of the text in the file that are not part of
    it. Raises InputError with line, column and an excerpt of the text. `check_formula` checks the names.
    """
    source = SourceText(text, place, indent)
    if len(text) > MAX_LENGTH:
        message = f"the formula has {len(text)} characters; at most {MAX_LENGTH} are read"
        raise InputError(Problem("mtl-too-long", message, place))
    formula = _Parser(source).formula()
    if _is_too_deep(formula):
        raise InputError(source.problem("mtl-too-deep", f"the formula is nested deeper than {MAX_DEPTH} levels", 0))
    return formula


@dataclass(eq=False)
class _Group:
    """What is read so far of a formula, or of one in parentheses."""

    prefixes: list[Callable[[mtl.Formula], mtl.Formula]] = field(default_factory=list)
    """What stands before the next operand: `not` and temporal operators."""
    joined: list[mtl.Formula] = field(default_factory=list)
    """Those that `and` joins, of the last alternative."""
    alternatives: list[mtl.Formula] = field(default_factory=list)
    """Those that `or` joins, before the last one, of the last part."""
    parts: list[mtl.Formula] = field(default_factory=list)
    """Those before each `->`."""

    def add(self, operand: mtl.Formula) -> None:
        """Add the next operand."""
        while self.prefixes:
            operand = self.prefixes.pop()(operand)
        self.joined.append(operand)

    def go_on(self, kind: str) -> None:
        """Go on after `and`, `or` or `->`."""
        if kind == "AND":
            return
        self.alternatives.append(self.joined[0] if len(self.joined) == 1 else mtl.And(tuple(self.joined)))
        self.joined = []
        if kind == "IMPLIES":
            several = len(self.alternatives) > 1
            self.parts.append(mtl.Or(tuple(self.alternatives)) if several else self.alternatives[0])
            self.alternatives = []

    def end(self) -> mtl.Formula:
        """The whole formula."""
        self.go_on("IMPLIES")
        formula = self.parts.pop()
        while self.parts:
            formula = mtl.Implies(self.parts.pop(), formula)
        return formula


class _Parser:
    """Reads a formula from its first character to the last, without recursion: no input exhausts the stack."""

    def __init__(self, source: SourceText) -> None:
        self._source = source
        self._offset = 0
        self._before: _Token | None = None

    def formula(self) -> mtl.Formula:
        """The formula of the text. Raises InputError."""
        groups = [_Group()]
        while True:
            token = self._take(*_BEGINS)
            match token.kind:
                case "NOT":
                    groups[-1].prefixes.append(mtl.Not)
                case "ALWAYS" | "EVENTUALLY":
                    groups[-1].prefixes.append(self._temporal(token))
                case "LPAR":
                    groups.append(_Group())
                case _:
                    after = self._operand(token, groups)
                    if after.kind == "END":
                        return groups[0].end()
                    groups[-1].go_on(after.kind)

    def _operand(self, name: _Token, groups: list[_Group]) -> _Token:
        """Read a predicate and the parentheses that end after it; the token after these, which is none of both."""
        after = self._take("LPAR", *self._joints(groups))
        arguments: list[str] = []
        if after.kind == "LPAR":
            while after.kind != "RPAR":
                arguments.append(self._take("NAME").text)
                after = self._take("COMMA", "RPAR")
            after = self._take(*self._joints(groups))
        groups[-1].add(mtl.Predicate(name.text, tuple(arguments) or None, self._origin(name)))
        while after.kind == "RPAR":
            inner = groups.pop().end()
            groups[-1].add(inner)
            after = self._take(*self._joints(groups))
        return after

    @staticmethod
    def _joints(groups: Sequence[_Group]) -> tuple[str, ...]:
        """What may follow an operand."""
        return "AND", "OR", "IMPLIES", "RPAR" if len(groups) > 1 else "END"

    def _temporal(self, operator: _Token) -> Callable[[mtl.Formula], mtl.Formula]:
        """Read the interval of an operator; makes the formula of its operand."""
        self._take("LSQB")
        start = self._instant("COMMA")
        interval, origin = mtl.Interval(start, self._instant("RSQB")), self._origin(operator)
        made = mtl.Always if operator.kind == "ALWAYS" else mtl.Eventually
        return lambda operand: made(interval, operand, origin)

    def _instant(self, end: str) -> mtl.Instant:
        """Read an instant, and what ends it."""
        first = self._take("NUMBER", "NAME")
        origin = self._origin(first)
        if first.kind == "NUMBER":
            self._take(end)
            return mtl.Instant(offset=self._seconds(first), origin=origin)
        self._take("DOT")
        edge = self._take("EDGE").text
        sign, seconds = self._take("SIGN", end), 0.0
        if sign.kind == "SIGN":
            seconds = self._seconds(self._take("NUMBER")) * (1.0 if sign.text == "+" else -1.0)
            self._take(end)
        return mtl.Instant(first.text, edge, seconds, origin)

    def _seconds(self, number: _Token) -> float:
        seconds = float(number.text)
        if not math.isfinite(seconds):
            message = f"`{number.text}` is too large for a time in seconds"
            raise InputError(self._source.problem("mtl-number", message, number.offset))
        return seconds

    def _origin(self, token: _Token) -> TextOrigin:
        return TextOrigin(self._source, token.offset)

    def _take(self, *kinds: str) -> _Token:
        """The next token, which must be of one of these kinds; where it can be of several, it is."""
        space = _SPACE.match(self._source.text, self._offset)
        at = space.end() if space else self._offset
        for kind in (*kinds, *_KINDS):
            found = _KINDS[kind].pattern.match(self._source.text, at)
            if found is not None:
                break
        else:
            message = f"unexpected character {character_name(self._source.text[at])}"
            raise InputError(self._source.problem("mtl-syntax", message, at))
        token = _Token(kind, found[0], at)
        if kind not in kinds:
            raise InputError(self._unexpected(token, kinds))
        self._offset, self._before = found.end(), token
        return token

    def _unexpected(self, token: _Token, kinds: Sequence[str]) -> Problem:
        """The problem of a token that is of none of the kinds that could be there."""
        if token.kind == "END" and "RPAR" in kinds:
            kinds = ("RPAR",)
        expected = [kind.words for name, kind in _KINDS.items() if name in kinds]
        listed = " or ".join([", ".join(expected[:-1]), expected[-1]] if len(expected) > 1 else expected)
        problem, before = self._source.problem, self._before
        if token.kind == "END":
            end = len(self._source.text.rstrip())
            found = "the formula ends too early" if end else "the formula is empty"
            return problem("mtl-syntax", f"{found}; expected {listed}", end)
        if token.kind == "LSQB" and before is not None and before.kind == "NAME":
            hint = nearest(before.text, ["always", "eventually", "G", "F"])
            advice = f"did you mean `{hint}`?" if hint else "expected `always` or `eventually`"
            message = f"`{before.text}` is no temporal operator but has an interval; {advice}"
            return problem("mtl-syntax", message, before.offset)
        keywords = [keyword for name, keyword in _KEYWORDS.items() if name in kinds]
        hint = nearest(token.text, keywords) if token.kind == "NAME" else None
        advice = f"did you mean `{hint}`?" if hint else f"expected {listed}"
        return problem("mtl-syntax", f"unexpected `{token.text}`; {advice}", token.offset)


def _is_too_deep(formula: mtl.Formula) -> bool:
    level = [formula]
    for _ in range(MAX_DEPTH):
        level = [part for one in level for part in mtl.children(one)]
    return bool(level)
