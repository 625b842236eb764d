"""Penetration of oriented boxes, against laws and a sampled truth."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.checks.overlap import box_penetration, gap_from_above
from sqrp_cli.geometry import Array, box_corners, inverse, pose, quaternion_to_matrix, transform

numbers = st.floats(-1.0, 1.0)
sizes = st.tuples(*[st.floats(0.05, 0.6)] * 3).map(np.array)


@st.composite
def poses(draw: st.DrawFn) -> Array:
    quaternion = np.array([*(draw(numbers) for _ in range(3)), 1.5])
    return pose(quaternion_to_matrix(quaternion), [0.4 * draw(numbers) for _ in range(3)])


def inside(points: Array, X_WB: Array, size: Array) -> np.ndarray:
    return (np.abs(transform(inverse(X_WB), points)) < 0.5 * size).all(axis=-1)


def test_boxes_along_one_axis_penetrate_by_their_common_length() -> None:
    size = np.array([0.2, 0.2, 0.2])
    assert np.isclose(box_penetration(np.eye(4), size, pose(position=[0.15, 0.0, 0.0]), size), 0.05)
    assert np.isclose(box_penetration(np.eye(4), size, pose(position=[0.2, 0.0, 0.0]), size), 0.0)
    assert box_penetration(np.eye(4), size, pose(position=[0.3, 0.0, 0.0]), size) < 0.0


@settings(max_examples=200, deadline=None)
@given(poses(), sizes, poses(), sizes)
def test_penetration_is_symmetric_and_unchanged_by_moving_both(
    X_WA: Array, size_A: Array, X_WB: Array, size_B: Array
) -> None:
    depth = box_penetration(X_WA, size_A, X_WB, size_B)
    X_VW = pose(quaternion_to_matrix([0.3, -0.1, 0.5, 0.8]), [1.0, -2.0, 0.5])
    assert np.isclose(box_penetration(X_WB, size_B, X_WA, size_A), depth, atol=1e-12)
    assert np.isclose(box_penetration(X_VW @ X_WA, size_A, X_VW @ X_WB, size_B), depth, atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(poses(), sizes, poses(), sizes)
def test_boxes_with_a_common_point_penetrate(X_WA: Array, size_A: Array, X_WB: Array, size_B: Array) -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.499, 0.499, 9)] * 3), axis=-1).reshape(-1, 3)
    points = transform(X_WA, grid * size_A)
    if inside(points, X_WB, size_B).any():
        assert box_penetration(X_WA, size_A, X_WB, size_B) > 0.0


@settings(max_examples=200, deadline=None)
@given(poses(), sizes, poses(), sizes, st.integers(0, 2**32 - 1))
def test_no_shorter_way_than_the_penetration_separates(
    X_WA: Array, size_A: Array, X_WB: Array, size_B: Array, seed: int
) -> None:
    depth = box_penetration(X_WA, size_A, X_WB, size_B)
    if depth < 1e-6:
        return
    directions = np.random.default_rng(seed).normal(size=(40, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        moved = X_WB.copy()
        moved[:3, 3] += 0.999 * depth * direction
        assert box_penetration(X_WA, size_A, moved, size_B) > 0.0


@settings(max_examples=200, deadline=None)
@given(poses(), sizes, poses(), sizes)
def test_boxes_apart_have_no_corner_in_each_other(X_WA: Array, size_A: Array, X_WB: Array, size_B: Array) -> None:
    if box_penetration(X_WA, size_A, X_WB, size_B) <= 0.0:
        assert not inside(transform(X_WA, box_corners(size_A)), X_WB, size_B).any()
        assert not inside(transform(X_WB, box_corners(size_B)), X_WA, size_A).any()


@settings(max_examples=100, deadline=None)
@given(poses(), sizes, poses(), sizes, st.floats(-3.0, 3.0))
def test_the_gap_from_above_is_that_of_the_shadows(
    X_WA: Array, size_A: Array, X_WB: Array, size_B: Array, height: float
) -> None:
    gap = gap_from_above(X_WA, size_A, X_WB, size_B)
    raised = pose(position=[0.0, 0.0, height]) @ X_WB
    assert np.isclose(gap, gap_from_above(X_WA, size_A, raised, size_B))
    if gap > 1e-9:
        assert box_penetration(X_WA, size_A, raised, size_B) <= 0.0
    else:  # then no vertical plane is between them
        angles = np.linspace(0.0, 2 * np.pi, 90)
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        one, other = (transform(X, box_corners(s))[:, :2] @ normals.T for X, s in ((X_WA, size_A), (X_WB, size_B)))
        assert (other.min(axis=0) - one.max(axis=0) <= gap + 1e-9).all()


def test_the_gap_from_above_of_boxes_along_one_axis_is_what_is_between_them() -> None:
    size = np.array([0.2, 0.2, 0.2])
    assert np.isclose(gap_from_above(np.eye(4), size, pose(position=[0.3, 0.0, 5.0]), size), 0.1)
    assert gap_from_above(np.eye(4), size, pose(position=[0.1, 0.1, 5.0]), size) < 0.0
