"""Numbers that are possible and cannot be meant, one case after the other from tests/cases/unusual_values.yaml."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Problem
from sqrp_cli.files.source import KeyPath
from sqrp_cli.files.units import read_quantity
from sqrp_cli.files.usual_values import CALIBRATION, HAND_EYE, SKILL, WORKSPACE, Usual, rows_that_apply
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.show.documents.schemas import schema_of
from sqrp_cli.starter.make import make_starter
from tests.cells import read_cases
from tests.random_cell import Crowd, random_cell

ROOT = Path(__file__).parents[2]
CASES = read_cases("unusual_values.yaml")
EVERY_FIELD = ROOT / "tests" / "cases" / "every_field"
NEW_CODES = {
    "unusual-value", "doubtful-unit", "doubtful-projection", "principal-point-outside", "unusual-focal-lengths",
    "detector-out-of-range", "threshold-out-of-reach", "empty-box",
}  # fmt: skip


def findings(folder: Path) -> list[Problem]:
    workspace = load_workspace(folder)
    return [problem for problem in (*workspace.warnings, *lint(workspace)) if problem.code != "assumed-limit"]


@pytest.mark.parametrize("case", CASES, ids=[case["case"] for case in CASES])
def test_what_cannot_be_meant_is_reported_where_it_stands(case, damaged, position_of):
    cell = damaged(case)
    found = [problem for problem in findings(cell) if problem.code not in case.get("also", ())]
    assert [problem.code for problem in found] == [case.get("code", "unusual-value")] * case.get("times_told", 1)
    problem = found[0]
    assert problem.severity == case.get("severity", "warning")
    assert problem.place.file == cell / case.get("in", case["file"])
    if "at" in case:
        assert (problem.place.line, problem.place.column) == position_of(case["at"], problem.place.file)
    for piece in case.get("says", []):
        assert str(piece) in problem.message
    assert problem.mend
    assert case.get("mend", "") in problem.mend


def test_the_undamaged_cell_has_no_such_findings(cell: Path) -> None:
    assert findings(cell) == []


SHIPPED = sorted(path.parent for path in (ROOT / "workspaces").glob("*/workspace.yaml"))


@pytest.mark.parametrize("source", [*SHIPPED, None, Crowd(2, 60, 24)], ids=lambda one: getattr(one, "name", str(one)))
def test_no_cell_that_is_shipped_or_that_init_makes_is_warned_of(source: Path | Crowd | None, tmp_path: Path) -> None:
    folder = source if isinstance(source, Path) else tmp_path / "cell"
    if source is None:
        make_starter(folder, None)
    elif isinstance(source, Crowd):
        random_cell(folder, source)
    assert not NEW_CODES & {problem.code for problem in findings(folder)}


def test_ranges_are_in_order_and_say_why() -> None:
    for row in (*WORKSPACE, *SKILL, *CALIBRATION, *HAND_EYE):
        assert row.least < row.most, row
        assert len(row.why) > 5, row


BOUNDED_ENOUGH = {
    *("up", "quaternion", "normal", "direction"),  # directions, whose length does not matter or is checked
    *("coefficients", "fx", "fy", "cx", "cy"),  # of a lens, checked together
    *("id", "marker", "symmetry", "cameras", "count", "along", "across", "yaw", "turn", "tilt", "velocity_scaling",
      "acceleration_scaling", "angle_tolerance", "beam"),  # whose bounds are the usual ones
    *("home", "fingers"),  # positions of joints, checked against their limits
    "curve",  # learned from frames
}  # fmt: skip
"""Numbers that need no row: what is possible is also usual, or another finding tells of them."""


@pytest.mark.parametrize(("file", "rows"), [("workspace.yaml", WORKSPACE), ("skill.yaml", SKILL)])
def test_every_number_of_a_file_has_a_usual_range_or_a_reason_for_none(file: str, rows: tuple[Usual, ...]) -> None:
    document = read_yaml(EVERY_FIELD / file)
    known = set(rows_that_apply(document, rows))

    def without_row(value: object, path: KeyPath = ()) -> list[KeyPath]:
        if isinstance(value, dict | list):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            return [found for key, inner in items for found in without_row(inner, (*path, key))]
        return [path] if read_quantity(value) is not None and path not in known else []

    assert [path for path in without_row(document.data) if not BOUNDED_ENOUGH & set(map(str, path))] == []


def entries(schema: dict[str, Any], nodes: list[Any]) -> list[dict[str, Any]]:
    """What nodes of a JSON Schema may be, references and alternatives resolved."""
    found = []
    for node in nodes:
        if not isinstance(node, dict):
            continue
        named = [schema["$defs"][node["$ref"].rsplit("/")[-1]]] if "$ref" in node else []
        others = named + node.get("anyOf", []) + node.get("oneOf", [])
        found += entries(schema, others) if others else [node]
    return found


def below(node: dict[str, Any], step: str) -> list[Any]:
    """What a node of a JSON Schema says of a key, or with `*` of every key and item."""
    if not step.startswith("*"):
        return [node.get("properties", {}).get(step)]
    named = node.get("patternProperties", {}).values()
    return [node.get("additionalProperties"), node.get("items"), *named, *node.get("prefixItems", ())]


@pytest.mark.parametrize(("name", "rows"), [("workspace", WORKSPACE), ("skill", SKILL)])
def test_every_row_is_about_a_field_of_the_schema(name: str, rows: tuple[Usual, ...]) -> None:
    schema = schema_of(name)
    unknown = []
    for row in rows:
        nodes = entries(schema, [schema])
        for step in row.at.split("."):
            nodes = entries(schema, [inner for node in nodes for inner in below(node, step)])
        if not nodes:
            unknown.append(row.at)
    assert unknown == []


@pytest.mark.parametrize("name", ["workspace", "skill"])
def test_the_schema_states_what_each_quantity_can_be(name: str) -> None:
    def plain_numbers(node: Any) -> Iterator[dict[str, Any]]:
        if isinstance(node, dict):
            if node.get("type") in ("number", "integer"):
                yield node
            node = list(node.values())
        for inner in node if isinstance(node, list) else ():
            yield from plain_numbers(inner)

    numbers = list(plain_numbers(schema_of(name)))
    assert len(numbers) > 10
    bounds = ({"minimum", "exclusiveMinimum"}, {"maximum"})
    assert [number for number in numbers if not all(bound & number.keys() for bound in bounds)] == []
