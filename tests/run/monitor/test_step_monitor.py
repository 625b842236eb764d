"""Faults, violations and missing evidence; what an attempt remembers; formulas that are held against the plan."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.monitor.step_monitor import PATIENCE, Alarm, Attempt, against_the_plan
from sqrp_cli.run.perception.detections import Evidence, FusedTruth
from tests.run.steps import FixedNominalStep, formula, step

ALWAYS = {"cam": [(0.0, 10.0)]}
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
SLIP = formula("eventually[2, 6] (not held)", "retry", "slip")
HELD, STAYS = formula("always[1, 9] held", settle=0.5), {"held": [(0, True)]}
AWAY = formula("always[1, 9] (not there)", settle=0.5)


def judge(formulas, changes, seen=None) -> Attempt:
    atoms = {atom: ALWAYS if seen is None else seen.get(atom, ALWAYS) for atom in changes}
    return Attempt(FixedNominalStep(step(formulas, atoms), changes), 0.1)


def first_alarm(found: Attempt, values) -> tuple[float, Alarm] | None:
    """The first alarm when evidence comes every 0.1 s; values: from time to what is known."""
    for t in np.arange(0, 10 + 1e-9, 0.1).round(6):
        if (alarm := found.observe(float(t), values(t))) is not None:
            return float(t), alarm
    return None


@pytest.mark.parametrize(
    ("formulas", "changes", "seen", "values"),
    [
        ([HELD], STAYS, None, lambda _: {"held": T}),
        ([SLIP], {"held": [(0, False), (2, True)]}, None, lambda t: {"held": F if t < 1.95 else T}),
        ([SLIP], {"held": [(0, True), (6, False)]}, None, lambda t: {"held": T if t < 6.05 else F}),
        ([HELD], STAYS, None, lambda t: {"held": F if 4 < t < 4.35 else T}),
        ([AWAY], {"there": [(0, True), (2, False)]}, None, lambda t: {"there": T if t < 2.25 else F}),
        ([HELD], STAYS, {"held": {"cam": [(0.0, 3.0), (8.0, 10.0)]}},
         lambda t: {"held": T if t < 3.05 or t > 7.95 else U}),
    ],
    ids=["all as it should be", "before the interval", "after it by the motion", "it passes in time",
         "a change that the motion brings late", "predicted blindness"],
)  # fmt: skip
def test_what_is_no_fault_raises_no_alarm(formulas, changes, seen, values) -> None:
    assert first_alarm(judge(formulas, changes, seen), values) is None


THERE = formula("eventually[2, 6] (not held and there)", "retry", "slip")
BOTH, HIDDEN = {**STAYS, "there": [(0, False)]}, {"there": {"cam": [(0.0, 3.0), (7.0, 10.0)]}}


@pytest.mark.parametrize(
    ("formulas", "changes", "seen", "values", "at", "kind"),
    [
        ([SLIP], STAYS, None, lambda t: {"held": F if t > 3.95 else T}, 4.0, "fault"),
        ([SLIP], STAYS, {"held": {"cam": [(0.0, 2.0), (7.0, 10.0)]}},
         lambda t: {"held": T if t < 2 else U if t < 6.95 else F}, 7.0, "fault"),
        ([HELD], STAYS, None, lambda t: {"held": F if t > 3.95 else T}, 4.5, "violation"),
        ([HELD, THERE], BOTH, HIDDEN,
         lambda t: {"held": F if t > 3.95 else T, "there": F if t < 3.05 else U if t < 6.95 else T}, 7.0, "fault"),
        ([HELD, THERE], BOTH, HIDDEN,
         lambda t: {"held": F if t > 3.95 else T, "there": F if t < 3.05 else U if t < 6.95 else F}, 7.0, "violation"),
        ([AWAY], {"there": [(0, True), (2, False)]}, None, lambda _: {"there": T}, 2.55, "violation"),
        ([HELD], STAYS, None, lambda t: {"held": T if t < 4.05 else U}, 4.1 + PATIENCE, "blindness"),
    ],
    ids=["at once", "after its interval, as it was unseen", "after the time to settle",
         "a violation waits while a fault may explain it", "that it does not", "a change that does not come", "blind"],
)  # fmt: skip
def test_an_alarm_is_raised_in_time(formulas, changes, seen, values, at: float, kind: str) -> None:
    found = first_alarm(judge(formulas, changes, seen), values)
    assert found is not None
    assert (found[0], found[1].kind) == (pytest.approx(at, abs=0.1 if kind == "blindness" else 0.06), kind)
    assert kind != "fault" or (found[1].name, found[1].response.action) == ("slip", "retry")


@pytest.mark.parametrize(
    ("value", "seen", "kind"),
    [(T, None, None), (F, None, "violation"), (U, None, "blindness"), (U, {"held": {"cam": [(5.0, 9.0)]}}, None)],
)
def test_at_rest_the_cameras_must_see_what_should_be_so(value: Truth, seen, kind: str | None) -> None:
    alarm = judge([formula("always[0, 9] held")], STAYS, seen).at_rest(0.0, {"held": value})
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


PLAN = {"held": [(0.0, False), (5.0, True)], "placed": [(0.0, True), (5.8, False)], "pressed": [(0.0, True)]}
"""Something is picked up at 5 s, and has left its place 0.8 s later; a button is in its place all the time."""


@pytest.mark.parametrize(
    ("text", "fault", "told"),
    [
        ("always[0, 4] (not held and placed)", None, False),
        ("always[5, 10] (held and not placed)", None, False),  # what is lifted leaves its place after a while
        ("always[0, 10] (held or placed)", None, False),
        ("eventually[0, 10] (held)", None, False),
        ("always[6, 9] eventually[0, 1] (not placed)", None, False),
        ("always[0, 4] (not pressed)", None, True),
        ("always[0, 4] (held)", None, True),
        ("always[6, 9] (held and placed)", None, True),
        ("eventually[0, 9] (not pressed)", None, True),
        ("eventually[5, 10] (not held and placed)", "slip", False),
        ("eventually[0, 4] (not placed)", "slip", False),
        ("always[0, 6] (held)", "slip", False),
        ("eventually[0, 10] (held)", "slip", True),
        ("eventually[5, 6] (held)", "slip", True),
        ("always[0, 4] (pressed)", "slip", True),
    ],
)
def test_what_the_plan_never_brings_about_is_told_and_a_fault_that_is_seen_as_planned(
    text: str, fault: str | None, told: bool
) -> None:
    asked = step([formula(text, fault=fault)], {})
    what = "fails" if fault is None else "is true, and so the fault `slip` is seen,"
    expected = [f"`{text}` {what} though all goes as planned"] if told else []
    assert list(against_the_plan(FixedNominalStep(asked, PLAN))) == expected  # type: ignore[arg-type]
