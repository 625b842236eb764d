"""YAML with positions."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import with_values
from sqrp_cli.files.yaml_file import parse_yaml, read_yaml
from tests.cells import refused

FILE = Path("some.yaml")


def read(text: str) -> SourceDocument:
    return parse_yaml(FILE, text.encode())


@pytest.mark.parametrize(("text", "value"), [
        ("1e-3", 0.001), ("1E3", 1000.0), ("-.5", -0.5), ("7.", 7.0), ("+4", 4), ("010", 10), ("0.0", 0.0),
        ("1_000", "1_000"), ("1:30", "1:30"), ("2026-11-20", "2026-11-20"), ("true", True), ("False", False),
        ("yes", "yes"), ("no", "no"), ("on", "on"), ("off", "off"), ("y", "y"), ("null", None), ("~", None), ("", None),
        ("'1'", "1"), ('"true"', "true"), ("5 cm", "5 cm"), ("0x10", "0x10"), ("=", "="),
])  # fmt: skip
def test_scalars_follow_yaml_1_2(text: str, value: object) -> None:
    found = read(f"a: {text}\n").data["a"]
    assert found == value
    assert type(found) is type(value)


def test_keys_are_text_whatever_they_look_like() -> None:
    assert read("on: 1\nno: 2\n3: 4\ntrue: 5\nnull: 6\n").data == {"on": 1, "no": 2, "3": 4, "true": 5, "null": 6}


def test_every_key_and_value_has_its_place() -> None:
    document = read("a:\n  b: [10, 'twenty']\n  c: {d: 1}\nlong: |\n\n   first\n   second\n")
    places = {path: (place.line, place.column) for path, place in document.places.items()}
    assert places["a"] == (1, 1)
    assert places["a.b"] == (2, 3)
    assert places["a.b.1"] == (2, 11)

    def value_at(*path: str | int) -> tuple[int | None, int | None]:
        place = document.value_place(path)
        return place.line, place.column

    assert value_at("a", "b", 0) == (2, 7)
    assert value_at("a", "b", 1) == (2, 12)  # behind the quote
    assert value_at("long") == (6, 4)  # where the text of the block starts
    assert value_at("a", "b", 7, "missing") == (2, 3)  # the nearest key around it


def test_an_alias_repeats_a_value_and_a_merge_key_its_keys() -> None:
    document = read("base: &base {near: 1, far: 2}\none: {<<: *base, far: 3}\nother: *base\n")
    assert document.data["one"] == {"far": 3, "near": 1}
    assert document.data["other"] == {"near": 1, "far": 2}
    assert document.value_place(("one", "near")).line == 1


def test_a_byte_order_mark_is_ignored_and_a_missing_file_named_with_its_nearest_neighbour(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert read_yaml(path).data == {"a": 1}
    assert "no such file or folder; did you mean `camera.yaml`" in refused(read_yaml, tmp_path / "camra.yaml").message
    assert "found a folder" in refused(read_yaml, tmp_path).message


PRINTED = st.characters(codec="utf-8", exclude_categories=("Cc", "Cs"), exclude_characters="\u2028\u2029\ufeff")
NUMBERS = st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False)
KEYS = st.text("abc<on ", min_size=1, max_size=4)
plain = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(PRINTED, max_size=12),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=12,
)


@given(st.dictionaries(st.sampled_from(["a", "b", "on", "no"]), plain, min_size=1))
def test_what_another_program_writes_is_read_back(data):
    assert parse_yaml(FILE, yaml.safe_dump(data, allow_unicode=True).encode()).data == data


@given(st.binary(max_size=60) | st.text("ab:-[]{}&*!|>'\"%@`#,? \t\n", max_size=60).map(str.encode))
def test_no_bytes_raise_anything_but_an_input_error(content: bytes) -> None:
    problems: tuple[Problem, ...] = ()
    try:
        parse_yaml(FILE, content)
    except InputError as error:
        problems = error.problems
    assert all(problem.place is not None and problem.place.file == FILE for problem in problems)


ROOT = Path(__file__).parents[2]
SHIPPED = [*sorted(ROOT.glob("skills/*/*.yaml")), *sorted(ROOT.glob("workspaces/*/*.yaml"))]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_both_parsers_find_the_same_values_in_the_same_places(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fast = read_yaml(path)
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    slow = read_yaml(path)
    assert fast.data == slow.data
    assert (fast.keys, fast.values) == (slow.keys, slow.values)


@pytest.mark.parametrize("value", [r'"\UFFFFFFFF"', r'"\U00110000"', '"a"\n%YAML ' + "9" * 5000 + ".1"])
def test_a_character_that_there_is_not_is_refused_where_it_stands(value: str) -> None:
    problem = refused(read, f"a: 1\nb: {value}\n")
    assert problem.code == "yaml-syntax"
    assert problem.place.line in (2, 3)


def changed(text: str, **values: str) -> str:
    dotted = {path.replace("__", "."): value for path, value in values.items()}
    return with_values(read(text), dotted).decode()


def test_only_the_named_values_change() -> None:
    text = "a: {b: [1, 2 cm, x]}  # why\nc: 'quoted'\n"
    assert changed(text, a__b__1="3 cm", c="plain") == "a: {b: [1, 3 cm, x]}  # why\nc: plain\n"


def test_every_value_of_a_workspace_can_be_changed_alone() -> None:
    path = ROOT / "workspaces" / "tabletop" / "workspace.yaml"
    document = read_yaml(path)
    for name in list(document.leaves)[::15]:
        assert parse_yaml(path, with_values(document, {name: "42"})).leaves == {**document.leaves, name: 42}


@pytest.mark.parametrize("path", ["c.a", "a.b.7"])
def test_a_path_without_a_value_is_refused_with_the_nearest(path: str) -> None:
    assert "no value" in refused(with_values, read("a: {b: [1, 2]}"), {path: "3"}).message


def test_a_value_that_an_anchor_shares_is_refused() -> None:
    text = "first: &same {rate: 10}\nsecond: *same\nthird: {<<: *same, far: 1}\n"
    assert "would also change" in refused(changed, text, first__rate="20").message
    assert changed(text, third__far="2") == text.replace("far: 1", "far: 2")
