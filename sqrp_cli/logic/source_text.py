"""Text that is parsed, and positions and excerpts in it."""

from __future__ import annotations

import unicodedata
from typing import TypeAlias

from sqrp_cli.errors import Place, Problem
from sqrp_cli.records import dataclass

LONGEST = 160  # Characters of a line that an excerpt shows whole
_UNSEEN = ("Cc", "Cf", "Cn", "Co", "Cs", "Zl", "Zp", "Zs")
"""Unicode's categories of characters that are invisible or look like others."""


def is_unseen(character: str) -> bool:
    """Whether a character is a control or format character, an unassigned one, or a space other than the blank."""
    return character != " " and unicodedata.category(character) in _UNSEEN


def character_name(character: str) -> str:
    """A character in a message: itself, or its code and name if it is invisible."""
    if not is_unseen(character):
        return f"`{character}`"
    return " ".join(filter(None, (f"U+{ord(character):04X}", unicodedata.name(character, ""))))


@dataclass(frozen=True)
class SourceText:
    """A text with the place of its first character in a file."""

    text: str
    place: Place
    indent: int = 0
    """Columns in the file before every line but the first that are not part of `text`.

    As for the value of an indented YAML block.
    """

    def place_at(self, offset: int) -> Place:
        """The place in the file of the character at `offset`."""
        before = self.text[:offset]
        column = offset - (before.rfind("\n") + 1) + 1
        lines_before = before.count("\n")
        shift = self.indent if lines_before else (self.place.column or 1) - 1
        return Place(self.place.file, (self.place.line or 1) + lines_before, column + shift)

    def problem(self, code: str, message: str, offset: int, mend: str | None = None) -> Problem:
        """An error at the character at `offset`, with the line that holds it and a caret under it as the excerpt.

        Of a long line, the part around it. Invisible characters are shown as `\N{REPLACEMENT CHARACTER}`.
        """
        start = self.text.rfind("\n", 0, offset) + 1
        line = self.text[start:].split("\n", 1)[0].rstrip()
        if len(line) > LONGEST:
            start = max(start, offset - LONGEST // 2)
            line = self.text[start : offset + LONGEST // 2].split("\n", 1)[0].rstrip()
        before = "".join("\t" if character == "\t" else " " for character in self.text[start:offset])
        seen = "".join("\N{REPLACEMENT CHARACTER}" if is_unseen(c) and c != "\t" else c for c in line)
        return Problem(code, message, self.place_at(offset), mend=mend, excerpt=f"{seen}\n{before}^")


TextOrigin: TypeAlias = tuple[SourceText, int]  # A source text, and the offset in it of a parsed part's first character
