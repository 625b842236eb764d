"""What a run keeps account of where cameras and the processes behind them fail."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.perception.streams import ImageStreams
from sqrp_cli.runtime.record.report import MonitoringLost
from sqrp_cli.runtime.run.faults import FaultKind, FaultTracker, InjectedFault

ATTEMPT = SimpleNamespace(step=SimpleNamespace(formulas=()), undisturbed=True)


def detected(failure: MonitoringLost | None, *faults: tuple[FaultKind, str]) -> list[tuple[str, float | None]]:
    """When each of some injected faults was noticed and acted on [s], by what people read; the robot stops at 2 s."""
    ledger = FaultTracker(MagicMock(spec=SimulatedCell), MagicMock(spec=ImageStreams), MagicMock())
    for kind, camera in faults:
        ledger.inject(InjectedFault(kind, f"{kind}:{camera}@1", 1.0, camera), 1.0, ATTEMPT)
    ledger.stopped(2.0, failure)
    assert all(record.acted == record.detected and record.injected == 1.0 for record in ledger.records)
    assert [(record.name, record.camera) for record in ledger.records] == list(faults)
    return [(record.label, record.detected) for record in ledger.records]


def test_a_fault_of_a_camera_is_noticed_by_what_is_said_of_this_camera() -> None:
    failure = MonitoringLost("cam2 is lost", "camera-loss", ["cam2"])
    found = detected(failure, ("camera-loss", "cam3"), ("camera-loss", "cam2"))
    assert found == [("camera-loss cam3", None), ("camera-loss cam2", 2.0)]


def test_a_fault_of_a_camera_is_not_noticed_by_another_one_of_the_same_camera() -> None:
    failure = MonitoringLost("cam2 is frozen", "frozen", ["cam2"])
    assert detected(failure, ("latency", "cam2"), ("frozen", "cam2")) == [("latency cam2", None), ("frozen cam2", 2.0)]


def test_a_process_that_ends_is_noticed_for_all_its_cameras() -> None:
    failure = MonitoringLost("the process has ended", "perception-crash", ("cam1", "cam3"))
    found = detected(failure, *(("perception-crash", camera) for camera in ("cam1", "cam2", "cam3")))
    assert [t for _, t in found] == [2.0, None, 2.0]


@pytest.mark.parametrize("kind", ["camera-loss", "frozen", "latency", "perception-crash"])
def test_no_fault_of_a_camera_is_noticed_where_the_robot_stops_for_another_reason(kind: FaultKind) -> None:
    assert detected(None, (kind, "cam1")) == [(f"{kind} cam1", None)]


def test_a_fault_keeps_what_was_injected_beside_the_name_that_the_skill_has_for_it() -> None:
    ledger = FaultTracker(MagicMock(spec=SimulatedCell), MagicMock(spec=ImageStreams), MagicMock())
    named = SimpleNamespace(step=SimpleNamespace(formulas=(SimpleNamespace(fault="slip"),)), undisturbed=True)
    ledger.inject(InjectedFault("miss-pick", "miss-pick"), 0.05, named)
    (record,) = ledger.records
    assert (record.name, record.kind, record.label) == ("slip", "miss-pick", "miss-pick (slip)")
