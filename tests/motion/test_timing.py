"""Laws of timing: limits hold, nothing is slower than it must be, and the closed form is ruckig's."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruckig import InputParameter, Result, Ruckig, Synchronization
from ruckig import Trajectory as RuckigTrajectory

from sqrp_cli.geometry import Array
from sqrp_cli.motion.timing import (
    MotionLimits,
    joint_move,
    joint_move_duration,
    rest_to_rest,
    rest_to_rest_duration,
    time_paths,
)
from sqrp_cli.trajectory import JointPath, Trajectory
from tests.motion.cells import phase_samples

EXPONENT = st.floats(-2, 2)
JOINTS = 6


def random_limits(rng: np.random.Generator) -> MotionLimits:
    return MotionLimits(*(10 ** rng.uniform(-0.5, 0.5, JOINTS) * scale for scale in (1.0, 3.0, 20.0)))


def random_path(rng: np.random.Generator) -> JointPath:
    return JointPath(np.array([0.0, 1.0]), rng.normal(size=(1, 7, JOINTS)) / (1 + np.arange(7))[:, None] ** 2)


def excess(trajectory: Trajectory, limits: MotionLimits, per_phase: int) -> float:
    """Largest ratio of velocity, acceleration or jerk to its limit, both sides of every switch included."""
    t = phase_samples(trajectory, per_phase)
    every: tuple[tuple[int, Array], ...] = ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk))
    return max(float((np.abs(trajectory.motion(t, order)[order]) / limit).max()) for order, limit in every)


@given(EXPONENT, EXPONENT, EXPONENT)
@settings(max_examples=80)
def test_a_law_keeps_its_limits_rises_and_lasts_as_the_closed_form_says(v, a, j):
    limits = MotionLimits(*(np.array(10.0**x) for x in (v, a, j)))
    law = rest_to_rest(limits)
    assert law.breaks[-1] == pytest.approx(float(rest_to_rest_duration(1.0, limits)), rel=1e-9)
    s, ds, dds, ddds = law.derivatives(np.linspace(0, law.breaks[-1], 500))
    assert s[[0, -1]] == pytest.approx([0, 1], abs=1e-9)
    assert ds[[0, -1]] == pytest.approx([0, 0], abs=1e-9 * 10**v)
    assert np.diff(s).min() >= -1e-12
    for values, limit in ((ds, limits.velocity), (dds, limits.acceleration), (ddds, limits.jerk)):
        assert np.abs(values).max() <= limit * (1 + 1e-9)


EXTREME = st.floats(-9, 9)


@given(EXTREME, EXTREME, EXTREME)
@settings(max_examples=80)
def test_limits_however_far_apart_have_a_law_that_keeps_them(v, a, j):
    limits = MotionLimits(*(np.array(10.0**x) for x in (v, a, j)))
    law = rest_to_rest(limits)
    assert law.breaks[-1] == pytest.approx(float(rest_to_rest_duration(1.0, limits)), rel=1e-6)
    instants = np.concatenate([law.breaks[:-1], np.nextafter(law.breaks[1:], 0.0)])
    reached = np.abs(law.derivatives(instants))
    assert reached[0].max() == pytest.approx(1.0, rel=1e-6)
    rounded = 4 * np.spacing(law.breaks[-1])  # as instants are, by which the derivative grows by so much of the next
    every = (limits.velocity, limits.acceleration, limits.jerk, np.array(0.0))
    for order, (limit, growth) in enumerate(pairwise(every), start=1):
        assert reached[order].max() <= limit * (1 + 1e-6) + rounded * growth


@pytest.mark.parametrize(("distance", "v", "a", "j", "duration"), [
        (2.0, 1e9, 1e9, 1.0, 4.0),  # jerk alone: distance = 2 j (T/4)^3
        (4.0, 1.0, 1.0, 1.0, 6.0),  # ramps of 2 s reach a = 1 and v = 1 at once, and cruise for 2 s
        (6.0, 1e9, 1.0, 1.0, 6.0),  # a = 1 held for 1 s in each ramp of 3 s: peak velocity 2, distance 2 * 3
])  # fmt: skip
def test_durations_worked_out_by_hand(distance, v, a, j, duration):
    limits = MotionLimits(*(np.array(x) for x in (v, a, j)))
    assert float(rest_to_rest_duration(distance, limits)) == pytest.approx(duration)


@pytest.mark.parametrize("rounded", [1.0, 1.0 + 1e-15, 1.0 - 1e-15])
@pytest.mark.parametrize(("a", "j"), [(1.0, 10.0), (2.0, 20.0), (5.0, 40.0)])
def test_a_law_is_found_where_every_limit_is_reached_at_one_instant_only(a, j, rounded):
    distance = 2 * a**3 / j**2
    limits = MotionLimits(*(np.array(x / distance) for x in (a * a / j, rounded * a, j)))
    assert rest_to_rest(limits).breaks[-1] == pytest.approx(4 * a / j, rel=1e-9)


@given(st.integers(0, 10_000))
def test_a_joint_move_is_straight_keeps_every_limit_and_uses_one_fully(seed):
    rng = np.random.default_rng(seed)
    q0, q1, limits = rng.normal(size=JOINTS), rng.normal(size=JOINTS), random_limits(rng)
    trajectory = joint_move(q0, q1, limits)
    q = trajectory.positions(np.linspace(0, trajectory.duration, 200))
    share = (q - q0) @ (q1 - q0) / ((q1 - q0) @ (q1 - q0))
    np.testing.assert_allclose(q, q0 + share[:, None] * (q1 - q0), atol=1e-12)
    np.testing.assert_allclose(q[[0, -1]], [q0, q1], atol=1e-9)
    assert excess(trajectory, limits, 50) == pytest.approx(1.0, abs=1e-9)
    others = np.stack([q1, rng.normal(size=JOINTS)])
    table = joint_move_duration(np.stack([q0, q1])[:, None], others[None], limits)
    each = [[joint_move(q, to, limits).duration for to in others] for q in (q0, q1)]
    np.testing.assert_allclose(table, each, rtol=1e-9)
    assert table[1, 0] == 0.0  # to where the arm is


@given(st.integers(0, 10_000))
def test_under_proportional_limits_a_joint_move_lasts_as_long_as_ruckigs_phase_synchronisation(seed):
    rng = np.random.default_rng(seed)
    q0, q1 = rng.normal(size=JOINTS), rng.normal(size=JOINTS)
    share = np.abs(q1 - q0) / np.abs(q1 - q0).max()
    limits = MotionLimits(share * 1.0, share * 2.0, share * 10.0)
    request = InputParameter(JOINTS)
    request.synchronization = Synchronization.Phase
    request.current_position, request.target_position = q0.tolist(), q1.tolist()
    request.max_velocity, request.max_acceleration = limits.velocity.tolist(), limits.acceleration.tolist()
    request.max_jerk = limits.jerk.tolist()
    solution = RuckigTrajectory(JOINTS)
    assert Ruckig(JOINTS).calculate(request, solution) == Result.Working
    assert joint_move(q0, q1, limits).duration == pytest.approx(solution.duration, rel=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_a_curved_path_keeps_every_limit_at_a_finer_step_than_the_one_used(seed):
    rng = np.random.default_rng(seed)
    limits, path = random_limits(rng), random_path(rng)
    along = limits.along(path.derivative_bounds().max(axis=0))  # as if it were straight, as steep as its steepest place
    (trajectory,) = time_paths([path], limits, along)
    assert excess(trajectory, limits, 1009) <= 1.0


@given(st.integers(0, 10_000), st.floats(0.01, 1))
@settings(max_examples=30)
def test_a_path_with_limits_along_it_keeps_both_and_is_slowed_down_only_as_needed(seed, speed):
    rng = np.random.default_rng(seed)
    path, limits = random_path(rng), random_limits(rng)
    along = MotionLimits(*(np.array(x) for x in (speed, 2 * speed, 20 * speed)))
    (trajectory,) = time_paths([path], limits, along)
    ratio = excess(trajectory, limits, 1009)
    assert ratio <= 1.0
    assert trajectory.duration >= rest_to_rest(along).breaks[-1] * (1 - 1e-12)
    slowed_down = trajectory.duration > rest_to_rest(along).breaks[-1] * (1 + 1e-9)
    assert not slowed_down or ratio > 0.99
    peaks = np.abs(trajectory.law.derivatives(phase_samples(trajectory, 50))).max(axis=1)[1:]
    assert (peaks <= np.array([speed, 2 * speed, 20 * speed]) * (1 + 1e-9)).all()


def test_many_paths_at_once_are_timed_like_each_alone():
    rng = np.random.default_rng(2)
    limits, along = random_limits(rng), MotionLimits(*(np.array(x) for x in (0.3, 0.6, 6.0)))
    paths = [random_path(rng) for _ in range(5)]
    paths[2:2] = [JointPath(path.breaks, path.coefficients[:, :4]) for path in paths[:2]]
    durations = [trajectory.duration for trajectory in time_paths(paths, limits, along)]
    assert durations == pytest.approx([time_paths([path], limits, along)[0].duration for path in paths], rel=1e-12)
    assert len(set(durations)) > 3


def fastest_by_brute_force(path: JointPath, limits: MotionLimits, along: MotionLimits) -> float:
    """Duration of the fastest law whose ramp's jerk, at any of many shares of the speed, breaks no limit of a joint."""

    def keeps(share: float, jerk: float) -> float:
        softer = MotionLimits(share * along.velocity, along.acceleration, np.array(jerk))
        trajectory = Trajectory(path, rest_to_rest(softer))
        return trajectory.duration if excess(trajectory, limits, 40) <= 1.0 else np.inf

    jerks = (float(along.jerk) * np.geomspace(1e-3, 1.0, 60)).tolist()
    return min(keeps(share, jerk) for share in np.geomspace(0.1, 1.0, 15).tolist() for jerk in jerks)


@pytest.mark.parametrize("seed", range(6))
def test_a_law_lasts_hardly_longer_than_the_fastest_of_its_form(seed):
    rng = np.random.default_rng(seed)
    limits, path, speed = random_limits(rng), random_path(rng), float(rng.uniform(0.05, 1.0))
    along = MotionLimits(*(np.array(x) for x in (speed, 2 * speed, 20 * speed)))
    (trajectory,) = time_paths([path], limits, along)
    assert trajectory.duration <= 1.03 * fastest_by_brute_force(path, limits, along)
