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
from dataclasses import replace
from typing import NamedTuple, cast

from sqrp_cli.errors import InputError, Place, bad_input, nearest
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import SourceText, character_name

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
    while level := tuple(part for one in level for part in one.parts):
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
        waiting: list[mtl.Operation | None] = []  # operators without their parts; None is an open parenthesis
        opened, kinds = 0, _BEGINNINGS
        while True:
            token = self._next(*kinds)
            if token.kind == "(":
                waiting.append(None)
                opened += 1
            elif token.kind == "name":
                names = [self._next("name").text] if self._found("(") is not None else []
                while names and self._next(",", ")").kind == ",":
                    names.append(self._next("name").text)
                formulas.append(mtl.Predicate(token.text, tuple(names) or None, (self._source, token.start)))
                kinds = (*_JOINTS, ")" if opened else "end", *(("(",) if not names else ()))
            elif token.kind in ("always", "eventually"):
                self._next("[")
                interval = mtl.Interval(self._instant(","), self._instant("]"))
                origin = (self._source, token.start)
                waiting.append(mtl.Operation(cast(mtl.Operator, token.kind), (), interval, origin))
            elif token.kind == "not":
                waiting.append(mtl.Operation("not", ()))
            else:  # what binds more tightly is put together, up to the last open parenthesis
                binding = mtl.BINDING.get(token.kind, -1)
                while waiting and (last := waiting[-1]) is not None and mtl.BINDING[last.operator] > binding:
                    count = 2 if last.operator in _JOINTS else 1
                    waiting.pop()
                    while last.operator in ("and", "or") and waiting and waiting[-1] == last:
                        waiting.pop()
                        count += 1
                    formulas[-count:] = [replace(last, parts=tuple(formulas[-count:]))]
                if token.kind == "end":
                    return formulas[0]
                if token.kind == ")":
                    waiting.pop()
                    opened -= 1
                    kinds = (*_JOINTS, ")" if opened else "end")
                else:
                    waiting.append(mtl.Operation(cast(mtl.Operator, token.kind), ()))
                    kinds = _BEGINNINGS

    def _instant(self, until: str) -> mtl.Instant:
        """An instant and the sign after it."""
        first = self._next("number", "name")
        number, sign, primitive, edge = first, 1, None, None
        if first.kind == "name":
            self._next(".")
            primitive, edge = first.text, self._next("edge").text
            found = self._next("sign", until)
            if found.kind == until:
                return mtl.Instant(primitive, edge, 0.0, (self._source, first.start))
            number, sign = self._next("number"), 1 if found.text == "+" else -1
        if not math.isfinite(seconds := sign * float(number.text)):
            message = f"`{number.text}` is too large for a time in seconds"
            raise InputError(self._source.problem("mtl-number", message, number.start))
        self._next(until)
        return mtl.Instant(primitive, edge, seconds, (self._source, first.start))

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
            message = f"unexpected character {character_name(text[offset])}"
        elif token.kind == "end":
            offset = len(text.rstrip())
            message = f"{'the formula ends too early' if offset else 'the formula is empty'}; expected {listed}"
        elif token.kind == "[" and before is not None and before.kind == "name":
            hint, offset = nearest(before.text, ["always", "eventually", "G", "F"]), before.start
            advice = f"did you mean `{hint}`?" if hint else "expected `always` or `eventually`"
            message = f"`{before.text}` is no temporal operator but has an interval; {advice}"
        else:
            keywords = [kind for kind in kinds if kind in mtl.BINDING]
            hint, offset = nearest(token.text, keywords) if token.kind == "name" else None, token.start
            message = f"unexpected `{token.text}`; {f'did you mean `{hint}`?' if hint else f'expected {listed}'}"
        raise InputError(self._source.problem("mtl-syntax", message, offset))
