"""The lint: cases of tests/cases/lint.yaml one after the other, and those of lint_fine.yaml that it leaves alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.files.units import shown_length
from tests.cells import read_cases

CASES, FINE = read_cases("lint.yaml"), read_cases("lint_fine.yaml")
Damage = Callable[[dict[str, Any]], Path]


@pytest.mark.parametrize("case", CASES, ids=[case["case"] for case in CASES])
def test_finding_is_reported_once_with_place_and_remedy(
    case: dict[str, Any], damaged: Damage, position_of: Callable[[str, Path], tuple[int, int]]
) -> None:
    findings = lint(load_workspace(damaged(case)))
    assert [finding.code for finding in findings] == [case["code"]]
    (finding,) = findings
    assert finding.severity == case.get("severity", "error")
    assert finding.place is not None
    assert finding.place.line is not None
    if "at" in case:
        assert (finding.place.line, finding.place.column) == position_of(case["at"], finding.place.file)
    for piece in case.get("says", []):
        assert str(piece) in finding.message
    assert finding.mend
    assert "\n" not in finding.mend
    assert case.get("mend", "") in finding.mend


def test_the_undamaged_cell_has_no_findings(cell: Path) -> None:
    assert lint(load_workspace(cell)) == ()


@pytest.mark.parametrize("case", FINE, ids=[case["case"] for case in FINE])
def test_what_is_no_mistake_is_left_alone(case: dict[str, Any], damaged: Damage) -> None:
    codes = [finding.code for finding in lint(load_workspace(damaged(case)))]
    assert case["not"] not in codes if "not" in case else not codes


def test_objects_that_overlap_for_another_reason_are_still_named_beside_a_doubted_size(damaged: Damage) -> None:
    edit = {"blue, size: [4 cm": "blue, size: [40", "position: [0.4, 0, 2 cm]": "position: [0.7, -0.2, 1 mm]"}
    findings = lint(load_workspace(damaged({"file": "workspace.yaml", "replace": edit})))
    messages = [finding.message for finding in findings]
    assert any("`red`" in message and "deep in each other" in message for message in messages)
    assert not any("`blue`" in message and "deep in each other" in message for message in messages)


@pytest.mark.parametrize(
    ("value", "shown"), [(0.01998, "20.0 mm"), (0.9, "900.0 mm"), (279.335, "279.3 m"), (1, "1 m")]
)
def test_lengths_are_shown_in_millimetres_below_a_metre_and_in_metres_above(value: float, shown: str) -> None:
    assert shown_length(value) == shown


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        ("plumb_bob", [-0.41, 0.19, 0.001, 0.0002, -0.04]),  # a webcam
        ("rational_polynomial", [8.2, 4.9, 0.0, 0.0, 0.2, 8.5, 7.6, 1.3]),  # a wide lens
        ("equidistant", [-0.02, 0.003, -0.002, 0.0003]),  # a fisheye
        ("plumb_bob", [0.09, -0.27, -0.0006, -0.0011, 0.1]),  # a depth camera
        ("plumb_bob", [0.26, -0.92, 0.002, 0.0006, 1.16]),  # another, with a lens that bends out
        ("plumb_bob", [-0.05, 0.06, -0.0003, -0.0157, 0.0]),  # a sensor that was mounted askew
        ("rational_polynomial", [0.5158, -2.6649, 0.0006, -0.0003, 1.5525, 0.3965, -2.4878, 1.4793]),
        ("rational_polynomial", [0.0, 0.0, 0.0, -0.001, 0.0, 0.0, 0.0, 0.0]),
    ],
)
@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("focal", [150, 300, 1200])
def test_lenses_as_calibrations_find_them_are_plausible(
    model: str, coefficients: list[float], signs: tuple[int, int], focal: int, damaged: Damage
) -> None:
    """Tangential terms, the third and fourth coefficient, of both signs."""
    if model != "equidistant":
        coefficients = [*coefficients[:2], signs[0] * coefficients[2], signs[1] * coefficients[3], *coefficients[4:]]
    edit = {"fx: 300": f"fx: {focal}, distortion: {{model: {model}, coefficients: {coefficients}}}"}
    found = lint(load_workspace(damaged({"file": "workspace.yaml", "replace": edit})))
    assert [problem for problem in found if problem.code == "implausible-lens"] == []
