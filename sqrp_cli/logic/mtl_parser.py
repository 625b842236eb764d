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
from collections.abc import Callable
from typing import NamedTuple

from sqrp_cli.errors import InputError, Place, bad_input, nearest
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import SourceText, TextOrigin, character_name

MAX_DEPTH = 50
"""Deepest nesting of a formula."""

MAX_LENGTH = 20_000
"""Most characters of a formula."""

# A word ends where no name goes on. No keyword is a name. A hyphen belongs to a name only between letters or digits, so
# that `a->b` is an implication.
_WORD_ENDS, _SPACE = r"(?!-?[A-Za-z0-9_])", re.compile(r"[ \t\f\r\n]*")
_TERMINALS = {
    kind: (words, re.compile(pattern))
    for kind, words, pattern in (
        ("always", "`always`", rf"(?:always|G){_WORD_ENDS}|□"),
        ("eventually", "`eventually`", rf"(?:eventually|F){_WORD_ENDS}|◇"),
        ("not", "`not`", rf"not{_WORD_ENDS}|!|¬"),
        ("and", "`and`", rf"and{_WORD_ENDS}|&&?|∧"),
        ("or", "`or`", rf"or{_WORD_ENDS}|\|\|?|∨"),
        ("implies", "`->`", rf"implies{_WORD_ENDS}|->|→"),
        ("edge", "`start` or `end`", r"(?:start|end)(?![A-Za-z0-9_])"),
        ("sign", "`+`, `-`", "[-+−]"),
        ("number", "a number of seconds", r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"),
        (
            "name", "a name",
            rf"(?!(?:always|eventually|not|and|or|implies|G|F){_WORD_ENDS})[A-Za-z_][A-Za-z0-9_]*(?:-[A-Za-z0-9_]+)*",
        ),
        ("(", "`(`", r"\("), (")", "`)`", r"\)"), ("[", "`[`", r"\["), ("]", "`]`", r"\]"), (",", "`,`", ","),
        (".", "`.`", r"\."), ("end", "the end of the formula", r"\Z"),
    )
}  # fmt: skip
"""What formulas are written in, and its names in messages, in the order of their listing."""

_BEGINNINGS: tuple[str, ...] = ("always", "eventually", "not", "name", "(")
_JOINTS = ("and", "or", "implies")
_BINDING = {"implies": 0, "or": 1, "and": 2, "prefix": 3}
"""How tightly operators bind."""


def parse_formula(text: str, place: Place, indent: int = 0) -> mtl.Formula:
    """Reads a formula of the language described above.

    place: where the text starts. indent: columns before every further line of the text in the file that are not part of
    it. Raises InputError with line, column and an excerpt of the text. `check_formula` checks the names.
    """
    source = SourceText(text, place, indent)
    if len(text) > MAX_LENGTH:
        raise bad_input("mtl-too-long", f"the formula has {len(text)} characters; at most {MAX_LENGTH} are read", place)
    formula = _Reader(source).formula()
    level: tuple[mtl.Formula, ...] = (formula,)
    depth = 1
    while level := tuple(part for one in level for part in mtl.children(one)):
        if (depth := depth + 1) > MAX_DEPTH:
            raise InputError(source.problem("mtl-too-deep", f"the formula is nested deeper than {MAX_DEPTH} levels", 0))
    return formula


class _Token(NamedTuple):
    kind: str
    text: str
    start: int


class _Reader:
    """Reads a text from left to right, its operators by how tightly they bind."""

    def __init__(self, source: SourceText) -> None:
        self._source, self._at = source, 0
        self._before: _Token | None = None

    def formula(self) -> mtl.Formula:
        """The whole text. What waits for its right side lies on stacks, so that parentheses may be nested at will."""
        formulas: list[mtl.Formula] = []
        waiting: list[tuple[str, Callable[[mtl.Formula], mtl.Formula]]] = []
        opened, kinds = 0, _BEGINNINGS
        while True:
            token = self._next(*kinds)
            if token.kind in ("not", "always", "eventually"):
                waiting.append(("prefix", mtl.Not if token.kind == "not" else self._temporal(token)))
            elif token.kind == "(":
                waiting.append(("(", mtl.Not))
                opened += 1
            elif token.kind == "name":
                names = [self._next("name").text] if self._found("(") is not None else []
                while names and self._next(",", ")").kind == ",":
                    names.append(self._next("name").text)
                arguments = tuple(names) or None
                formulas.append(mtl.Predicate(token.text, arguments, TextOrigin(self._source, token.start)))
                kinds = (*_JOINTS, ")" if opened else "end", *(("(",) if arguments is None else ()))
            else:  # what binds more tightly is put together, up to the last open parenthesis
                binding = _BINDING.get(token.kind, -1)
                while waiting and _BINDING.get(waiting[-1][0], -2) > binding:
                    kind, prefixed = waiting.pop()
                    if kind == "prefix":
                        formulas[-1] = prefixed(formulas[-1])
                    elif kind == "implies":
                        formulas[-2:] = [mtl.Implies(*formulas[-2:])]
                    else:
                        count = 2
                        while waiting and waiting[-1][0] == kind:
                            waiting.pop()
                            count += 1
                        formulas[-count:] = [(mtl.And if kind == "and" else mtl.Or)(tuple(formulas[-count:]))]
                if token.kind == "end":
                    return formulas[0]
                if token.kind == ")":
                    waiting.pop()
                    opened -= 1
                    kinds = (*_JOINTS, ")" if opened else "end")
                else:
                    waiting.append((token.kind, mtl.Not))
                    kinds = _BEGINNINGS

    def _temporal(self, operator: _Token) -> Callable[[mtl.Formula], mtl.Formula]:
        self._next("[")
        start = self._instant(",")
        interval = mtl.Interval(start, self._instant("]"))
        kind = mtl.Always if operator.kind == "always" else mtl.Eventually
        return lambda operand: kind(interval, operand, TextOrigin(self._source, operator.start))

    def _instant(self, until: str) -> mtl.Instant:
        """An instant and the sign after it."""
        first = self._next("number", "name")
        origin = TextOrigin(self._source, first.start)
        if first.kind == "number":
            self._next(until)
            return mtl.Instant(offset=self._seconds(first), origin=origin)
        self._next(".")
        edge, seconds = self._next("edge"), 0.0
        if (sign := self._next("sign", until)).kind == "sign":
            seconds = self._seconds(self._next("number")) * (1 if sign.text == "+" else -1)
            self._next(until)
        return mtl.Instant(first.text, edge.text, seconds, origin)

    def _seconds(self, number: _Token) -> float:
        if not math.isfinite(seconds := float(number.text)):
            message = f"`{number.text}` is too large for a time in seconds"
            raise InputError(self._source.problem("mtl-number", message, number.start))
        return seconds

    def _found(self, *kinds: str) -> _Token | None:
        """The next token, if it is of one of these kinds."""
        text, start = self._source.text, _SPACE.match(self._source.text, self._at).end()  # type: ignore[union-attr]
        for kind in kinds:
            if (found := _TERMINALS[kind][1].match(text, start)) is not None:
                self._at, self._before = found.end(), _Token(kind, found[0], start)
                return self._before
        return None

    def _next(self, *kinds: str) -> _Token:
        """As `_found`. Raises InputError, which says what is there instead."""
        before, token = self._before, self._found(*kinds)
        if token is not None:
            return token
        expected = [words for kind, (words, _) in _TERMINALS.items() if kind in kinds]
        listed = " or ".join([", ".join(expected[:-1]), expected[-1]] if len(expected) > 1 else expected)
        token, text = self._found(*_TERMINALS), self._source.text
        if token is None:
            offset = _SPACE.match(text, self._at).end()  # type: ignore[union-attr]
            raise self._wrong(f"unexpected character {character_name(text[offset])}", offset)
        if token.kind == "end":
            end = len(text.rstrip())
            raise self._wrong(
                f"{'the formula ends too early' if end else 'the formula is empty'}; expected {listed}", end
            )
        if token.kind == "[" and before is not None and before.kind == "name":
            hint = nearest(before.text, ["always", "eventually", "G", "F"])
            advice = f"did you mean `{hint}`?" if hint else "expected `always` or `eventually`"
            raise self._wrong(f"`{before.text}` is no temporal operator but has an interval; {advice}", before.start)
        keywords = [kind for kind in kinds if kind in ("always", "eventually", "not", *_JOINTS)]
        hint = nearest(token.text, keywords) if token.kind == "name" else None
        advice = f"did you mean `{hint}`?" if hint else f"expected {listed}"
        raise self._wrong(f"unexpected `{token.text}`; {advice}", token.start)

    def _wrong(self, message: str, offset: int) -> InputError:
        return InputError(self._source.problem("mtl-syntax", message, offset))
