"""Validation of a YAML document against a Pydantic model; every error becomes a problem with its place."""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import SequenceMatcher
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sqrp_cli.errors import InputError, Problem, nearest
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument, describe

Model = TypeVar("Model", bound=BaseModel)

_SPELLING = 0.85
"""Likeness from which a key is taken for a misspelt one: `image_width` and `image_height` have 0.7."""

_QUOTED = re.compile(r"`(\w+)`")

_EXPECTED = {
    "string_type": "text",
    "string_too_short": "text that is not empty",
    "string_pattern_mismatch": "a name of letters, digits, `_` and `-` that starts with a letter",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "`true` or `false`",
    "bool_parsing": "`true` or `false`",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping of names to entries",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "too_short": "a list with at least {min_length} item(s)",
    "too_long": "at most {max_length} entries",
    "greater_than": "a value above {gt:g}",
    "greater_than_equal": "a value of at least {ge:g}",
    "less_than": "a value below {lt:g}",
    "less_than_equal": "a value of at most {le:g}",
}


def validate(document: SourceDocument, model: type[Model]) -> Model:
    """The document as an instance of `model`.

    Raises InputError with one problem for each error: its place, the key's dotted path, what was found and what was
    expected.
    """
    try:
        return model.model_validate(document.data)
    except ValidationError as error:
        raise InputError(*problems_of(document, error)) from error


def problems_of(document: SourceDocument, error: ValidationError) -> list[Problem]:
    """Pydantic's errors as problems of the document, in order of place."""
    problems = [problem for details in error.errors() for problem in _problems(document, details)]
    return sorted(problems, key=lambda problem: problem.position)


def _problems(document: SourceDocument, details: ErrorDetails) -> list[Problem]:
    path, absent = _path_in(document.data, details["loc"])
    given, context, kind = details["input"], details.get("ctx", {}), details["type"]
    or_mapping = " or a mapping" if "<else>" in details["loc"] else ""
    if kind == "unknown-key":
        return [_unknown_key(document, (*path, key), expected) for key, expected in context["keys"].items()]
    if kind == "missing":
        owner = f"`{document.name(path)}`" if path else "the file"
        lack = f"the key `{absent}`" if absent else f"entry {details['loc'][-1]} (the first is 0)"
        return [Problem("missing-key", f"{owner} lacks {lack}{misspelt(absent, given)}", document.key_place(path))]
    if kind == "no-mapping":
        keys = ", ".join(f"`{key}`" for key in context["keys"])
        return [document.problem("wrong-type", path, f"found {describe(given)}, expected a mapping with {keys}")]
    if kind == "literal_error":
        return [document.problem("wrong-value", path, _wrong_word(given, str(context["expected"])) + or_mapping)]
    if kind in _EXPECTED:
        return [_unexpected(document, path, details, _EXPECTED[kind].format(**context) + or_mapping)]
    if kind == "ambiguous-entry" and isinstance(given, dict):
        return [document.problem(kind, path, details["msg"] + _found_instead(list(given), details["msg"]))]
    code = "wrong-value" if kind == "value_error" else kind.replace("_", "-")
    return [document.problem(code, path, details["msg"].removeprefix("Value error, "))]


def misspelt(absent: str, given: object) -> str:
    """Which key of a mapping, where any may stand, is probably meant to be an absent one."""
    keys = [key for key in given if isinstance(key, str)] if isinstance(given, dict) else []
    close = next((key for key in keys if SequenceMatcher(None, key, absent).ratio() > _SPELLING), None)
    return "" if close is None else f"; did you mean it by `{close}`?"


def _unknown_key(document: SourceDocument, path: KeyPath, expected: str) -> Problem:
    return Problem("unknown-key", f"`{document.name(path)}` is no known key; {expected}", document.key_place(path))


def _unexpected(document: SourceDocument, path: KeyPath, details: ErrorDetails, expected: str) -> Problem:
    """A value of another type or range than expected."""
    kind, given = details["type"], details["input"]
    code = "wrong-type" if kind.endswith(("_type", "_parsing")) else "wrong-value"
    found = f"{len(given):,} entries" if kind == "too_long" else describe(given)
    problem = document.problem(code, path, f"found {found}, expected {expected}")
    # Pydantic marks errors in a key itself, which has another place than its value.
    return replace(problem, place=document.key_place(path)) if details["loc"][-1:] == ("[key]",) else problem


def _found_instead(found: list[str], message: str) -> str:
    """The keys found where exactly one of those in a message was expected."""
    wanted = _QUOTED.findall(message)
    chosen = [key for key in found if key in wanted]
    if chosen:
        return f"; found {' and '.join(f'`{key}`' for key in chosen)}"
    pairs = [(SequenceMatcher(None, key, other).ratio(), key, other) for key in found for other in wanted]
    likeness, key, other = max(pairs, default=(0.0, "", ""))
    return f"; found `{key}`, did you mean `{other}`?" if likeness > 0.6 else ""


def _wrong_word(found: object, expected: str) -> str:
    words = [word.strip("' ") for word in expected.replace(" or ", ",").split(",") if word.strip()]
    listed = ", ".join(f"`{word}`" for word in words)
    close = nearest(found, words) if isinstance(found, str) and len(words) > 1 else None
    expected = f"one of {listed}" if len(words) > 1 else listed
    return f"found {describe(found)}, expected {expected}" + (f"; did you mean `{close}`?" if close else "")


def _path_in(data: object, location: tuple[int | str, ...]) -> tuple[KeyPath, str]:
    """The part of a Pydantic error's location that leads to a value of the document, and the last key that does not.

    Locations also hold union tags (here always `<...>`) and marks such as `[key]`, which are not in the document.
    """
    path: KeyPath = ()
    absent = ""
    for step in location:
        in_mapping = isinstance(data, dict) and step in data
        in_list = isinstance(data, list) and isinstance(step, int) and step < len(data)
        if in_mapping or in_list:
            data = data[step]  # type: ignore[index]
            path = (*path, step)
        elif isinstance(step, str) and not step.startswith(("<", "[")):
            absent = step
    return path, absent
