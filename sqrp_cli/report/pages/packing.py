"""Documents as text that a page carries: small, and unable to become markup."""

from __future__ import annotations

import base64
import json
import unicodedata
import zlib
from typing import Any

from sqrp_cli.report.documents.document import plain

DIGITS = 6
"""Decimals that figures keep: micrometres and microseconds."""


def packed(document: object) -> str:
    """A document as base64 of deflated JSON, with `tidy` strings."""
    text = json.dumps(tidy(document), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def tidy(value: Any) -> Any:  # noqa: ANN401 # a record, or a JSON value of any kind
    """A record as a JSON value with figures rounded to `DIGITS`, and with strings that nothing can hide in."""
    match value:
        case bool() | int() | None:
            return value
        case float():
            return round(value, DIGITS)
        case str():
            return visible(value)
        case list() | tuple():
            return [tidy(entry) for entry in value]
        case _:
            return {visible(key): tidy(entry) for key, entry in plain(value).items()}


def visible(text: str) -> str:
    """A text with control and format characters spelled out, such as marks that turn the direction of writing."""
    return "".join(
        f"\\u{{{ord(character):x}}}" if unicodedata.category(character) in _UNSEEN else character for character in text
    )


_UNSEEN = ("Cc", "Cf", "Co", "Cs", "Zl", "Zp")
"""Unicode's categories of characters that change a line without being seen in it."""
