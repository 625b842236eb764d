"""Many cameras at once look where one does."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.geometry import look_at
from sqrp_cli.search.aiming import Aim, looking_at, turned
from sqrp_cli.search.camera_moves import CameraMove
from tests.sight.views import make_camera

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
    assert sideways.words == f"move {camera.name} 1.00 m, +y, and turn it 45.0 deg"
    assert towards.words == f"move {camera.name} 50.0 cm, -z"
