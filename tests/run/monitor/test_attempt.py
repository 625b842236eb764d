"""What an attempt at a step remembers of what images showed."""

from __future__ import annotations

import pytest

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.monitor.step_monitor import Attempt, PredictionCheck, StepMonitor
from sqrp_cli.run.perception.detections import Evidence, FusedTruth
from tests.run.steps import FixedNominalStep, formula, step

START, TIME = 5.0, 2.0
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN


def attempt() -> Attempt:
    """One that begins at 5 s and takes 2 s; `held` is asked about throughout, `placed` in its first second."""
    asked = [formula("always[0, 2] (held)"), formula("always[0, 1] (placed)")]
    nominal = FixedNominalStep(
        step(asked, {"held": {}, "placed": {}}, TIME), {"held": [(0.0, True)], "placed": [(0.0, True)]}
    )
    check = PredictionCheck(0, nominal, [])  # type: ignore[arg-type]
    return Attempt(nominal.step, nominal, StepMonitor(nominal, 0.1), check, True, START)  # type: ignore[arg-type]


def evidence(t: float, values: dict[str, Truth], *, complete: bool = True) -> Evidence:
    atoms = {atom: FusedTruth(v, {}, False) for atom, v in values.items()}
    return Evidence(t, t - START, {}, {}, atoms, complete)


@pytest.mark.parametrize(
    ("shown", "unseen"),
    [
        ({}, {"held": None}),
        ({5.5: T, 6.0: U}, {"held": 5.5}),
        ({5.5: T, 6.9: F}, {"held": 6.9}),
        ({5.5: T, 7.0: T}, {}),
        ({5.5: T, 7.0: U, 7.1: F}, {}),
    ],
)
def test_what_is_asked_at_the_end_is_unseen_if_no_image_from_then_on_shows_it(
    shown: dict[float, Truth], unseen: dict[str, float | None]
) -> None:
    found = attempt()
    for t, value in shown.items():
        found.note(evidence(t, {"held": value, "placed": U}))
    assert found.unseen == unseen


def test_evidence_during_the_motion_are_remembered_once_they_are_complete() -> None:
    found = attempt()
    looks = [evidence(5.5, {"held": T}), evidence(6.5, {"held": T}, complete=False)]
    assert list(found.alarms(looks)) == []
    assert found.unseen == {"held": 5.5}
