"""Documents as text that a page carries: small, and unable to become markup."""

from __future__ import annotations

import base64
import json
import unicodedata
import zlib
from typing import Any

DIGITS = 6
"""Decimals that figures keep: micrometres and microseconds."""


def packed(document: object) -> str:
    """A document as base64 of deflated JSON, with `tidy` strings."""
    text = json.dumps(tidy(document), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def tidy(value: Any) -> Any:  # noqa: ANN401 # a JSON value of any kind
    """A JSON value with figures rounded to `DIGITS`, and with strings that nothing can hide in."""
    match value:
        case bool() | int() | None:
            return value
        case float():
            return round(value, DIGITS)
        case str():
            return visible(value)
        case dict():
            return {visible(key): tidy(entry) for key, entry in value.items()}
        case _:
            return [tidy(entry) for entry in value]


def visible(text: str) -> str:
    """A text with control and format characters spelled out, such as marks that turn the direction of writing."""
    return "".join(
        f"\\u{{{ord(character):x}}}" if unicodedata.category(character) in _UNSEEN else character for character in text
    )


_UNSEEN = ("Cc", "Cf", "Co", "Cs", "Zl", "Zp")
"""Unicode's categories of characters that change a line without being seen in it."""


def without_repetition(study: dict[str, Any]) -> dict[str, Any]:
    """The document of a candidate (`explain --json`) without what follows from the rest of it.

    Corners of boxes follow from the poses of their frames. Objects that never move are in `still` instead of in every
    sample.
    """
    samples = study["samples"]
    first = samples[0]["objects"] if samples else {}
    still = {name: pose for name, pose in first.items() if all(s["objects"][name] == pose for s in samples)}
    return {**study, "still": still, "samples": [_sample(sample, still) for sample in samples]}


def _sample(sample: dict[str, Any], still: dict[str, Any]) -> dict[str, Any]:
    literals = {
        name: {**literal, "boxes": [{"cameras": box["cameras"]} for box in literal["boxes"]]}
        for name, literal in sample["literals"].items()
    }
    objects = {name: pose for name, pose in sample["objects"].items() if name not in still}
    return {**sample, "objects": objects, "literals": literals}
