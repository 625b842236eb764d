"""How late a fault is noticed, against the definition integrated by brute force; stopping against ruckig."""

from __future__ import annotations

from dataclasses import astuple
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Trajectory

from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.literal import Literal
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.coverage.faults import fault_metrics, interval_metrics
from sqrp_cli.programming.motion.stop_and_return import Recovery, stop
from sqrp_cli.programming.motion.timing import MotionLimits
from tests.programming.studies import eventually
from tests.programming.timelines import ATOMS, RESPONSES, Story, make_story, moments, stories

INSTANTS = 4000
"""Instants x at which the delay is evaluated."""


def recovery(seed: int, total: float) -> Recovery:
    rng = np.random.default_rng(seed)
    return Recovery(np.linspace(0.0, total, 8), rng.uniform(0.5, 3.0, 8))


def noticed(story: Story, x: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """When a fault at x is noticed, whether it can be seen at x, and whether it is ever seen; shape (x,) each."""
    when, visible, ever = np.full(len(x), story.total), np.zeros(len(x), dtype=bool), np.zeros(len(x), dtype=bool)
    samples = moments(story)
    for t, covered, response in sorted(samples, reverse=True):
        if covered:
            when[x <= t], ever[x <= t] = t + response, True
    for (t0, first, response0), (t1, second, response1) in pairwise(samples):
        if first and second and t0 < t1:
            between = (t0 <= x) & (x <= t1)
            when[between], visible[between], ever[between] = x[between] + max(response0, response1), True, True
    return when, visible, ever


def integrated(story: Story, back: Recovery) -> FaultMetrics:
    start, end = story.interval.start, story.interval.end
    x = start + (np.arange(INSTANTS) + 0.5) * (end - start) / INSTANTS
    when, visible, ever = noticed(story, x)
    sights = np.array(sorted(t for t, covered, _ in moments(story) if covered))
    passed = np.searchsorted(sights, x)
    longest = run = 0
    for index, seen in enumerate(visible):
        run = 0 if seen else 1 if index and passed[index] != passed[index - 1] else run + 1
        longest = max(longest, run)
    return FaultMetrics(
        delay_mean=float((when - x).mean()),
        delay_worst=float((when - x).max()),
        blind_longest=longest * (end - start) / INSTANTS,
        unseen=float(1 - ever.mean()),
        expected_time=float((when + back.at(when) + story.total).mean()),
    )


@settings(max_examples=60)
@given(story=stories(), seed=st.integers(0, 1000))
def test_metrics_are_those_of_the_definition_integrated_over_the_instant_of_the_fault(story: Story, seed: int) -> None:
    back = recovery(seed, story.total)
    found = interval_metrics(story.timeline, "slip", story.interval, back, story.total)
    if story.interval.length == 0:
        return
    expected = integrated(story, back)
    # Every sample may cut the delay, so that the midpoint rule is off by a cell each.
    cell = story.interval.length / INSTANTS
    cuts = len(story.timeline.samples) + 2
    jump = (story.total + 1.0) * cuts / INSTANTS
    assert found.delay_mean == pytest.approx(expected.delay_mean, abs=jump)
    assert found.unseen == pytest.approx(expected.unseen, abs=cuts / INSTANTS)
    assert found.expected_time == pytest.approx(expected.expected_time, abs=4 * jump)
    assert found.blind_longest == pytest.approx(expected.blind_longest, abs=2 * cell)
    # The supremum may be the response at a lone instant, which the brute force need not hit.
    assert expected.delay_worst - 2 * cell <= found.delay_worst
    assert found.delay_worst <= max(expected.delay_worst + 2 * cell, max(RESPONSES))


@given(story=stories(), seed=st.integers(0, 1000))
def test_metrics_keep_their_order(story: Story, seed: int) -> None:
    back = recovery(seed, story.total)
    found = interval_metrics(story.timeline, "slip", story.interval, back, story.total)
    assert 0 <= found.delay_mean <= found.delay_worst + 1e-9
    assert 0 <= found.unseen <= 1 + 1e-12
    assert 0 <= found.blind_longest <= story.interval.length + 1e-12
    assert found.expected_time >= story.total + story.interval.start


def story_of(seen: float, *, start: float = 1.0, end: float = 3.0) -> Story:
    return make_story([4.0], (eventually(start, end, Literal(ATOMS[0]), fault="slip"),), [5], seed=1, seen=seen)


def test_a_fault_that_is_always_seen_is_noticed_after_the_response_alone() -> None:
    found = interval_metrics((story := story_of(1.0)).timeline, "slip", story.interval, recovery(0, 4.0), 4.0)
    assert 0.09 <= found.delay_mean <= found.delay_worst <= 0.3
    assert found.blind_longest == 0
    assert found.unseen == 0


def test_a_fault_that_is_never_seen_is_noticed_at_the_end_of_the_skill() -> None:
    back = Recovery(np.array([0.0, 4.0]), np.array([1.0, 2.0]))
    found = interval_metrics((story := story_of(0.0)).timeline, "slip", story.interval, back, 4.0)
    # delay_mean: from x, uniform over 1 s to 3 s, to 4 s
    assert astuple(found) == pytest.approx((2.0, 3.0, 2.0, 1.0, 4.0 + 2.0 + 4.0))


def test_a_fault_at_one_instant_has_that_instants_delay() -> None:
    story = story_of(0.0, start=1.5, end=1.5)
    found = interval_metrics(story.timeline, "slip", story.interval, recovery(0, 4.0), 4.0)
    assert (found.delay_mean, found.delay_worst) == (pytest.approx(2.5), pytest.approx(2.5))
    assert found.unseen == pytest.approx(1.0)


LIMITS = MotionLimits(np.array([1.0]), np.array([2.0]), np.array([10.0]))


@given(velocity=st.floats(-1, 1), acceleration=st.floats(-2, 2))
def test_stopping_takes_as_long_and_as_far_as_ruckig_says(velocity: float, acceleration: float) -> None:
    request = InputParameter(1)
    request.control_interface = ControlInterface.Velocity
    request.current_velocity, request.current_acceleration = [velocity], [acceleration]
    request.target_velocity, request.target_acceleration = [0.0], [0.0]
    request.max_acceleration, request.max_jerk = LIMITS.acceleration.tolist(), LIMITS.jerk.tolist()
    trajectory = Trajectory(1)
    assert Ruckig(1).calculate(request, trajectory) == Result.Working
    position, final, _ = trajectory.at_time(trajectory.duration)

    time, moved = stop(np.array([[velocity]]), np.array([[acceleration]]), LIMITS)

    assert final[0] == pytest.approx(0.0, abs=1e-8)
    assert time[0, 0] == pytest.approx(trajectory.duration, abs=1e-6)
    assert moved[0, 0] == pytest.approx(position[0], abs=1e-6)


def test_a_fault_in_two_intervals_is_averaged_over_both_and_not_over_the_time_between() -> None:
    story = story_of(0.0, start=0.0, end=4.0)
    first, second = Stretch(0.5, 1.0), Stretch(2.0, 3.5)
    back = recovery(0, story.total)
    parts = [interval_metrics(story.timeline, "slip", part, back, story.total) for part in (first, second)]
    both = fault_metrics(story.timeline, "slip", (first, second), back, story.total)
    assert both.delay_mean == pytest.approx(0.25 * parts[0].delay_mean + 0.75 * parts[1].delay_mean)
    assert both.expected_time == pytest.approx(0.25 * parts[0].expected_time + 0.75 * parts[1].expected_time)
    assert both.delay_worst == max(part.delay_worst for part in parts)
    assert both.blind_longest == pytest.approx(1.5)
