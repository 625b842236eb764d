"""Where the robot stops to look after a fault, and what it does when it does not see enough."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.logic.truth import Truth
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.program.record import ProgramResponse
from sqrp_cli.robot.robot import JointLimits
from sqrp_cli.run.arm_motion import ArmMotion
from sqrp_cli.run.monitor.step_monitor import Alarm, Attempt
from sqrp_cli.run.record.report import Stopped
from sqrp_cli.run.run import LOOK_AGAIN, prepare_retry
from tests.run.steps import FixedNominalStep, played, step

PERIOD = 0.1
WHEN = "there and open"
ALARM = Alarm("fault", "slip", "a slip was seen", ProgramResponse(action="retry", retries=1, when=WHEN))


class Trial:
    """A robot in motion from 0 s on for 10 s, that sees what `seen` says of a time and of whether the tool is open.

    Everything that it does is noted in `done`; it is all that the recovery asks of, and what that has no word of here
    is noted alone.
    """

    period, places = PERIOD, {}

    def __init__(self, seen, predicted: dict[str, dict[str, list[tuple[float, float]]]]) -> None:
        move = joint_move(
            np.zeros(2), np.array([1.8, 0.0]), MotionLimits(*np.repeat([[0.2], [1.0], [10.0]], 2, axis=1))
        )
        entry, stand = step([], predicted, move.duration), {"a": 0.0, "finger": 0.0}
        world = replace(entry.before, joints=stand)
        entry = entry.model_copy(update={"primitives": (played(move),), "before": world})
        limits = [JointLimits(-9.0, 9.0, 0.2, 1.0, 10.0)] * 2
        self.motion = ArmMotion(tuple(stand), limits, limits, np.zeros(2))
        self.motion.play(entry.primitives, 0.0)
        self.motion.place = lambda joints: self.done.append(("place", *joints))
        self.fingers = SimpleNamespace(open={"finger": 0.04, "not of this arm": 0.04})
        self.attempt = Attempt(FixedNominalStep(entry, {}), PERIOD, undisturbed=True, start=0.0)
        self.seen, self.done, self.now, self.is_open, self.since = seen, [], 0.0, False, 0.0
        self.planned, self.slowest = SimpleNamespace(), 0.0
        self.cell = self.collector = self.streams = self.faults = self.publisher = self

    def __getattr__(self, name: str):
        return lambda *told, **named: self.done.append((name, *told, named))

    def pass_time(self, end: float) -> None:
        self.now = min(end, round((np.floor(self.now / PERIOD + 1e-6) + 1) * PERIOD, 9))

    def stop(self, _reason: str) -> None:
        self.done.append(("stop", self.now))
        self.now = self.motion.stop(self.now)

    @property
    def values(self) -> dict[str, Truth]:
        fresh = self.now > self.since
        return self.seen(self.motion.step_time(self.now), self.is_open) if fresh else {}

    @property
    def complete(self) -> bool:
        return self.now > self.since + self.slowest

    def forget(self, t: float) -> None:
        self.since = t

    def release(self) -> None:
        self.is_open = True

    def command_hold(self, *, holding: bool) -> None:
        assert self.is_open is not holding

    def measured_joints(self) -> dict[str, float]:
        return {"a": float(self.motion.state(self.now)[0][0]), "finger": 0.01}  # on its way

    def run(self, t: float = 2.0) -> None:
        """A fault is seen at a time of the motion."""
        self.now = t
        replan = lambda _entry, world: self.done.append(("replan", *world.joints.values())) or self.planned  # noqa: E731
        assert prepare_retry(self, replan, self.attempt, ALARM) is self.planned

    def when(self, what: str) -> float:
        return next(entry[1] for entry in self.done if entry[0] == what)


ALWAYS = {"cam": [(0.0, 99.0)]}
T, F, U = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN


def sees_between(start: float, end: float):
    return lambda tau, is_open: {"there": T, "open": (T if is_open else F) if start <= tau <= end else U}


def test_it_stops_at_once_where_the_condition_is_predicted_to_be_seen() -> None:
    trial = Trial(sees_between(0, 99), {"there": ALWAYS, "open": ALWAYS})
    trial.run()
    assert trial.when("stop") == 2.0
    assert not any(entry[0] == "note" for entry in trial.done)  # that it moved on
    # The attempt that failed counts no more, and believes in the first places.
    assert (trial.attempt.failed, trial.attempt.undisturbed) == (True, False)


def test_it_waits_for_the_images_of_the_slowest_camera_before_it_plans_again() -> None:
    ends = []
    for slowest in (0.0, 0.45):
        trial = Trial(sees_between(0, 99), {"there": ALWAYS, "open": ALWAYS})
        trial.slowest = slowest
        trial.run()
        ends.append(trial.now - trial.since)
    assert 0.0 < ends[0] <= PERIOD + 1e-6
    assert 0.45 < ends[1] <= 0.45 + PERIOD + 1e-6


def test_it_moves_on_to_where_all_of_the_condition_is_predicted_to_be_seen() -> None:
    trial = Trial(sees_between(6, 7), {"there": {"cam": [(4.0, 9.0)]}, "open": {"eye": [(6.0, 7.0)]}})
    trial.run()
    stands = trial.motion.step_time(99.0)
    assert 6.0 + PERIOD <= stands <= 6.0 + PERIOD + 0.1
    assert trial.done[-1] == ("replan", pytest.approx(trial.motion.state(99.0)[0][0]), 0.04)  # with open fingers
    ((cancelled, *_), (_, kind, _, told)), moved_on = trial.done[:2], trial.done[3][1]["moved_on"]
    assert (cancelled, kind, told["cameras"]) == ("cancel", "moving on", ["cam", "eye"])
    assert trial.done[2] == ("place", "finger")  # no command to the tool is given on the way, and the fingers stay
    assert moved_on == pytest.approx(trial.when("stop") - 2.0, abs=1e-3)


def test_it_stops_as_soon_as_it_sees_the_condition_on_the_way() -> None:
    seen = lambda tau, _: {"there": T, "open": T if tau > 4.05 else U}  # noqa: E731
    trial = Trial(seen, {"there": ALWAYS, "open": {"cam": [(7.0, 8.0)]}})
    trial.run()
    assert trial.when("stop") == pytest.approx(4.1)


def test_it_moves_on_to_the_end_where_nothing_better_is_predicted() -> None:
    trial = Trial(sees_between(8.5, 99), {"there": ALWAYS, "open": {"cam": [(0.0, 1.0)]}})
    trial.run()
    assert trial.motion.step_time(99.0) == pytest.approx(trial.attempt.step.time)
    assert trial.done[1][3]["cameras"] == []


def test_it_gives_up_where_the_condition_is_never_seen_and_says_where_it_looked() -> None:
    trial = Trial(lambda *_: {"there": U, "open": U}, {"there": ALWAYS, "open": {"cam": [(6.0, 7.0)]}})
    with pytest.raises(Stopped, match=r"not seen within 2 s of standing where cam should see it, so there is no retry"):
        trial.run()
    assert trial.now == pytest.approx(trial.motion.stop(0.0) + LOOK_AGAIN, abs=PERIOD)
    trial = Trial(lambda *_: {}, {"there": ALWAYS, "open": {"cam": []}})
    with pytest.raises(Stopped, match="at the end of the motion"):
        trial.run()


def test_what_was_seen_while_it_moved_does_not_count_for_the_retry() -> None:
    seen = lambda tau, _: {"there": T, "open": T if 4.05 < tau < 4.25 else U}  # noqa: E731
    trial = Trial(seen, {"there": ALWAYS, "open": {"cam": [(7.0, 8.0)]}})
    with pytest.raises(Stopped):
        trial.run()
