from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.geometry import (
    BOX_SIGNS,
    axis_rotation,
    box_corners,
    inverse,
    look_at,
    matrix_to_quaternion,
    matrix_to_rpy,
    pose,
    quaternion_to_matrix,
    read_only,
    rpy_to_matrix,
    transform,
)

coordinates = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)
quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda quaternion: np.linalg.norm(quaternion) > 1e-3)
)


@given(quaternions)
def test_a_quaternion_gives_a_rotation_that_gives_it_back_and_its_negative_the_same(quaternion: np.ndarray) -> None:
    R = quaternion_to_matrix(quaternion)
    found = matrix_to_quaternion(R)
    assert found[3] >= 0
    assert np.linalg.norm(found) == pytest.approx(1.0)
    np.testing.assert_allclose(quaternion_to_matrix(found), R, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(quaternion_to_matrix(-quaternion), R, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_quaternion_about_an_axis_is_the_rotation_about_it(axis: int) -> None:
    half = 0.35
    quaternion = np.zeros(4)
    quaternion[axis], quaternion[3] = np.sin(half), np.cos(half)
    np.testing.assert_allclose(quaternion_to_matrix(quaternion), axis_rotation(axis, 2 * half), atol=1e-15)


QUARTER = np.pi / 2


@pytest.mark.parametrize(("rpy", "point", "turned"), [
    ((0, 0, QUARTER), (1, 0, 0), (0, 1, 0)), ((QUARTER, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, QUARTER, 0), (0, 0, 1), (1, 0, 0)), ((QUARTER, 0, QUARTER), (0, 1, 0), (0, 0, 1)),  # roll before yaw
])  # fmt: skip
def test_yaw_turns_x_to_y_and_roll_turns_y_to_z_and_pitch_turns_z_to_x(rpy, point, turned):
    np.testing.assert_allclose(rpy_to_matrix(rpy) @ point, turned, atol=1e-15)


@given(quaternions, coordinates, coordinates)
def test_the_inverse_of_a_pose_takes_points_back(quaternion: np.ndarray, origin: np.ndarray, point: np.ndarray) -> None:
    X_AB = pose(quaternion_to_matrix(quaternion), origin)
    np.testing.assert_allclose(transform(inverse(X_AB), transform(X_AB, point[None]))[0], point, atol=1e-9)


AXES = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
directions = st.one_of(
    st.sampled_from(AXES),
    st.tuples(*[st.sampled_from([-1.0, 0.0, 1e-12, 1e-9, 1e-6, 1.0])] * 3).map(np.array),
    st.tuples(*[st.floats(-1, 1)] * 3).map(np.array),
).filter(lambda direction: np.abs(direction).max() > 1e-6)


@given(coordinates, directions, st.one_of(directions, st.sampled_from([None, -1.0, 1.0, 1e-3])), st.floats(1e-3, 1e3))
def test_a_camera_that_looks_anywhere_with_anything_upwards_has_a_pose(
    eye: np.ndarray, direction: np.ndarray, up: np.ndarray | float | None, distance: float
) -> None:
    """`up` as a number is a multiple of the direction in which the camera looks."""
    towards = direction if up is None else up * direction if isinstance(up, float) else up
    X_WC = look_at(eye, eye + distance * direction, towards)
    forward = eye + distance * direction - eye
    seen = transform(inverse(X_WC), (eye + forward)[None])[0]
    np.testing.assert_allclose(seen, [0, 0, np.linalg.norm(forward)], atol=1e-6)
    np.testing.assert_allclose(X_WC[:3, :3].T @ X_WC[:3, :3], np.eye(3), atol=1e-14)
    assert np.linalg.det(X_WC[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(X_WC[:3, 2], forward / np.linalg.norm(forward), atol=1e-14)
    np.testing.assert_array_equal(X_WC[:3, 3], eye)
    across = np.linalg.norm(np.cross(X_WC[:3, 2], towards / np.linalg.norm(towards)))
    if across > 1e-8:
        assert X_WC[:3, 0] @ towards == pytest.approx(0.0, abs=1e-7 * np.linalg.norm(towards))
        assert X_WC[:3, 1] @ towards < 0, "the image's y axis must point away from `up`"


@pytest.mark.parametrize("direction", AXES, ids=str)
def test_a_camera_whose_up_is_where_it_looks_has_the_x_axis_upwards_or_else_the_z_axis(direction: np.ndarray) -> None:
    eye = np.array([1.0, 2.0, 3.0])
    upwards = np.array([0.0, 0.0, 1.0] if direction[0] else [1.0, 0.0, 0.0])
    for up in (direction, -direction, 1e-7 * direction, 1e5 * direction):
        np.testing.assert_allclose(look_at(eye, eye + direction, up)[:3, 1], -upwards, atol=1e-12)


@pytest.mark.parametrize(
    ("target", "up"), [((1, 2, 3), (0, 0, 1)), ((0, 0, 0), (0, 0, 0)), ((np.nan, 0, 0), (0, 0, 1))]
)
def test_there_is_no_pose_without_a_direction(target: tuple[float, ...], up: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="no direction"):
        look_at((1, 2, 3), target, up)


def test_corners_run_with_x_slowest_and_z_fastest() -> None:
    assert BOX_SIGNS[:3].tolist() == [[-1, -1, -1], [-1, -1, 1], [-1, 1, -1]]
    np.testing.assert_allclose(box_corners([2.0, 4.0, 6.0])[[0, 7]], [[-1, -2, -3], [1, 2, 3]])


def test_a_read_only_copy_cannot_be_written_and_does_not_follow_its_source() -> None:
    source = [1.0, 2.0]
    copy = read_only(source)
    source[0] = 5.0
    assert copy.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 3.0


def test_rotations_survive_being_written_as_roll_pitch_yaw() -> None:
    for rpy in product(np.radians([-180, -90, -30, 0, 45, 90, 180]), repeat=3):
        R = rpy_to_matrix(rpy)
        np.testing.assert_allclose(rpy_to_matrix(matrix_to_rpy(R)), R, atol=1e-9)
