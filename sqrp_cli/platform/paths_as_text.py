"""File names as text: not all are UTF-8, and Python keeps the other bytes as surrogates."""

from __future__ import annotations

import json
import os
from typing import Any


def shown_name(name: str) -> str:
    r"""A file name to show and compare; a byte that is not UTF-8 is spelled out, such as `\xff`."""
    return os.fsencode(name).decode("utf-8", errors="backslashreplace")


def is_utf8(name: object) -> bool:
    """Whether a path is UTF-8; libraries in C take no other."""
    return not any("\ud800" <= character <= "\udfff" for character in str(name))


def json_line(document: Any, indent: int | None = None) -> str:  # noqa: ANN401 # a JSON value of any kind
    r"""A document as JSON, on one line unless `indent` is given. Raises ValueError if a figure is not finite.

    In a path, a byte that is not UTF-8 is written as the escape of a surrogate, 0xff as `\udcff` (as in PEP 383).
    Python's json module reads it back as the same path.
    """
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=indent)
    return text.encode("utf-8", errors="backslashreplace").decode("utf-8")
