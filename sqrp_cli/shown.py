"""Text from files and command lines made fit to be shown: it can neither act nor look like another line.

File names are text, too: not all are UTF-8, and Python keeps the other bytes as surrogates.
"""

from __future__ import annotations

import json
import os
import re
from typing import Any

REPLACEMENT = "?"  # Stands for what cannot be shown, as it does for what the encoding of a terminal does not know
_COMMAND = re.compile(r"^(\s*):(?=:)|#(?=#[A-Za-z]*\[)")
"""What CI servers obey in a log: `::error::` at the beginning of a line, `##[error]` and `##vso[...]` anywhere."""


def one_line(text: str) -> str:
    """A text that can all be seen: control and format characters and halves of characters become `REPLACEMENT`."""
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else REPLACEMENT for character in text)


def harmless(line: str) -> str:
    """A line as it may stand in the log of a CI server: of the same length, and no command to the server."""
    return _COMMAND.sub(lambda found: f"{found[1] or ''}{REPLACEMENT}", line)


def shown_name(name: str) -> str:
    r"""A file name to show and compare; a byte that is not UTF-8 is spelled out, such as `\xff`."""
    return os.fsencode(name).decode("utf-8", errors="backslashreplace")


def json_line(document: Any, indent: int | None = None) -> str:  # noqa: ANN401 # a JSON value of any kind
    r"""A document as JSON, on one line unless `indent` is given. Raises ValueError if a figure is not finite.

    In a path, a byte that is not UTF-8 is written as the escape of a surrogate, 0xff as `\udcff` (as in PEP 383).
    Python's json module reads it back as the same path.
    """
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=indent)
    return text.encode("utf-8", errors="backslashreplace").decode("utf-8")
