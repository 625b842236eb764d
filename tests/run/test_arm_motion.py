"""Stops along the path."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.program.record import ProgramGuard
from sqrp_cli.robot.robot import JointLimits
from sqrp_cli.run.arm_motion import ArmMotion
from sqrp_cli.trajectory import Trajectory
from tests.run.steps import played

VELOCITY, ACCELERATION, JERK = 0.6, 1.5, 8.0
LIMITS = JointLimits(-7, 7, VELOCITY, ACCELERATION, JERK)
STOP = JointLimits(-7, 7, VELOCITY, 5 * ACCELERATION, 10 * JERK)
FASTEST = MotionLimits(*(np.full(2, value) for value in (VELOCITY, ACCELERATION, JERK)))
Q0, Q1 = np.array([0.0, 0.5]), np.array([1.2, -0.4])


def playback() -> ArmMotion:
    found = ArmMotion(("a", "b"), (LIMITS, LIMITS), (STOP, STOP), Q0)
    found.play([played(joint_move(Q0, Q1, FASTEST))], 1.0)
    return found


def assert_stays_on_the_path(reference: ArmMotion, stands: float, acceleration: float, jerk: float) -> None:
    """That the arm goes along the path, never back, until it stands, within limits of acceleration and jerk."""
    t = np.arange(1.0, stands + 0.2, 0.001)
    q, velocity, found = reference.states(t)
    along = (q - Q0) / (Q1 - Q0)
    assert np.allclose(along[:, 0], along[:, 1])
    assert np.all(np.diff(along[:, 0]) >= -1e-12)
    assert np.allclose(reference.state(stands)[1], 0.0, atol=1e-9)
    assert np.abs(found).max() <= 1.02 * acceleration
    assert np.allclose(np.gradient(q, t, axis=0)[2:-2], velocity[2:-2], atol=2e-3)
    assert np.abs(np.diff(found, axis=0)).max() / 0.001 <= jerk


@pytest.mark.parametrize("at", np.linspace(1.05, 3.3, 10))
def test_a_stop_stays_on_the_path_and_keeps_the_limits(at: float) -> None:
    reference = playback()
    stands = reference.stop(at)
    assert_stays_on_the_path(reference, stands, ACCELERATION, 2.2 * JERK)


def test_it_stands_before_and_after_the_motion_and_where_a_stop_ended() -> None:
    reference = playback()
    assert np.allclose(reference.state(0.5)[0], Q0)
    assert np.allclose(reference.state(99.0)[0], Q1)
    assert not np.allclose(reference.state(2.0)[1], 0.0)
    expected = reference.state(1.0 + reference.standing_time(1.0))[0]
    stands = reference.stop(2.0)
    assert np.allclose([reference.state(t)[0] for t in (stands, stands + 5)], [expected, expected])


def test_a_protective_stop_is_faster_and_keeps_its_own_limits() -> None:
    reference, other = playback(), playback()
    stands = reference.stop(2.0, protective=True)
    assert stands - 2.0 < 0.6 * (other.stop(2.0) - 2.0)
    acceleration = reference.states(np.arange(2.0, stands, 0.001))[2]
    assert ACCELERATION < np.abs(acceleration).max() <= 1.02 * STOP.acceleration
    assert np.abs(np.diff(acceleration, axis=0)).max() / 0.001 <= 1.1 * STOP.jerk + JERK


@pytest.mark.parametrize("later", [0.0, 0.05, 0.2, 0.35, 0.5])
def test_a_protective_stop_takes_over_from_another_that_is_under_way(later: float) -> None:
    reference, other = playback(), playback()
    usual, at = other.stop(2.0), 2.0 + later
    assert reference.stop(2.0) == usual
    before = reference.state(at)
    stands = reference.stop(at, protective=True)
    assert at < stands < usual - 0.3 * (usual - at)
    assert reference.stop(at + 0.01, protective=True) == stands
    assert np.allclose(np.array(before), np.array(reference.state(at + 1e-9)), atol=1e-6)
    assert_stays_on_the_path(reference, stands, STOP.acceleration, 1.1 * STOP.jerk + 2.2 * JERK)


def test_a_stop_that_is_nearly_over_is_left_to_itself_and_one_while_standing_takes_no_time() -> None:
    reference = playback()
    stands = reference.stop(2.0)
    assert reference.stop(stands - 0.02, protective=True) == stands
    assert ArmMotion(("a", "b"), (LIMITS, LIMITS), (STOP, STOP), Q0).stop(3.0) == 3.0


def test_a_joint_that_is_kept_stays_while_the_others_move_until_the_next_step() -> None:
    reference = playback()
    kept = reference.state(1.5)[0][1]
    reference.place({"b": kept, "not of this arm": 1.0})
    q, velocity, acceleration = reference.state(2.5)
    assert (q[1], velocity[1], acceleration[1]) == (kept, 0.0, 0.0)
    assert q[0] > reference.state(1.5)[0][0]
    reference.place({"b": 0.25})
    assert reference.state(9.0)[0][1] == 0.25
    reference.play([], 10.0)
    assert np.allclose(reference.state(11.0)[0], Q0)


def guarded() -> ArmMotion:
    """A joint move, a guarded move down to 0.2 that is expected to end at 0.15, a wait, and a joint move back."""
    poses = [Q0, Q0 + np.array([0.15, 0.0]), Q0 + np.array([0.2, 0.0])]
    approach, beyond = (joint_move(one, other, FASTEST) for one, other in pairwise(poses))
    primitives, start = [], 0.0
    for name, action, trajectory in (
        ("a1", "StraightMove", approach.resting(beyond.duration)),
        ("a2", "Wait", Trajectory.standstill(poses[1], 0.5)),
        ("a3", "JointMove", joint_move(poses[1], Q1, FASTEST)),
    ):
        guard = ProgramGuard(force=5.0, trajectory=approach.followed_by(beyond)) if name == "a1" else None
        known = {"name": name, "action": action, "guard": guard, "start": start, "end": start + trajectory.duration}
        primitives.append(played(trajectory).model_copy(update=known))
        start += trajectory.duration
    assert primitives[0].end == pytest.approx(approach.duration + beyond.duration)
    found = ArmMotion(("a", "b"), (LIMITS, LIMITS), (STOP, STOP), Q0)
    found.play(primitives, 0.0)
    return found


@pytest.mark.parametrize("contact", [None, 0.3, 0.55, 0.9])
def test_a_guarded_move_stands_where_it_met_something_and_the_next_joint_move_takes_that_back(
    contact: float | None,
) -> None:
    motion = guarded()
    (one, wait, _), ends = motion._primitives, motion._ends
    assert [motion.force_limit(t) for t in (-0.1, ends[0] + 0.1, ends[1] + 0.1, ends[2] + 1)] == [None] * 4
    where = Q0 + np.array([0.2, 0.0])
    if contact is not None:
        assert motion.force_limit(contact) == 5.0
        where = motion.state(contact)[0]
        motion.halt_primitive(contact)
        assert motion.force_limit(contact + 0.01) is None
    t = np.arange(0.0, motion._ends[-1] + 0.1, 0.001)
    q, velocity, acceleration = motion.states(t)
    standing = (t > one.end + 1e-9) & (t < wait.end)
    assert np.abs(q[standing] - where).max() <= VELOCITY * 0.01 / 2
    assert np.ptp(q[standing], axis=0).max() == 0.0
    assert np.abs(np.diff(q, axis=0)).max() <= 1.5 * VELOCITY * 0.001
    assert np.allclose(np.gradient(q, t, axis=0)[2:-2], velocity[2:-2], atol=0.02)
    smooth = t > one.end + 0.01
    assert np.allclose(np.gradient(velocity[smooth], t[smooth], axis=0)[2:-2], acceleration[smooth][2:-2], atol=0.05)
    np.testing.assert_allclose(q[-1], Q1, atol=1e-12)
