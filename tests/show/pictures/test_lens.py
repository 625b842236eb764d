"""Directions of pixels: the projection leads back to them."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import look_at
from sqrp_cli.show.pictures.camera_image import CLOSE, directions

LENSES = {
    "none": [],
    "plumb_bob": [-0.28, 0.09, 0.001, -0.0007, -0.01],
    "rational_polynomial": [0.4, 0.1, 0.0004, -0.001, 0.02, 0.5, 0.15, 0.01],
    "equidistant": [-0.02, 0.01, -0.004, 0.001],
}


def camera(model: str, focal: float = 320.0) -> Camera:
    K = np.array([[focal, 0.0, 311.0], [0.0, 1.02 * focal, 251.0], [0.0, 0.0, 1.0]])
    X = look_at([0, 0, 0], [1, 0, 0])
    return Camera(
        name="cam",
        width=640,
        height=480,
        matrix=K,
        distortion_model=model,
        distortion=np.array(LENSES[model]),
        frame="world",
        X_FC=X,
        far=9.0,
        rate=10.0,
    )


@pytest.mark.parametrize("model", LENSES)
def test_a_direction_is_seen_at_its_pixel(model):
    projection = Projection(camera(model))
    pixels = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, 41), np.linspace(-0.5, 479.5, 31)), axis=-1).reshape(-1, 2)
    rays, shown = directions(projection, pixels)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(1.0)
    back, inside = projection.pixels(rays[shown])
    assert inside.all()
    assert np.abs(back - pixels[shown]).max() < CLOSE
    assert shown.mean() > 0.95


def test_pixels_beyond_the_reach_of_the_lens_show_nothing():
    projection = Projection(camera("plumb_bob", focal=150.0))
    _, shown = directions(projection, np.array([[311.0, 251.0], [0.0, 0.0], [639.0, 479.0]]))
    assert shown.tolist() == [True, False, False]
