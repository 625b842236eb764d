"""Penetration of oriented boxes, against laws and a sampled truth."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.geometry import Array, box_corners, inverse, pose, quaternion_to_matrix, transform
from sqrp_cli.shapes import PlacedBox

numbers = st.floats(-1.0, 1.0)
sizes = st.tuples(*[st.floats(0.05, 0.6)] * 3).map(np.array)


@st.composite
def poses(draw: st.DrawFn) -> Array:
    quaternion = np.array([*(draw(numbers) for _ in range(3)), 1.5])
    return pose(quaternion_to_matrix(quaternion), [0.4 * draw(numbers) for _ in range(3)])


boxes = st.builds(PlacedBox, poses(), sizes)


def corners(box: PlacedBox) -> Array:
    return transform(box.X_WB, box_corners(box.size))


def inside(points: Array, box: PlacedBox) -> np.ndarray:
    return (np.abs(transform(inverse(box.X_WB), points)) < 0.5 * box.size).all(axis=-1)


def moved(box: PlacedBox, X: Array) -> PlacedBox:
    return PlacedBox(X @ box.X_WB, box.size)


def cube_at(*position: float) -> PlacedBox:
    return PlacedBox(pose(position=position), np.array([0.2, 0.2, 0.2]))


def test_boxes_along_one_axis_penetrate_by_their_common_length() -> None:
    assert np.isclose(-cube_at(0.0, 0.0, 0.0).gap(cube_at(0.15, 0.0, 0.0)), 0.05)
    assert np.isclose(-cube_at(0.0, 0.0, 0.0).gap(cube_at(0.2, 0.0, 0.0)), 0.0)
    assert -cube_at(0.0, 0.0, 0.0).gap(cube_at(0.3, 0.0, 0.0)) < 0.0


@settings(max_examples=60, deadline=None)
@given(boxes, boxes)
def test_penetration_is_symmetric_and_unchanged_by_moving_both(a: PlacedBox, b: PlacedBox) -> None:
    depth = -a.gap(b)
    X_VW = pose(quaternion_to_matrix([0.3, -0.1, 0.5, 0.8]), [1.0, -2.0, 0.5])
    assert np.isclose(-b.gap(a), depth, atol=1e-12)
    assert np.isclose(-moved(a, X_VW).gap(moved(b, X_VW)), depth, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(boxes, boxes)
def test_boxes_with_a_common_point_penetrate(a: PlacedBox, b: PlacedBox) -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.4999, 0.4999, 9)] * 3), axis=-1).reshape(-1, 3)
    points = transform(a.X_WB, grid * a.size)
    if inside(points, b).any():
        assert -a.gap(b) > 0.0


@settings(max_examples=60, deadline=None)
@given(boxes, boxes, st.integers(0, 2**32 - 1))
def test_no_shorter_way_than_the_penetration_separates(a: PlacedBox, b: PlacedBox, seed: int) -> None:
    depth = -a.gap(b)
    if depth < 1e-6:
        return
    directions = np.random.default_rng(seed).normal(size=(40, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        assert -a.gap(moved(b, pose(position=0.999 * depth * direction))) > 0.0


@settings(max_examples=40, deadline=None)
@given(boxes, boxes, st.floats(-3.0, 3.0))
def test_the_gap_from_above_is_that_of_the_shadows(a: PlacedBox, b: PlacedBox, height: float) -> None:
    gap = a.gap(b, from_above=True)
    raised = moved(b, pose(position=[0.0, 0.0, height]))
    assert np.isclose(gap, a.gap(raised, from_above=True))
    if gap > 1e-9:
        assert -a.gap(raised) <= 0.0
    else:  # then no vertical plane is between them
        angles = np.linspace(0.0, 2 * np.pi, 90)
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        one, other = (corners(box)[:, :2] @ normals.T for box in (a, b))
        assert (other.min(axis=0) - one.max(axis=0) <= gap + 1e-9).all()


def test_the_gap_from_above_of_boxes_along_one_axis_is_what_is_between_them() -> None:
    assert np.isclose(cube_at(0.0, 0.0, 0.0).gap(cube_at(0.3, 0.0, 5.0), from_above=True), 0.1)
    assert cube_at(0.0, 0.0, 0.0).gap(cube_at(0.1, 0.1, 5.0), from_above=True) < 0.0
