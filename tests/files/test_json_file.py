"""JSON from others: whatever is wrong with it is told with its line and key, and nothing of it overflows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.files.json_file import json_document, parse_json
from tests.cells import refused

FILE = Path("some.json")
PLAIN = st.none() | st.booleans() | st.integers(-(10**18), 10**18) | st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(exclude_categories=["Cs"]))
JSON = st.recursive(PLAIN | TEXT, lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner), max_leaves=20)


def refusal(text: str, line: int = 1) -> Problem:
    return refused(parse_json, FILE, text, line)


def test_lines_count_from_where_the_text_begins_in_its_file() -> None:
    place = refusal('{"t": NaN}', 17).place
    assert (place.line, place.column) == (17, 7)


def test_brackets_in_text_do_not_count_as_nesting() -> None:
    assert parse_json(FILE, json.dumps(["[" * 1000, '"{' * 1000])) == ["[" * 1000, '"{' * 1000]
    assert parse_json(FILE, "[" * 32 + "]" * 32)


@given(JSON)
def test_every_sound_text_is_read_as_json_reads_it(data: Any) -> None:
    for text in (json.dumps(data), json.dumps(data, ensure_ascii=False, indent=1)):
        assert parse_json(FILE, text) == data


@given(st.dictionaries(TEXT, JSON, min_size=1))
def test_the_place_of_a_value_is_where_it_stands(data: dict[str, Any]) -> None:
    text = json.dumps(data, indent=1)
    lines = text.split("\n")
    document = json_document(FILE, text, data)
    for path, place in document.values.items():
        value: Any = data
        for key in path:
            value = value[key]
        begins = "{" if isinstance(value, dict) else "[" if isinstance(value, list) else json.dumps(value)
        assert lines[(place.line or 0) - 1][(place.column or 0) - 1 :].startswith(begins)


@given(st.text('[]{}",:\\ \nau0d8e9-+.NIf', max_size=40))
def test_any_text_is_read_or_refused_with_a_place(text: str) -> None:
    try:
        parse_json(FILE, text)
    except InputError as error:
        (problem,) = error.problems
        assert problem.place.line is not None
        assert problem.message != "this is no JSON that is accepted"
