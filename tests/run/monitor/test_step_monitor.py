"""Faults, violations and missing evidence; what an attempt remembers; formulas that are held against the plan."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.monitor.step_monitor import Attempt, against_the_plan
from sqrp_cli.run.perception.detections import Evidence, FusedTruth
from tests.cells import read_cases
from tests.run.steps import FixedNominalStep, formula, step

CASES = read_cases("alarms.yaml")
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
VALUES = {"T": T, "F": F, "U": U}


def planned(changes: dict[str, dict[float, str]]) -> dict[str, list[tuple[float, bool]]]:
    return {atom: [(t, word == "T") for t, word in since.items()] for atom, since in changes.items()}


def judge(formulas, changes: dict[str, dict[float, str]], seen: dict[str, list]) -> Attempt:
    atoms = {atom: {"cam": seen.get(atom, [(0.0, 10.0)])} for atom in changes}
    return Attempt(FixedNominalStep(step(formulas, atoms), planned(changes)), 0.1)


@pytest.mark.parametrize("what", CASES["alarms"])
def test_an_alarm_is_raised_in_time_and_for_nothing_else(what: str) -> None:
    """Evidence comes every 0.1 s."""
    case = {"seen": {}, "alarm": None, "at": None, **CASES["alarms"][what]}
    asked = [CASES["formulas"][name] for name in case["formulas"]]
    formulas = [formula(one["text"], "retry" if "fault" in one else "stop", one.get("fault")) for one in asked]
    found, attempt = None, judge(formulas, case["planned"], case["seen"])
    for t in np.arange(0, 10 + 1e-9, 0.1).round(6).tolist():
        shown = {atom: [word for s, word in since.items() if s <= t][-1] for atom, since in case["shown"].items()}
        if (found := attempt.observe(t, {atom: VALUES[word] for atom, word in shown.items()})) is not None:
            break
    assert (None if found is None else found.kind) == case["alarm"]
    if found is not None:
        assert t == pytest.approx(case["at"], abs=0.1 if found.kind == "blindness" else 0.06)
        assert found.kind != "fault" or (found.name, found.response.action) == ("slip", "retry")


@pytest.mark.parametrize(
    ("value", "seen", "kind"),
    [(T, {}, None), (F, {}, "violation"), (U, {}, "blindness"), (U, {"held": [(5.0, 9.0)]}, None)],
)
def test_at_rest_the_cameras_must_see_what_should_be_so(value: Truth, seen, kind: str | None) -> None:
    alarm = judge([formula("always[0, 9] held")], {"held": {0: "T"}}, seen).at_rest(0.0, {"held": value})
    assert (None if alarm is None else alarm.kind) == kind


START, TIME = 5.0, 2.0


@pytest.fixture
def attempt() -> Attempt:
    """One that begins at 5 s and takes 2 s; `held` is asked about throughout, `placed` in its first second."""
    asked = [formula("always[0, 2] (held)"), formula("always[0, 1] (placed)")]
    changes = {"held": [(0.0, True)], "placed": [(0.0, True)]}
    nominal = FixedNominalStep(step(asked, {"held": {}, "placed": {}}, TIME), changes)
    return Attempt(nominal, 0.1, start=START)  # type: ignore[arg-type]


def evidence(t: float, value: Truth, *, complete: bool = True) -> Evidence:
    atoms = {atom: FusedTruth(shown, {}, False) for atom, shown in (("held", value), ("placed", U))}
    return Evidence(t, t - START, {}, {}, atoms, complete)


@pytest.mark.parametrize(
    ("shown", "unseen"),
    [({}, {"held": None}), ({5.5: T, 6.0: U}, {"held": 5.5}), ({5.5: T, 6.9: F}, {"held": 6.9}),
     ({5.5: T, 7.0: T}, {}), ({5.5: T, 7.0: U, 7.1: F}, {})],
)  # fmt: skip
def test_what_is_asked_at_the_end_is_unseen_if_no_image_from_then_on_shows_it(
    attempt: Attempt, shown: dict[float, Truth], unseen: dict[str, float | None]
) -> None:
    for t, value in shown.items():
        attempt.note(evidence(t, value))
    assert attempt.unseen == unseen


def test_evidence_during_the_motion_is_remembered_once_it_is_complete(attempt: Attempt) -> None:
    assert list(attempt.alarms([evidence(5.5, T), evidence(6.5, T, complete=False)])) == []
    assert attempt.unseen == {"held": 5.5}


@pytest.mark.parametrize(("text", "fault", "told"), CASES["against_the_plan"])
def test_what_the_plan_never_brings_about_is_told_and_a_fault_that_is_seen_as_planned(
    text: str, fault: str | None, told: bool
) -> None:
    nominal = FixedNominalStep(step([formula(text, fault=fault)], {}), planned(CASES["plan"]))
    what = "fails" if fault is None else "is true, and so the fault `slip` is seen,"
    expected = [f"`{text}` {what} though all goes as planned"] if told else []
    assert list(against_the_plan(nominal)) == expected  # type: ignore[arg-type]
