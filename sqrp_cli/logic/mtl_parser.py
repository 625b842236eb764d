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
from typing import cast

from sqrp_cli.errors import InputError, Place, bad_input, nearest
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import SourceText, character_name
from sqrp_cli.records import dataclass

MAX_DEPTH = 50  # Deepest nesting of a formula
MAX_LENGTH = 20_000  # Most characters of a formula

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


_Token = tuple[str, str, int]  # What is read at a time: its kind, its text, and where that starts


@dataclass
class _Reader:
    """Reads a text from left to right, its operators by how tightly they bind."""

    source: SourceText
    at: int = 0
    before: _Token | None = None

    def formula(self) -> mtl.Formula:
        """The whole text. What waits for its right side lies on stacks, so that parentheses may be nested at will."""
        formulas: list[mtl.Formula] = []
        waiting: list[mtl.Operation | None] = []  # operators without their parts; None is an open parenthesis
        opened, kinds = 0, _BEGINNINGS
        while True:
            kind, text, start = self._next(*kinds)
            if kind == "(":
                waiting.append(None)
                opened += 1
            elif kind == "name":
                names = [self._next("name")[1]] if self._next("(", optional=True)[0] else []
                while names and self._next(",", ")")[0] == ",":
                    names.append(self._next("name")[1])
                formulas.append(mtl.Predicate(text, tuple(names) or None, (self.source, start)))
                kinds = (*_JOINTS, ")" if opened else "end", *(("(",) if not names else ()))
            elif kind in ("always", "eventually"):
                self._next("[")
                interval = mtl.Interval(self._instant(","), self._instant("]"))
                waiting.append(mtl.Operation(cast(mtl.Operator, kind), (), interval, (self.source, start)))
            elif kind == "not":
                waiting.append(mtl.Operation("not", ()))
            else:  # what binds more tightly is put together, up to the last open parenthesis
                binding = mtl.BINDING.get(kind, -1)
                while waiting and (last := waiting[-1]) is not None and mtl.BINDING[last.operator] > binding:
                    count = 2 if last.operator in _JOINTS else 1
                    waiting.pop()
                    while last.operator in ("and", "or") and waiting and waiting[-1] == last:
                        waiting.pop()
                        count += 1
                    formulas[-count:] = [replace(last, parts=tuple(formulas[-count:]))]
                if kind == "end":
                    return formulas[0]
                if kind == ")":
                    waiting.pop()
                    opened -= 1
                    kinds = (*_JOINTS, ")" if opened else "end")
                else:
                    waiting.append(mtl.Operation(cast(mtl.Operator, kind), ()))
                    kinds = _BEGINNINGS

    def _instant(self, until: str) -> mtl.Instant:
        """An instant and the sign after it."""
        kind, text, start = self._next("number", "name")
        number, place, sign, primitive, edge = text, start, 1, None, None
        if kind == "name":
            self._next(".")
            primitive, edge = text, self._next("edge")[1]
            kind, text, _ = self._next("sign", until)
            if kind == until:
                return mtl.Instant(primitive, edge, 0.0, (self.source, start))
            sign = 1 if text == "+" else -1
            _, number, place = self._next("number")
        if not math.isfinite(seconds := sign * float(number)):
            message = f"`{number}` is too large for a time in seconds"
            raise InputError(self.source.problem("mtl-number", message, place))
        self._next(until)
        return mtl.Instant(primitive, edge, seconds, (self.source, start))

    def _next(self, *kinds: str, optional: bool = False) -> _Token:
        """The next token, if it is of one of these kinds. Raises InputError, which says what is there instead.

        optional: whether another one, or none, is to be left as it is; it has no kind.
        """
        source, before = self.source, self.before
        start = _SPACE.match(source.text, self.at).end()  # type: ignore[union-attr]
        for kind in kinds:
            if (found := _TERMINALS[kind][1].match(source.text, start)) is not None:
                self.at, self.before = found.end(), (kind, found[0], start)
                return self.before
        if optional:
            return "", "", start
        expected = [words for kind, (words, _) in _TERMINALS.items() if kind in kinds]
        listed = " or ".join([", ".join(expected[:-1]), expected[-1]] if len(expected) > 1 else expected)
        kind, text, offset = self._next(*_TERMINALS, optional=True)
        if not kind:
            message = f"unexpected character {character_name(source.text[offset])}"
        elif kind == "end":
            offset = len(source.text.rstrip())
            message = f"{'the formula ends too early' if offset else 'the formula is empty'}; expected {listed}"
        elif kind == "[" and before is not None and before[0] == "name":
            _, name, offset = before
            hint = nearest(name, ["always", "eventually", "G", "F"])
            advice = f"did you mean `{hint}`?" if hint else "expected `always` or `eventually`"
            message = f"`{name}` is no temporal operator but has an interval; {advice}"
        else:
            keywords = [one for one in kinds if one in mtl.BINDING]
            hint = nearest(text, keywords) if kind == "name" else None
            message = f"unexpected `{text}`; {f'did you mean `{hint}`?' if hint else f'expected {listed}'}"
        raise InputError(source.problem("mtl-syntax", message, offset))
