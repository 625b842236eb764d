"""Laws of paths, laws of time and trajectories."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.trajectory import JointPath, PiecewiseCubic, Trajectory


def bumpy_path(seed: int, pieces: int = 3, degree: int = 5, joints: int = 4) -> JointPath:
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.sort(rng.uniform(0.1, 0.9, pieces - 1)), [1.0]])
    return JointPath(breaks, rng.normal(size=(pieces, degree + 1, joints)))


def smooth_trajectory(seed: int) -> Trajectory:
    """One polynomial piece under s(t) = 3u^2 - 2u^3 with u = t / 2."""
    law = PiecewiseCubic(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 3 / 4, -2 / 8]]))
    return Trajectory(bumpy_path(seed, pieces=1), law)


@given(st.integers(0, 1000), st.sampled_from([1, 2, 3]))
def test_derivatives_agree_with_finite_differences_of_the_order_below(seed: int, order: int) -> None:
    trajectory = smooth_trajectory(seed)
    t, h = np.linspace(0.1, 1.9, 40), 1e-5
    below = trajectory.positions if order == 1 else lambda t: trajectory.motion(t, order - 1)[order - 1]
    difference = (below(t + h) - below(t - h)) / (2 * h)
    scale = np.abs(trajectory.motion(t, order)[order]).max()
    np.testing.assert_allclose(trajectory.motion(t, order)[order], difference, atol=1e-6 * scale)


@given(st.integers(0, 1000))
def test_path_derivatives_agree_with_finite_differences_within_every_piece(seed: int) -> None:
    path = bumpy_path(seed)
    s = np.concatenate([np.linspace(a + 0.01, b - 0.01, 9) for a, b in zip(path.breaks, path.breaks[1:], strict=False)])
    s = s[np.abs(s[:, None] - path.breaks).min(axis=1) > 1e-5]
    h = 1e-6
    difference = (path.positions(s + h) - path.positions(s - h)) / (2 * h)
    np.testing.assert_allclose(path.derivatives(s, 1), difference, rtol=1e-4, atol=1e-4 * np.abs(difference).max())


@given(st.integers(0, 1000), st.sampled_from([1, 2, 3]))
def test_derivative_bounds_hold_everywhere(seed: int, order: int) -> None:
    path = bumpy_path(seed)
    for piece, bound in enumerate(path.derivative_bounds(order)):
        s = np.linspace(path.breaks[piece], np.nextafter(path.breaks[piece + 1], 0), 101)
        assert (np.abs(path.derivatives(s, order)) <= bound * (1 + 1e-9)).all()


def test_the_end_of_a_path_is_its_last_position_and_a_line_is_straight_with_an_exact_bound() -> None:
    path, s = bumpy_path(3), np.linspace(0, 1, 11)
    np.testing.assert_allclose(path.end, path.positions([1.0])[0], atol=1e-14)
    q0, q1 = np.array([0.0, 1.0, 3.0]), np.array([2.0, -3.0, 3.0])
    line = JointPath.line(q0, q1)
    np.testing.assert_allclose(line.positions(s), q0 + s[:, None] * (q1 - q0), atol=1e-15)
    np.testing.assert_allclose(line.derivative_bounds(), [[2.0, 4.0, 0.0]])


def test_a_trajectory_holds_its_ends_outside_its_duration() -> None:
    trajectory = smooth_trajectory(0)
    ends = trajectory.path.positions([0.0, 1.0])
    np.testing.assert_allclose(trajectory.positions([-1.0, 99.0]), ends)


@given(st.floats(0.1, 10), st.floats(0, 1))
def test_stretching_a_law_divides_its_derivatives_by_powers_and_time_at_inverts_it(factor: float, s: float) -> None:
    law = smooth_trajectory(1).law
    t = np.linspace(0.01, 1.99, 20)
    expected = law.derivatives(t) / factor ** np.arange(4)[:, None]
    np.testing.assert_allclose(law.stretched(factor).derivatives(t * factor), expected, rtol=1e-9, atol=1e-12)
    assert law.derivatives([law.time_at(s)])[0, 0] == pytest.approx(s, abs=1e-12)


def test_a_standstill_stays_and_lasts() -> None:
    trajectory = Trajectory.standstill([0.5, -1.0], 1.5)
    t = np.linspace(0, 1.5, 7)
    assert trajectory.duration == 1.5
    np.testing.assert_array_equal(trajectory.positions(t), np.tile([0.5, -1.0], (7, 1)))
    for order in (1, 2, 3):
        np.testing.assert_array_equal(trajectory.motion(t, order)[order], np.zeros((7, 2)))


@given(st.integers(0, 1000))
def test_numbers_written_as_json_give_the_same_trajectory_bit_for_bit(seed: int) -> None:
    trajectory = smooth_trajectory(seed)
    again = Trajectory.from_numbers(json.loads(json.dumps(trajectory.to_numbers())))
    t = np.linspace(0, 2, 101)
    np.testing.assert_array_equal(again.positions(t), trajectory.positions(t))


def test_shifting_a_path_moves_its_positions_only() -> None:
    path, s, offset = bumpy_path(3), np.linspace(0, 1, 20), [1.0, 0.0, -2.0, 0.0]
    shifted = path.shifted(offset)
    np.testing.assert_allclose(shifted.positions(s) - path.positions(s), np.tile(offset, (20, 1)), atol=1e-12)
    np.testing.assert_array_equal(shifted.derivatives(s, 1), path.derivatives(s, 1))


def test_an_unknown_order_is_refused() -> None:
    with pytest.raises(ValueError, match="1, 2 or 3"):
        smooth_trajectory(0).motion([0.0], 4)[4]


def test_one_motion_after_another_is_each_in_turn() -> None:
    law = PiecewiseCubic(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 0.75, -0.25]]))  # from rest to rest
    first = Trajectory(JointPath.line([0.0, 1.0], [2.0, 0.0]), law)
    second = Trajectory(JointPath.line([2.0, 0.0], [2.0, 5.0]), law.stretched(1.5))
    both = first.followed_by(second)
    assert both.duration == pytest.approx(5.0)
    t = np.linspace(0.0, 2.0, 41)
    np.testing.assert_allclose(both.positions(t), first.positions(t), atol=1e-12)
    np.testing.assert_allclose(both.positions(2.0 + 1.5 * t), second.positions(1.5 * t), atol=1e-12)
    for order in (1, 2):
        inside = t[1:-1]
        np.testing.assert_allclose(both.motion(inside, order)[order], first.motion(inside, order)[order], atol=1e-12)
    standing = Trajectory.standstill([2.0, 0.0], 0.0)
    assert first.followed_by(standing) is first
    assert standing.followed_by(second) is second
