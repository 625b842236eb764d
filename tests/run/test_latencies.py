"""Cameras that are late by different times: what is known of a moment, and when a fault counts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.lockstep import EvidenceCollector
from sqrp_cli.run.monitor.step_monitor import PATIENCE, Alarm, Attempt
from sqrp_cli.run.perception.detections import BoxDetection, Detection
from sqrp_cli.run.perception.streams import ImageStreams
from sqrp_cli.run.record.events import Event, EventPublisher
from tests.run.steps import FixedNominalStep, formula, step

TOTAL, START = 2.0, 0.5
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
SHOWN = {T: Truth.TRUE, F: Truth.FALSE, U: Truth.UNKNOWN}
SLIP = formula(f"eventually[{START}, {TOTAL}] (not held)", "retry", "slip")
Vote = Callable[[str, float], Truth]
"""What the image of a camera, taken at a time [s], shows of `held`."""


class Looker:
    """Stands for the cell and for the processes that look at images: each shows `held` as it is told to."""

    def __init__(self, vote: Vote) -> None:
        self._vote = vote
        self._waiting: dict[str, list[float]] = {}
        self.t = 0.0

    def measured_joints(self, _t: float) -> Mapping[str, float]:
        return {}

    def frames(self, names: list[str]) -> Mapping[str, CameraImage]:
        return {name: CameraImage(name, self.t, np.zeros(1)) for name in names}

    def watch(self, sought: object) -> None:
        pass

    def submit(self, frame: CameraImage, believed: object) -> None:
        assert believed is not None
        self._waiting.setdefault(frame.camera, []).append(frame.t)

    def collect(self, camera: str) -> Detection:
        t = self._waiting[camera].pop(0)
        shown = BoxDetection("box", SHOWN[self._vote(camera, t)], 1.0, np.zeros((0, 2)))
        return Detection(camera, t, False, {"held": (shown,)})


class Still(FixedNominalStep):
    def object_poses(self, t: float) -> Mapping[str, object]:
        assert t >= 0.0
        return {}


def watched(cameras, vote: Vote, needed: int = 1, formulas=(SLIP,), seen=None, events=None) -> Iterator[tuple]:
    """The alarms of a step, each with its time [s]; cameras: rate [Hz] and latency [s] of each."""
    known = {name: SimpleNamespace(name=name, rate=rate, lag=late) for name, (rate, late) in cameras.items()}
    entry = step(list(formulas), {"held": seen or {}}, TOTAL)
    target = entry.targets["held"].model_copy(update={"cameras": needed})
    nominal = Still(entry.model_copy(update={"targets": {"held": target}}), {"held": [(0, True)]})
    attempt = Attempt(nominal, max(1.0 / camera.rate for camera in known.values()), start=0.0)
    looker = Looker(vote)
    eyes = ImageStreams(known, looker)
    listeners = [] if events is None else [events.append]
    collector = EvidenceCollector(looker, eyes, EventPublisher(listeners))
    collector.watch(attempt, 1, 0.0)
    while (now := eyes.next_event) < TOTAL + 0.5:
        arrived = eyes.collect(now)
        looker.t = now
        collector.expose(now, lambda t: (min(t, TOTAL), {"held": True}, True))
        for alarm in attempt.alarms(collector.take_notice(arrived, now)):
            yield now, alarm


def first(alarms: Iterator[tuple[float, Alarm]]) -> tuple[float, str] | None:
    return next(((round(t, 6), alarm.kind) for t, alarm in alarms), None)


def brute_force(cameras, vote: Vote, needed: int) -> float | None:
    """When a slip is first seen [s]: for each arrival, all that is there by then is looked at from the beginning."""
    taken = {name: [k / rate for k in range(int(rate * (TOTAL + 1)))] for name, (rate, _) in cameras.items()}
    arrivals = sorted({t + cameras[name][1] for name, times in taken.items() for t in times})
    for now in arrivals:
        moments = sorted({t for times in taken.values() for t in times if START <= t <= TOTAL and t <= now})
        there = {name: [t for t in times if t + cameras[name][1] <= now + 1e-9] for name, times in taken.items()}
        last = max(t for times in there.values() for t in [-1.0, *times])
        for moment in (t for t in moments if t <= last):
            votes = []
            for name, (rate, _) in cameras.items():
                newest = max(t for t in taken[name] if t <= moment)
                if newest in there[name] and moment - newest < 1.5 / rate:
                    votes.append(vote(name, newest))
            if votes.count(F) >= needed and votes.count(F) > votes.count(T):
                return round(now, 6)
    return None


@st.composite
def streams(draw: st.DrawFn) -> tuple[dict[str, tuple[float, float]], Vote]:
    names = ["cam1", "cam2", "cam3"][: draw(st.integers(1, 3))]
    late = st.integers(0, 35).map(lambda hundredths: hundredths / 100)
    cameras = {name: (draw(st.sampled_from([10.0, 5.0, 8.0])), draw(late)) for name in names}
    seeds = st.integers(0, 2**32 - 1)
    shown = {name: Random(draw(seeds)).choices([T, U, F], weights=[3, 2, 1], k=30) for name in names}  # noqa: S311
    return cameras, lambda name, t: shown[name][round(t * cameras[name][0]) % 30]


@settings(max_examples=100, deadline=None)
@given(streams(), st.integers(1, 2))
def test_a_fault_is_seen_when_a_brute_force_look_at_all_that_has_arrived_sees_it(found, needed: int) -> None:
    cameras, vote = found
    seen = next((t for t, alarm in watched(cameras, vote, needed) if alarm.kind == "fault"), None)
    assert (None if seen is None else round(seen, 6)) == brute_force(cameras, vote, needed)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.integers(1, 35), min_size=1, max_size=4),
    st.integers(1, 4),
    st.integers(50, 140).map(lambda hundredths: hundredths / 100 + 0.005),
)
def test_a_slip_that_all_cameras_see_counts_when_as_many_images_of_it_as_needed_have_arrived(
    late: list[int], needed: int, x: float
) -> None:
    cameras = {f"cam{i}": (10.0, hundredths / 100) for i, hundredths in enumerate(late)}
    needed = min(needed, len(cameras))
    seen = {name: [(0.0, TOTAL)] for name in cameras}
    found = first(watched(cameras, lambda _, t: T if t < x else F, needed, seen=seen))
    taken = np.ceil(x * 10.0) / 10.0
    kth = sorted(latency for _, latency in cameras.values())[needed - 1]
    assert found == (pytest.approx(taken + kth), "fault")


QUICK, SLOW = {"quick": (10.0, 0.05)}, {"slow": (10.0, 0.35)}
HELD, SLOW_SEES = [formula(f"always[0, {TOTAL}] held", settle=0.5)], {"slow": [(0.0, 3.0)]}


@pytest.mark.parametrize(
    ("cameras", "vote", "formulas", "seen", "told"),
    [
        (QUICK | SLOW, lambda name, t: U if name == "quick" else F if abs(t - 1.0) < 0.01 else T, [SLIP], None,
         (1.35, "fault")),
        (QUICK | SLOW, lambda name, _: T if name == "slow" else U, HELD, SLOW_SEES, None),
        (QUICK | SLOW, lambda name, t: T if name == "slow" and t < 0.95 else U, HELD, SLOW_SEES,
         (pytest.approx(1.0 + PATIENCE + 0.35), "blindness")),
        *((cameras, lambda _, t: T if t < 0.95 else F, HELD, None, (1.55, "violation"))
          for cameras in (QUICK, QUICK | SLOW)),
    ],
    ids=["an image counts from when it was taken", "what is under way is not missing", "but what does not come",
         "after the time to settle", "by the camera that sees it first"],
)  # fmt: skip
def test_an_alarm_counts_by_what_is_known_of_its_time(cameras, vote, formulas, seen, told) -> None:
    assert first(watched(cameras, vote, formulas=formulas, seen=seen)) == told


def test_a_fault_is_told_once_whether_the_other_cameras_confirm_it_or_not() -> None:
    for late in (T, F, U):
        votes = lambda name, t, late=late: T if t < 0.95 else F if name == "quick" else late  # noqa: E731
        alarms = [(round(t, 6), alarm.kind) for t, alarm in watched(QUICK | SLOW, votes)]
        assert alarms == [(1.05, "fault")]


def test_the_log_tells_what_is_known_of_a_time_again_where_a_late_image_changes_it() -> None:
    cameras = {"quick": (10.0, 0.05), "slow": (10.0, 0.12)}
    events: list[Event] = []
    list(watched(cameras, lambda name, t: U if name == "quick" else T if t < 1.95 else F, events=events))
    told = [(event.t, event.literals["held"].value) for event in events if event.exposed == 1.0]
    assert told == [(1.05, "blind"), (1.12, "true")]
    events.clear()
    list(watched({"a": (10.0, 0.05), "b": (10.0, 0.05)}, lambda *_: T, events=events))
    exposed = [event.exposed for event in events]
    assert exposed == sorted(set(exposed))


def test_what_the_robot_does_follows_from_what_happened():
    publisher, looked = EventPublisher([]), {"boxes": {}}
    for kind, fields, doing in (
        ("primitive", {"name": "a4"}, "a4"),
        ("stopping", {}, "stops"),
        ("step", looked, "looks"),
    ):
        publisher.publish(kind, 1.0, **fields)
        assert publisher.doing == doing
