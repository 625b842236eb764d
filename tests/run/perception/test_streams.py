"""When a stream of images counts as failed, and what is made of those that come by themselves."""

from __future__ import annotations

from collections import defaultdict, deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.run.arm_motion import ArmMotion
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.perception.streams import MOST_WAITING, ImageStreams, ReceivedStreams
from tests.run.steps import played

WORKSPACES = Path(__file__).parents[3] / "workspaces"
RATE, LATENCY = 10.0, 0.05
STANDING = 0.5
"""Asked of a robot whose cameras fail [s]."""
TOLD = LATENCY + 1.2 / RATE + 0.1
"""From the last image to the alarm at most [s]."""


class Lookers:
    """Stand for the processes that look at images: they see nothing, and each image takes them some time [s]."""

    def __init__(self, takes: float = 0.01) -> None:
        self.takes, self.now, self.busy = takes, 0.0, defaultdict(deque)

    def submit(self, image: CameraImage, _believed: object) -> None:
        self.busy[image.camera].append((self.now + self.takes, image.t))

    def is_free(self, camera: str) -> bool:
        return not self.busy[camera]

    def is_ready(self, camera: str) -> bool:
        return bool(self.busy[camera]) and self.busy[camera][0][0] <= self.now

    def collect(self, camera: str) -> SimpleNamespace:
        return SimpleNamespace(camera=camera, t=self.busy[camera].popleft()[1], frozen=False, seconds=0.0)


def known(*names: str) -> dict[str, SimpleNamespace]:
    return {name: SimpleNamespace(name=name, rate=RATE, latency=LATENCY, lag=LATENCY) for name in names}


def failure(*failing: tuple[Any, ...], at: float = 20.0, names: tuple[str, ...] = ("cam",)) -> Any:
    """When simulated cameras fail by 20 s, and how, if this is done to them at a time [s]; None if they do not."""
    streams, t = ImageStreams(known(*names), Lookers()), 0.0
    while t < 20.0:
        for how in failing if t >= at else ():
            streams.fail(*how)
        streams.collect(t)
        streams.expose(t, lambda due, t=t: {name: CameraImage(name, t, np.zeros(1)) for name in due}, lambda _: None)
        if (told := streams.failure(t)) is not None:
            return t, told
        t = min(streams.next_event, at if t < at else np.inf)
    return None


@pytest.mark.parametrize("at", np.linspace(3.0, 3.1, 7))
def test_a_lost_camera_is_noticed_soon_after_its_first_image_is_missing_and_told_from_a_late_one(at: float) -> None:
    told, how = failure(("camera-loss", "cam"), at=at)
    assert str(how).startswith("cam is lost")
    assert (how.fault, how.cameras) == ("camera-loss", ["cam"])
    missing = np.ceil(at * RATE - 1e-6) / RATE + LATENCY
    assert missing < told <= missing + 0.021
    told, how = failure(("latency", "cam", 0.4), at=at)
    assert str(how).startswith("the images of cam come too late")
    assert how.fault == "latency"
    assert told < missing + 0.05


def test_cameras_that_are_lost_at_the_same_time_are_told_together_and_before_late_ones() -> None:
    failing = (("camera-loss", "cam1"), ("latency", "cam2", 0.4), ("camera-loss", "cam4"))
    _, how = failure(*failing, at=1.0, names=("cam1", "cam2", "cam3", "cam4"))
    assert str(how) == "cam1 and cam4 are lost: no image for 0.17 s"
    assert how.cameras == ["cam1", "cam4"]


@pytest.mark.parametrize("name", ["tabletop", "screws"])
def test_the_arm_stands_in_time_after_a_camera_is_lost_at_full_speed(name: str) -> None:
    robot = load_workspace(WORKSPACES / name).robot
    joints = list(robot.home)
    limits, stops = ([of[joint] for joint in joints] for of in (robot.limits, robot.stop_limits))
    fastest = MotionLimits(*(np.array([getattr(one, kind) for one in limits]) for kind in MotionLimits.__annotations__))
    move = joint_move(np.zeros(len(joints)), np.linspace(1.5, 2.0, len(joints)), fastest)
    told = 1.2 / RATE + LATENCY
    for t in np.arange(0.0, move.duration, 0.1):
        arm = ArmMotion(joints, limits, stops, np.zeros(len(joints)))
        arm.play([played(move)], 0.0)
        assert told + arm.stop(float(t), protective=True) - t <= STANDING


