"""Validation of a YAML document against a Pydantic model; every error becomes a problem with its place."""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import SequenceMatcher
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sqrp_cli.errors import InputError, Problem, nearest
from sqrp_cli.files.source import KeyPath, SourceDocument, describe

Model = TypeVar("Model", bound=BaseModel)
_SPELLING = 0.85  # likeness from which a key is taken for a misspelt one: `image_width` and `image_height` have 0.7
_QUOTED = re.compile(r"`(\w+)`")

_EXPECTED = {
    "string": "text",
    "string_too_short": "text that is not empty",
    "string_pattern_mismatch": "a name of letters, digits, `_` and `-` that starts with a letter",
    "int": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "float": "a number",
    "bool": "`true` or `false`",
    "list": "a list",
    "tuple": "a list",
    "dict": "a mapping of names to entries",
    "model": "a mapping",
    "too_short": "a list with at least {min_length} item(s)",
    "too_long": "at most {max_length} entries",
    "greater_than": "a value above {gt:g}",
    "greater_than_equal": "a value of at least {ge:g}",
    "less_than": "a value below {lt:g}",
    "less_than_equal": "a value of at most {le:g}",
}
"""By Pydantic's kind of error, or how it begins."""
EXAMPLES = {"rate": "30 Hz", "type": "part"}  # of keys that are often left out


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
    # The part of the error's location that leads to a value of the document, and the last key that does not. Locations
    # also hold union tags (here always `<...>`) and marks such as `[key]`, which are not in the document.
    path: KeyPath = ()
    absent, data = "", document.data
    for step in details["loc"]:
        listed = isinstance(data, list) and isinstance(step, int) and step < len(data)
        if listed or (isinstance(data, dict) and step in data):
            path, data = (*path, step), data[step]  # type: ignore[index]
        elif isinstance(step, str) and not step.startswith(("<", "[")):
            absent = step
    given, context, kind = details["input"], details.get("ctx", {}), details["type"]
    or_mapping = " or a mapping" if "<else>" in details["loc"] else ""
    if kind == "unknown-key":
        return [
            Problem("unknown-key", f"`{document.name((*path, key))}` is no known key; {expected}",
                    document.key_place((*path, key)))
            for key, expected in context["keys"].items()
        ]  # fmt: skip
    if kind == "missing":
        owner = f"`{document.name(path)}`" if path else "the file"
        example = f", such as `{absent}: {EXAMPLES[absent]}`" if absent in EXAMPLES else ""
        lack = f"the key `{absent}`{example}" if absent else f"entry {details['loc'][-1]} (the first is 0)"
        return [Problem("missing-key", f"{owner} lacks {lack}{misspelt(absent, given)}", document.key_place(path))]
    code, message = kind.replace("_", "-"), details["msg"].removeprefix("Value error, ")
    if kind == "no-mapping":
        keys = ", ".join(f"`{key}`" for key in context["keys"])
        code, message = "wrong-type", f"found {describe(given)}, expected a mapping with {keys}"
        if isinstance(given, str) and "task" in context["keys"]:  # as on the command line
            message += f"; did you mean `{{task: {describe(given)[1:-1]}}}`?"
    elif kind == "literal_error":
        words = [word.strip("' ") for word in str(context["expected"]).replace(" or ", ",").split(",") if word.strip()]
        known = ", ".join(f"`{word}`" for word in words)
        close = nearest(given, words) if isinstance(given, str) and len(words) > 1 else None
        message = f"found {describe(given)}, expected {'one of ' if len(words) > 1 else ''}{known}"
        code, message = "wrong-value", message + (f"; did you mean `{close}`?" if close else "") + or_mapping
    elif (expected := _EXPECTED.get(kind) or _EXPECTED.get(kind.partition("_")[0])) is not None:
        code = "wrong-type" if kind.endswith(("_type", "_parsing")) else "wrong-value"
        found = f"{len(given):,} entries" if kind == "too_long" else describe(given)
        message = f"found {found}, expected {expected.format(**context)}{or_mapping}"
        if details["loc"][-1:] == ("[key]",):  # an error in a key itself, which has another place than its value
            return [replace(document.problem(code, path, message), place=document.key_place(path))]
    elif kind == "ambiguous-entry" and isinstance(given, dict):
        # The keys found where exactly one of those in the message was expected.
        wanted = _QUOTED.findall(message)
        pairs = [(SequenceMatcher(None, key, other).ratio(), key, other) for key in given for other in wanted]
        likeness, key, other = max(pairs, default=(0.0, "", ""))
        if chosen := [f"`{key}`" for key in given if key in wanted]:
            message += f"; found {' and '.join(chosen)}"
        elif likeness > 0.6:
            message += f"; found `{key}`, did you mean `{other}`?"
    elif kind == "value_error":
        code = "wrong-value"
    return [document.problem(code, path, message)]


def misspelt(absent: str, given: object) -> str:
    """Which key of a mapping, where any may stand, is probably meant to be an absent one."""
    keys = [key for key in given if isinstance(key, str)] if isinstance(given, dict) else []
    close = next((key for key in keys if SequenceMatcher(None, key, absent).ratio() > _SPELLING), None)
    return "" if close is None else f"; did you mean it by `{close}`?"
