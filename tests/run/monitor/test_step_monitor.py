"""Faults, violations and missing evidence."""

from __future__ import annotations

import numpy as np

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.monitor.step_monitor import PATIENCE, Alarm, StepMonitor
from tests.run.steps import FixedNominalStep, formula, step

ALWAYS = {"cam": [(0.0, 10.0)]}
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN


def judge(formulas, changes, seen=None) -> StepMonitor:
    atoms = dict.fromkeys(changes, ALWAYS if seen is None else seen)
    return StepMonitor(FixedNominalStep(step(formulas, atoms), changes), 0.1)


def first_alarm(found: StepMonitor, values, end: float = 10.0) -> tuple[float, Alarm] | None:
    """The first alarm when evidence comes every 0.1 s; values: from time to what is known."""
    for t in np.arange(0, end + 1e-9, 0.1).round(6):
        alarm = found.observe(float(t), values(t))
        if alarm is not None:
            return float(t), alarm
    return None


def test_what_goes_as_it_should_raises_no_alarm() -> None:
    found = judge([formula("always[1, 9] held")], {"held": [(0, True)]})
    assert first_alarm(found, lambda _: {"held": T}) is None


def test_a_fault_is_seen_at_once() -> None:
    entry = formula("eventually[2, 6] (not held)", "retry", "slip")
    found = judge([entry], {"held": [(0, True)]})
    t, alarm = first_alarm(found, lambda t: {"held": F if t > 3.95 else T})
    assert (t, alarm.kind, alarm.name, alarm.response.action) == (4.0, "fault", "slip", "retry")


def test_a_fault_before_its_interval_is_none() -> None:
    entry = formula("eventually[2, 6] (not held)", "retry", "slip")
    found = judge([entry], {"held": [(0, False), (2, True)]})
    assert first_alarm(found, lambda t: {"held": F if t < 1.95 else T}) is None


def test_a_fault_that_happened_unseen_is_seen_after_its_interval() -> None:
    entry = formula("eventually[2, 6] (not held)", "retry", "slip")
    found = judge([entry], {"held": [(0, True)]}, {"cam": [(0.0, 2.0), (7.0, 10.0)]})
    t, alarm = first_alarm(found, lambda t: {"held": T if t < 2 else U if t < 6.95 else F})
    assert (t, alarm.kind) == (7.0, "fault")


def test_what_the_motion_does_after_the_interval_is_no_fault() -> None:
    entry = formula("eventually[2, 6] (not held)", "retry", "slip")
    found = judge([entry], {"held": [(0, True), (6, False)]})
    assert first_alarm(found, lambda t: {"held": T if t < 6.05 else F}) is None


def test_a_violation_counts_after_the_time_to_settle() -> None:
    found = judge([formula("always[1, 9] held", settle=0.5)], {"held": [(0, True)]})
    t, alarm = first_alarm(found, lambda t: {"held": F if t > 3.95 else T})
    assert alarm.kind == "violation"
    assert abs(t - 4.5) < 1e-6


def test_a_violation_waits_while_the_rest_of_a_fault_is_out_of_sight() -> None:
    formulas = [
        formula("always[1, 9] held", settle=0.5),
        formula("eventually[2, 6] (not held and there)", "retry", "slip"),
    ]
    changes = {"held": [(0, True)], "there": [(0, False)]}
    for there, kind in ((T, "fault"), (F, "violation")):
        entry = step(formulas, {"held": ALWAYS, "there": {"cam": [(0.0, 3.0), (7.0, 10.0)]}})
        found = StepMonitor(FixedNominalStep(entry, changes), 0.1)
        values = lambda t: {"held": F if t > 3.95 else T, "there": F if t < 3.05 else U if t < 6.95 else there}  # noqa: B023, E731
        t, alarm = first_alarm(found, values)
        assert (t, alarm.kind) == (7.0, kind)


def test_a_contradiction_that_passes_in_time_is_no_violation() -> None:
    found = judge([formula("always[1, 9] held", settle=0.5)], {"held": [(0, True)]})
    assert first_alarm(found, lambda t: {"held": F if 4 < t < 4.35 else T}) is None


def test_a_change_that_the_motion_brings_late_is_waited_for() -> None:
    found = judge([formula("always[1, 9] (not there)", settle=0.5)], {"there": [(0, True), (2, False)]})
    assert first_alarm(found, lambda t: {"there": T if t < 2.25 else F}) is None
    found = judge([formula("always[1, 9] (not there)", settle=0.5)], {"there": [(0, True), (2, False)]})
    t, _ = first_alarm(found, lambda _: {"there": T})
    assert 2.45 < t < 2.65


def test_predicted_blindness_alone_raises_no_alarm() -> None:
    found = judge([formula("always[1, 9] held")], {"held": [(0, True)]}, {"cam": [(0.0, 3.0), (8.0, 10.0)]})
    assert first_alarm(found, lambda t: {"held": T if t < 3.05 or t > 7.95 else U}) is None


def test_evidence_that_was_predicted_and_is_missing_raises_an_alarm_in_time() -> None:
    found = judge([formula("always[1, 9] held")], {"held": [(0, True)]})
    t, alarm = first_alarm(found, lambda t: {"held": T if t < 4.05 else U})
    assert alarm.kind == "blindness"
    assert t - 4.1 <= PATIENCE + 1e-6


def test_at_rest_the_cameras_must_see_what_should_be_so() -> None:
    formulas = [formula("always[0, 9] held")]
    assert judge(formulas, {"held": [(0, True)]}).at_rest(0.0, {"held": T}) is None
    assert judge(formulas, {"held": [(0, True)]}).at_rest(0.0, {"held": F}).kind == "violation"
    assert judge(formulas, {"held": [(0, True)]}).at_rest(0.0, {"held": U}).kind == "blindness"
    assert judge(formulas, {"held": [(0, True)]}, {"cam": [(5.0, 9.0)]}).at_rest(0.0, {"held": U}) is None
