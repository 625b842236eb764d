"""Portions of a motion: played by a controller they are the motion, and any of them alone ends in standing."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.field.cell_server import FollowedTrajectory
from sqrp_cli.geometry import Array
from sqrp_cli.run.arm_motion import ArmMotion, JointStates
from sqrp_cli.run.cell.portions import EVERY, LEAD, SETTLES, Portions
from tests.run.test_arm_motion import ACCELERATION, JERK, Q0, Q1, playback

NAMES = {"a": "a", "b": "b"}


def message(times: Array, states: JointStates) -> SimpleNamespace:
    points = [
        SimpleNamespace(
            positions=q, velocities=v, accelerations=a,
            time_from_start=SimpleNamespace(sec=int(t), nanosec=round((t - int(t)) * 1e9)),
        )
        for t, q, v, a in zip(times.tolist(), *states, strict=True)
    ]  # fmt: skip
    return SimpleNamespace(joint_names=["a", "b"], points=points)


class Played:
    """A controller that gets portions of a motion, until nobody sends any more."""

    def __init__(self, silent_from: float = float("inf")) -> None:
        self.motion, self.now = playback(), 0.9
        self.arm = FollowedTrajectory(NAMES, dict(zip("ab", Q0.tolist(), strict=True)), {})
        self.portions, self.sent = Portions(self.get), 0
        self.t, self.q = [], []
        while self.now < 6.0:
            if self.now < silent_from:
                self.portions.follow(self.motion, self.now)
            self.t.append(self.now)
            self.q.append(self.arm.states(np.array([self.now])).positions[0])
            self.now += 0.01

    def get(self, times: Array, states: JointStates) -> None:
        self.sent += 1
        self.arm.replace(message(times, states), self.now, None)


def test_played_in_portions_a_motion_is_the_motion() -> None:
    found = Played()
    wanted = found.motion.states(np.array(found.t)).positions
    assert np.abs(np.array(found.q) - wanted).max() < 2e-4
    assert np.allclose(found.q[-1], Q1)
    assert found.sent < 40  # nothing is sent once the last portion holds the end


@pytest.mark.parametrize("silent_from", np.linspace(1.1, 3.2, 8))
def test_who_falls_silent_leaves_the_arm_standing_within_a_second_and_on_its_path(silent_from: float) -> None:
    found = Played(silent_from)
    q, t = np.array(found.q), np.array(found.t)
    still = np.abs(q[-1] - q).max(axis=1) < 1e-9
    stands = t[still.argmax()]
    assert stands - silent_from < 1.0
    along = (q - Q0) / (Q1 - Q0)
    assert np.abs(along[:, 0] - along[:, 1]).max() < 1e-4
    velocity = np.gradient(q, t, axis=0)
    assert np.abs(np.gradient(velocity, t, axis=0)).max() <= 6 * ACCELERATION
    assert np.abs(velocity[still]).max() <= JERK * 0.01


@pytest.fixture
def following() -> tuple[ArmMotion, list[tuple[Array, JointStates]], Portions]:
    """A motion, what is sent of it, and who sends that."""
    sent: list[tuple[Array, JointStates]] = []
    return playback(), sent, Portions(lambda *portion: sent.append(portion))


def test_a_stop_is_sent_at_once_and_replaces_what_was_sent(following) -> None:
    motion, sent, portions = following
    portions.follow(motion, 1.5)
    portions.follow(motion, 1.51)
    assert len(sent) == 1
    stands = motion.stop(1.52, protective=True)
    portions.follow(motion, 1.52)
    assert len(sent) == 2
    assert 1.52 + sent[1][0][-1] == pytest.approx(stands)
    assert not sent[1][1].velocities[-1].any()


def test_a_stop_begins_where_the_robot_is_by_the_last_portion_and_nothing_is_sent_after_it(following) -> None:
    motion, sent, portions = following
    portions.follow(motion, 1.5)
    motion.stop(1.2)  # what is wanted now is elsewhere
    stands = portions.stop(1.55)
    assert np.allclose(sent[1][1].positions[0], playback().state(1.55 + LEAD).positions, atol=1e-3)
    assert 1.55 + sent[1][0][-1] == pytest.approx(stands)
    assert stands < 1.5 + sent[0][0][-1] - 0.2
    portions.follow(playback(), 1.6)
    assert portions.stop(1.65) == stands
    assert len(sent) == 2


@pytest.mark.parametrize("pause", [0.43, 1.5])
def test_after_a_pause_in_which_the_robot_braked_nothing_is_sent(following, pause: float) -> None:
    motion, sent, portions = following
    portions.follow(motion, 1.5)
    portions.follow(motion, 1.5 + pause)
    assert portions.over
    motion.stop(1.5 + pause, protective=True)
    portions.follow(motion, 1.5 + pause + 0.01)
    portions.stop(1.5 + pause + 0.02)
    assert len(sent) == 1


@pytest.mark.parametrize("stand", [True, False])
def test_a_motion_that_went_on_while_nothing_was_sent_is_no_portion(following, stand: bool) -> None:
    motion, sent, portions = following
    before = motion.stopped(0.5)
    if stand:
        portions.follow(before, 0.6)
        portions.follow(motion, 1.8)  # it began at 1.0
    else:
        portions.follow(motion, 1.8)
        motion.stop(1.5, protective=True)  # too late: the robot goes on
        portions.follow(motion, 1.9)
    assert portions.over
    first = np.array([states.positions[0] for _, states in sent]).reshape(-1, 2)
    assert np.allclose(first, playback().states(np.array([1.8 + LEAD, 1.9 + LEAD][: len(sent)])).positions, atol=2e-3)
    assert len(sent) == (0 if stand else 2)


def test_a_start_is_compared_only_where_the_robot_has_stood_long_enough_to_settle() -> None:
    portions, motion = Portions(lambda *_: None), playback()
    assert portions.begins(motion, 0.0)  # nothing was sent yet
    for now in np.arange(0.9, 4.0, 0.05):
        portions.follow(motion, now)
        assert not portions.begins(motion, now)  # it is that which is followed
    ended = motion.rests_at
    assert ended < 3.7
    motion.play([], 9.0)  # something new is to begin
    begins = [now for now in np.arange(ended - 0.1, ended + 1.0, 0.01) if portions.begins(motion, now)]
    assert ended + SETTLES <= begins[0] <= ended + SETTLES + EVERY  # what was sent last may end a little later


def test_fingers_may_be_wanted_elsewhere_at_once() -> None:
    for loose, over in (((), True), (("b",), False)):
        portions, motion = Portions(lambda *_: None, loose), playback()
        portions.follow(motion, 1.5)
        motion.place({"b": 1.0})
        portions.follow(motion, 1.51)
        assert portions.over is over


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda bad: bad.points[0].positions.__setitem__(0, np.nan), "no joint can have"),
        (lambda bad: bad.points[0].velocities.__setitem__(0, 1e300), "no joint can have"),
        (lambda bad: bad.points.reverse(), "do not rise"), (lambda bad: bad.points.clear(), "no points"),
        (lambda bad: bad.joint_names.__setitem__(1, "c"), "its joints are a, c"),
    ],
)  # fmt: skip
def test_a_trajectory_that_no_controller_would_follow_is_refused(following, spoil, why: str) -> None:
    motion, sent, portions = following
    portions.follow(motion, 1.5)
    bad = message(*sent[0])
    spoil(bad)
    with pytest.raises(ValueError, match=why):
        FollowedTrajectory(NAMES, {"a": 0.0, "b": 0.0}, {}).replace(bad, 0.0, None)
