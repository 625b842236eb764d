"""Moves of cameras: many that look where one does, and the least that does, against a look at every point of a grid."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.geometry import look_at
from sqrp_cli.search import least as search
from sqrp_cli.search.aiming import Aim, looking_at, turned
from sqrp_cli.search.camera_moves import CameraMove
from sqrp_cli.search.least import margin
from sqrp_cli.search.question import ProposedChange
from sqrp_cli.search.vectors import Bounds, fine_grid, shells
from tests.sight.views import make_camera

STEP = 0.01


class Fake:
    """A move whose vectors do where a function says so, with a bound that lets pass what it may."""

    def __init__(self, does, dimension: int, reach: float, bound=None) -> None:
        self.does, self.reach, self.bound = does, reach, does if bound is None else bound
        shares = (0.999, 0.99, 0.97, 0.9)
        self.bounds = Bounds(dimension, STEP, (reach,), fine=True, rounds=14, directions=20, shares=shares)

    def outward(self, reach):
        return shells(self.bounds.dimension, STEP, reach)

    def passes(self, vectors):
        return self.bound(vectors)

    def change(self, vector):
        size = float(np.linalg.norm(vector))
        return ProposedChange(kind="position", target="cam", values=tuple(vector), size=size, unit="m")

    def meets(self, change):
        return bool(self.does(np.array([change.values]))[0])


def least(does, dimension: int, reach: float = 0.5, bound=None):
    one = Fake(does, dimension, reach, bound)
    found = search.least(one, one.outward(reach), seed=0)
    if found is None:
        return None
    return np.array((search.least(one, [fine_grid(one.bounds, 0.95 * found.size)], seed=0, most=4) or found).values)


def grid(dimension: int, length: float) -> np.ndarray:
    most = int(length / STEP)
    points = STEP * np.array(list(product(range(-most, most + 1), repeat=dimension)), dtype=float)
    lengths = np.linalg.norm(points, axis=1)
    return points[(lengths > 0) & (lengths <= length)]


def beyond_a_plane(vectors):
    return vectors @ np.array([0.6, 0.0, 0.8]) > 0.107


def in_a_ball(vectors):
    """A pocket 2 cm wide."""
    return np.linalg.norm(vectors - np.array([0.05, -0.08, 0.03]), axis=1) < 0.02


def behind_a_gap(vectors):
    """Far places all around, and a near pocket which a descent from them does not reach."""
    near = np.linalg.norm(vectors - np.array([0.0, 0.0, -0.07]), axis=1) < 0.012
    return near | (vectors[:, 0] > 0.13)


@pytest.mark.parametrize(
    ("does", "exact"),
    [(beyond_a_plane, 0.107), (in_a_ball, np.linalg.norm([0.05, -0.08, 0.03]) - 0.02), (behind_a_gap, 0.058)],
)
def test_no_point_of_the_grid_within_95_percent_does(does, exact):
    found = least(does, 3)
    length = float(np.linalg.norm(found))
    assert does(found[None])[0]
    assert exact - 1e-9 <= length <= 1.05 * exact
    assert not does(grid(3, 0.95 * length)).any()


def test_directions_in_a_plane_are_searched_as_well():
    found = least(lambda vectors: vectors[:, 1] < -0.061, 2)
    assert 0.061 <= np.linalg.norm(found) < 0.062


def test_nothing_is_found_where_nothing_does():
    assert least(lambda vectors: np.zeros(len(vectors), dtype=bool), 3) is None
    assert least(lambda vectors: np.linalg.norm(vectors, axis=1) > 0.3, 3, reach=0.25) is None


def test_what_the_bound_lets_pass_is_decided():
    found = least(lambda vectors: vectors[:, 2] > 0.04, 3, bound=lambda vectors: np.ones(len(vectors), dtype=bool))
    assert 0.04 < found[2] <= np.linalg.norm(found) < 0.045


def test_a_margin_ends_where_the_change_no_longer_does():
    one = Fake(lambda vectors: (vectors[:, 0] > 0.1) & (vectors[:, 0] < 0.2), 2, 0.5)
    one.bounds = one.bounds._replace(margins=tuple(np.linspace(-0.15, 0.25, 41)))  # lengths from 0 to 0.4
    found = margin(one, one.change(np.array([0.15, 0.0])))
    assert found.less == pytest.approx(0.04)
    assert found.more == pytest.approx(0.04)


@pytest.mark.parametrize("dimension", [2, 3])
def test_shells_go_outward_and_have_every_vector_once(dimension):
    batches = list(shells(dimension, STEP, 0.5))
    lengths = [np.linalg.norm(batch, axis=1) for batch in batches]
    for inner, outer in pairwise(lengths):
        assert inner.max() < outer.min()
    together = np.concatenate(batches)
    assert len(np.unique(together.round(9), axis=0)) == len(together)
    assert np.concatenate(lengths).max() <= 0.5 * (1 + 1e-9)


COORDINATE = st.floats(-2, 2).map(lambda value: round(value, 3))
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)
UP = st.sampled_from([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -0.2, 2.0)])


@given(st.lists(st.tuples(POINT, POINT), min_size=1, max_size=5), UP)
def test_poses_are_those_of_single_cameras(pairs, up):
    pairs = [(eye, point) for eye, point in pairs if np.linalg.norm(point - eye) > 1e-2]
    if pairs:
        eyes, points = map(np.array, zip(*pairs, strict=True))
        poses = looking_at(eyes, points, np.array(up))
        expected = [look_at(eye, point, up) for eye, point in pairs]
        np.testing.assert_allclose(poses, expected, atol=1e-9)


@given(POINT, st.floats(0, 1.5), st.floats(-np.pi, np.pi))
def test_a_turn_has_the_stated_angle_and_direction_in_the_image(eye, size, direction):
    aim = Aim(np.array([0.1, 0.2, 5.0]), np.array([0.0, 0.0, 1.0]))
    angles = size * np.array([[np.cos(direction), np.sin(direction)]])
    before = look_at(eye, aim.point)
    point = turned(aim, eye, angles)[0]
    ray = (point - eye) @ before[:3, :3]
    assert np.isclose(np.linalg.norm(ray), np.linalg.norm(aim.point - eye))
    assert np.isclose(np.arccos(np.clip(ray[2] / np.linalg.norm(ray), -1, 1)), size, atol=1e-6)
    if size > 1e-3:
        right, up = ray[0], -ray[1]
        assert np.allclose([right, up] / np.hypot(right, up), angles[0] / size, atol=1e-5)


def test_the_aim_of_a_stated_orientation_leaves_it_as_it_is():
    camera = make_camera(X_FC=look_at((1.0, 0.4, 1.2), (0.1, 0.0, 0.2), (0.4, 0.1, 1.0)))
    aim = Aim.along(camera, np.array([0.2, 0.1, 0.0]))
    again = looking_at(camera.X_FC[None, :3, 3], aim.point[None], aim.up)[0]
    np.testing.assert_allclose(again, camera.X_FC, atol=1e-12)


def test_a_camera_that_moves_beside_its_aim_says_how_far_it_turns():
    camera = make_camera(X_FC=look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    aim = Aim(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    move = CameraMove(None, "position", camera)
    move.aim = aim
    sideways, towards = (move.change(np.array(vector)) for vector in ([0.0, 1.0, 0.0], [0.0, 0.0, -0.5]))
    assert np.isclose(sideways.turn, np.pi / 4)
    assert np.isclose(towards.turn, 0.0, atol=1e-9)
    assert sideways.words == f"move camera `{camera.name}` along +y 1.00 m, and turn it 45.0 deg"
    assert towards.words == f"move camera `{camera.name}` along -z 50.0 cm"
