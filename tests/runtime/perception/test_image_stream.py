"""When a stream of images counts as failed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.motion.timing import MotionLimits, joint_move
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.perception.image_detector import PerceptionError
from sqrp_cli.runtime.perception.streams import ImageStreams
from sqrp_cli.runtime.record.report import MonitoringLost
from sqrp_cli.runtime.run.arm_motion import ArmMotion
from tests.runtime.steps import played

WORKSPACES = Path(__file__).parents[3] / "workspaces"
RATE, LATENCY = 10.0, 0.05
STANDING = 0.5
"""Asked of a robot whose cameras fail [s]."""


class Looker:
    """Stands for the processes that look at images: sees nothing in any of them."""

    def submit(self, frame: CameraImage, believed: object) -> None:
        assert believed is None
        self.last = frame

    def collect(self, camera: str) -> SimpleNamespace:
        return SimpleNamespace(camera=camera, t=self.last.t, frozen=False, seconds=0.0)


def eyes(*names: str) -> ImageStreams:
    return ImageStreams(
        {name: SimpleNamespace(name=name, rate=RATE, latency=LATENCY, lag=LATENCY) for name in names or ("cam",)},
        Looker(),
    )


def failure(found: ImageStreams, until: float, at: float = -1.0, fail=lambda _: None) -> tuple[float, str] | None:
    """When a stream fails by a time, and how; at a time `fail` is done to the eyes."""
    t = 0.0
    while t <= until:
        if at <= t:
            fail(found)
            at = np.inf
        found.collect(t)
        if found.next_exposure <= t + 1e-9:
            found.expose(
                t, lambda names, t=t: {name: CameraImage(name, t, np.zeros(1)) for name in names}, lambda _: None
            )
        if (how := found.failure(t)) is not None:
            assert how.cameras == ["cam"]
            return t, f"{how.fault}: {how}"
        t = min(found.next_exposure, found.next_arrival, found.next_check, at)
    return None


def test_a_process_that_crashes_between_two_steps_is_a_lost_monitor_of_the_next() -> None:
    class Crashed(Looker):
        def watch(self, _sought: object) -> None:
            raise PerceptionError(["cam"], "has ended")

    streams = ImageStreams({"cam": SimpleNamespace(name="cam", rate=RATE, latency=LATENCY, lag=LATENCY)}, Crashed())
    with pytest.raises(MonitoringLost) as caught:
        streams.watch(None)
    assert (caught.value.fault, list(caught.value.cameras)) == ("perception-crash", ["cam"])


def test_a_stream_that_keeps_its_rate_never_fails() -> None:
    assert failure(eyes(), 20.0) is None


@pytest.mark.parametrize("at", np.linspace(3.0, 3.1, 7))
def test_a_lost_camera_is_noticed_soon_after_its_first_image_is_missing(at: float) -> None:
    told, how = failure(eyes(), 20.0, at, lambda found: found.fail("camera-loss", "cam"))
    assert how.startswith("camera-loss: cam is lost")
    missing = np.ceil(at * RATE - 1e-6) / RATE + LATENCY
    assert missing < told <= missing + 0.021


def test_images_that_come_late_are_told_from_those_that_do_not_come() -> None:
    told, how = failure(eyes(), 20.0, 3.05, lambda found: found.fail("latency", "cam", 0.4))
    assert how.startswith("latency: the images of cam come too late")
    assert told < 3.2


def test_cameras_that_are_lost_at_the_same_time_are_told_together_and_before_late_ones() -> None:
    found, t = eyes("cam1", "cam2", "cam3", "cam4"), 0.0
    while (how := found.failure(t)) is None:
        found.collect(t)
        if found.next_exposure <= t + 1e-9:
            found.expose(
                t, lambda names, t=t: {name: CameraImage(name, t, np.zeros(1)) for name in names}, lambda _: None
            )
        if t > 1.0:
            found.fail("camera-loss", "cam1")
            found.fail("latency", "cam2", 0.4)
            found.fail("camera-loss", "cam4")
        t = min(found.next_exposure, found.next_arrival, found.next_check)
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
