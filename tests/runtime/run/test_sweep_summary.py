"""How measured delays count against predicted ones."""

from __future__ import annotations

import pytest

from sqrp_cli.runtime.record.report import PROCESSING, FaultRecord, RunReport
from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary

PERIOD = 0.1


def run(delay: float | None, predicted: float | None, happened: float | None = 5.0) -> SweepRun:
    detected = None if delay is None or happened is None else happened + delay
    fault = FaultRecord("slip", 5.0, happened, detected, recovered=20.0, predicted_delay=predicted)
    return SweepRun(5.0, fault, RunReport())


def test_a_delay_is_as_predicted_up_to_the_longest_and_a_step_of_the_physics() -> None:
    off = PERIOD + PROCESSING
    runs = [run(0.15, 0.15), run(0.152, 0.15), run(0.17, 0.15), run(0.3 - off, 0.3), run(0.5, 0.15), run(0.15, 0.5)]
    summary = SweepSummary.of(runs, PERIOD)
    assert summary.tolerance == pytest.approx(off)
    assert (summary.predictable, summary.seen) == (6, 6)
    assert (summary.as_predicted, summary.sooner, summary.later) == (3, 1, 2)
    assert summary.excesses == pytest.approx((0.02, 0.35))


def test_what_cannot_be_predicted_or_did_not_happen_does_not_count_and_what_was_missed_is_not_seen() -> None:
    summary = SweepSummary.of([run(0.1, None), run(None, 0.2, None), run(None, 0.2), run(0.2, 0.2)], PERIOD)
    assert (summary.predictable, summary.seen, summary.as_predicted) == (2, 1, 1)
    assert summary.unpromised == pytest.approx((0.1,))
    assert summary.ends == (20.0,) * 4
