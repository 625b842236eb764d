"""Formulas that are held against a step in which all goes as planned."""

from __future__ import annotations

import pytest

from sqrp_cli.run.monitor.step_monitor import against_the_plan
from tests.run.steps import FixedNominalStep, formula, step

PLAN = {"held": [(0.0, False), (5.0, True)], "placed": [(0.0, True), (5.8, False)], "pressed": [(0.0, True)]}
"""Something is picked up at 5 s, and has left its place 0.8 s later; a button is in its place all the time."""


def told(text: str, fault: str | None = None) -> list[str]:
    asked = step([formula(text, fault=fault)], {})
    return list(against_the_plan(FixedNominalStep(asked, PLAN)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "always[0, 4] (not held and placed)",
        "always[5, 10] (held and not placed)",  # what is lifted leaves its place after a while
        "always[0, 10] (held or placed)",
        "eventually[0, 10] (held)",
        "always[6, 9] eventually[0, 1] (not placed)",
    ],
)
def test_what_the_plan_brings_about_is_not_against_it(text: str) -> None:
    assert told(text) == []


@pytest.mark.parametrize(
    "text",
    [
        "always[0, 4] (not pressed)",
        "always[0, 4] (held)",
        "always[6, 9] (held and placed)",
        "eventually[0, 9] (not pressed)",
    ],
)
def test_what_the_plan_never_brings_about_is_told(text: str) -> None:
    (found,) = told(text)
    assert found == f"`{text}` fails though all goes as planned"


@pytest.mark.parametrize(
    "text", ["eventually[5, 10] (not held and placed)", "eventually[0, 4] (not placed)", "always[0, 6] (held)"]
)
def test_faults_that_the_plan_does_not_show_are_fine(text: str) -> None:
    assert told(text, "slip") == []


@pytest.mark.parametrize("text", ["eventually[0, 10] (held)", "eventually[5, 6] (held)", "always[0, 4] (pressed)"])
def test_a_fault_that_is_seen_as_planned_is_told(text: str) -> None:
    (found,) = told(text, "slip")
    assert found == f"`{text}` is true, and so the fault `slip` is seen, though all goes as planned"