class Cameras:
    """Two cameras out of step that send images for a while; they are looked for in steps of 5 ms [s]."""

    def __init__(
        self, takes: float = 0.01, late: dict[str, float] | None = None, lost=lambda *_: False, step=0.005, mend=""
    ) -> None:
        self.step = step
        self.lookers = Lookers(takes)
        self.streams = ReceivedStreams(known("cam1", "cam2"), self.lookers, lambda: self.lookers.now, mend)
        self.late, self.lost, self.seen, self.settled = late or {}, lost, [], []
        self.due = sorted(
            (k / RATE + phase + LATENCY, k / RATE + phase, name)
            for name, phase in (("cam1", 0.0), ("cam2", 0.033))
            for k in range(100)
        )

    def until(self, end: float):
        """What fails, and when."""
        if not self.lookers.now:
            self.streams.present(0.0, resume=True)
        while self.lookers.now < end:
            self.lookers.now = round(self.lookers.now + self.step, 6)
            now = self.lookers.now
            self.seen += [found.t for found in self.streams.collect(now)]
            self.streams.expose(now, self.arrived, lambda _: None)
            self.settled.append(self.streams.settled)
            if (how := self.streams.failure(now)) is not None:
                return now, how
        return None

    def arrived(self, names: list[str]) -> dict[str, CameraImage]:
        found = {}
        for one in tuple(self.due):
            came, t, name = one
            if came + self.late.get(name, 0.0) <= self.lookers.now and name not in found:
                self.due.remove(one)
                if not self.lost(name, t):
                    found[name] = CameraImage(name, t, np.zeros(1))
        assert set(found) <= set(names)
        return found


def test_cameras_that_keep_their_rates_never_fail_and_all_images_are_looked_at() -> None:
    cameras = Cameras()
    assert cameras.until(5.0) is None
    assert len(cameras.seen) >= 2 * 48
    assert cameras.settled == sorted(cameras.settled)
    assert failure() is None


@pytest.mark.parametrize(
    ("at", "step", "slack"), [*((at, 0.005, 1) for at in np.linspace(2.0, 2.1, 5)), (2.0, 0.05, 2)]
)
def test_a_lost_camera_is_told_soon_even_by_who_pauses_again_and_again(at: float, step: float, slack: int) -> None:
    told, how = Cameras(lost=lambda name, t: name == "cam2" and t >= at, step=step).until(5.0)
    assert (how.fault, list(how.cameras)) == ("camera-loss", ["cam2"])
    last = max(t for t in np.arange(50) / RATE + 0.033 if t < at)
    assert told <= last + slack * TOLD


@pytest.mark.parametrize(
    ("failing", "fault", "cameras"),
    [
        ({"late": {"cam1": 0.3}}, "latency", ["cam1"]),
        ({"takes": 0.45}, "perception-late", ["cam1", "cam2"]),
        ({"lost": lambda _name, t: t >= 2.0}, "camera-loss", ["cam1"]),
    ],
    ids=["late", "slow", "lost"],
)
def test_how_images_fail_is_told_with_what_may_help_on_a_busy_computer(failing, fault: str, cameras) -> None:
    found = Cameras(**failing, mend="slower")
    _, how = found.until(9.0)
    assert how.fault == fault
    assert set(how.cameras) <= set(cameras)
    assert str(how).endswith(" (slower)")
    assert all(len(stream.waiting) <= MOST_WAITING for stream in found.streams._streams.values())


def test_time_in_which_nobody_looked_is_no_failure() -> None:
    cameras = Cameras()
    assert cameras.until(2.0) is None
    cameras.lookers.now += 30.0  # such as for planning
    assert cameras.streams.present(2.0, resume=True) == cameras.lookers.now
    assert cameras.streams.failure(cameras.lookers.now + 0.2) is None


def test_a_pause_of_our_own_is_not_taken_for_a_lost_camera_but_one_that_is_lost_in_it_is_told() -> None:
    for seconds, loses in ((0.3, False), (0.2, True)):
        cameras = Cameras()
        assert cameras.until(2.0) is None
        cameras.lookers.now += seconds  # what was sent meanwhile has not been received yet
        cameras.streams.expose(cameras.lookers.now, lambda _: {}, lambda _: None)
        assert cameras.streams.failure(cameras.lookers.now) is None
        if loses:
            cameras.due.clear()
            told, how = cameras.until(5.0)
            assert how.fault == "camera-loss"
            assert told < 2.2 + TOLD
        else:
            assert cameras.until(5.0) is None
