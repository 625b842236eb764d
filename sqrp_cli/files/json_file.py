"""Reading JSON safely: limited depth, finite numbers, no repeated keys.

A problem names the file, the line, and the key as in `results[3].q_avg`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files.source import Data, KeyPath, SourceDocument, not_finite, too_deep
from sqrp_cli.files.units import as_number

MAX_DEPTH = 32  # deepest nesting of objects and lists
MAX_DIGITS = 20  # most characters of a whole number
LONGEST_NAME = 60  # most characters of a key in messages
_TOKEN = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+"?|[\[\]{},:]|[^\s\[\]{},:"]+', re.DOTALL)
_BRACKET = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+"?|[\[{]|[\]}]', re.DOTALL)
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


def json_name(path: KeyPath) -> str:
    """How messages name a key: `results[3].q_avg`, or `tasks["pickup green"]`."""
    named = ""
    for key in path:
        short = str(key) if len(str(key)) <= LONGEST_NAME else f"{str(key)[:LONGEST_NAME]}..."
        named += f"[{key}]" if isinstance(key, int) else f".{short}" if _WORD.fullmatch(short) else f'["{short}"]'
    return named.removeprefix(".")


def parse_json(path: Path, text: str, line: int = 1) -> Any:  # noqa: ANN401 - JSON holds anything
    """The value of a JSON text; path, line: of its beginning, for problems.

    Raises InputError, with line and column, for a text that is not JSON, nests deeper than `MAX_DEPTH`, has a number
    that is not finite or longer than `MAX_DIGITS`, or repeats a key. Lone surrogates are kept: file names that are not
    UTF-8 have them.
    """

    def unique(pairs: list[tuple[str, Any]]) -> Data:
        if len(data := dict(pairs)) < len(pairs):
            raise ValueError
        return data

    def number(text: str) -> float:
        whole = text.lstrip("-").isdigit()
        if whole and len(text) > MAX_DIGITS:
            raise ValueError
        if not math.isfinite(value := int(text) if whole else float(text)):
            raise ValueError
        return value

    try:
        if text.count("[") + text.count("{") > MAX_DEPTH:
            depth = 0
            for bracket in _BRACKET.finditer(text):
                depth += (bracket[0] in "[{") - (bracket[0] in "]}")
                if depth > MAX_DEPTH:
                    raise ValueError
        return json.loads(text, object_pairs_hook=unique, parse_float=number, parse_int=number, parse_constant=number)
    except json.JSONDecodeError as error:
        message = f"this is no JSON: {error.msg[:1].lower()}{error.msg[1:].removesuffix(' at')}"
        raise bad_input("json-syntax", message, Place(path, line + error.lineno - 1, error.colno)) from None
    except ValueError:
        raise InputError(_not_accepted(path, text, line)) from None


def json_document(path: Path, text: str, data: Data) -> SourceDocument:
    """A parsed JSON text with the place of every key and value, to report problems in it."""
    keys: dict[KeyPath, Place] = {}
    values: dict[KeyPath, Place] = {}
    for _, at, is_key, place in _tokens(path, text, 1):
        (keys if is_key else values)[at] = place
        if not is_key:
            keys.setdefault(at, place)
    return SourceDocument(path, text.encode(), data, keys, values, named=json_name)


def _tokens(path: Path, text: str, line: int) -> Iterator[tuple[str, KeyPath, bool, Place]]:
    """The keys and values of a JSON text, in order; up to the damage if it is damaged.

    Of each: its text, or its beginning, the path to it, whether it is a key, and its place.
    """
    keys: list[str | int | None] = []  # in each list the index, in each object the key, None before it
    begin, done = 0, 0
    for match in _TOKEN.finditer(text):
        sign, start = match[0], match.start()
        line += text.count("\n", done, start)
        begin = text.rfind("\n", done, start) + 1 or begin
        done = start
        place = Place(path, line, start - begin + 1)
        if sign == "," and keys:
            last = keys[-1]
            keys[-1] = last + 1 if isinstance(last, int) else None
        elif sign in "]}":
            del keys[-1:]
        elif sign not in ":,":
            if is_key := bool(keys) and keys[-1] is None:
                try:
                    keys[-1] = str(json.loads(sign))
                except ValueError:
                    keys[-1] = sign
            yield sign, tuple(key for key in keys if key is not None), is_key, place
            if not is_key and sign in "[{":
                keys.append(0 if sign == "[" else None)


def _not_accepted(path: Path, text: str, line: int) -> Problem:
    """The first key or value that is not accepted."""
    seen: set[KeyPath] = set()
    for found, at, is_key, place in _tokens(path, text, line):
        if len(at) >= MAX_DEPTH and found in "[{":
            return too_deep(place, MAX_DEPTH)
        name = json_name(at)
        if is_key and at in seen:
            return Problem("duplicate-key", f"`{name}`: this key is given twice", place)
        if is_key:
            seen.add(at)
        if found.startswith('"'):
            continue
        unsigned = found.lstrip("-")
        if unsigned.isdigit() and len(found) > MAX_DIGITS:
            message = f"found a number of {len(found):,} digits, expected at most {MAX_DIGITS}"
            return Problem("not-finite", f"`{name}`: {message}" if name else message, place)
        endless = unsigned[:1].isdigit() and not unsigned.isdigit() and math.isinf(as_number(found))
        if endless or unsigned in ("NaN", "Infinity"):
            return not_finite(place, found, name)
    return Problem("json-syntax", "this is no JSON that is accepted", Place(path, line))
