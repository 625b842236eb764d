"""Text from files and command lines made fit to be shown: it can neither act nor look like another line."""

from __future__ import annotations

import re

REPLACEMENT = "?"
"""Stands for what cannot be shown, as it does for what the encoding of a terminal does not know."""

_COMMAND = re.compile(r"^(\s*):(?=:)|#(?=#[A-Za-z]*\[)")
"""What CI servers obey in a log: `::error::` at the beginning of a line, `##[error]` and `##vso[...]` anywhere."""


def one_line(text: str) -> str:
    """A text in which every character can be seen.

    Control characters, line breaks, marks that turn the direction of writing, characters without width and halves of
    characters, as in paths that are not UTF-8, become `REPLACEMENT`.
    """
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else REPLACEMENT for character in text)


def harmless(line: str) -> str:
    """A line as it may stand in the log of a CI server: of the same length, and no command to the server."""
    return _COMMAND.sub(lambda found: f"{found[1] or ''}{REPLACEMENT}", line)
