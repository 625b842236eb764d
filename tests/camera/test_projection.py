"""Pixels are those of OpenCV, up to the radius at which a numeric search sees the distortion fold back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import CLOSE, Projection
from sqrp_cli.geometry import Array
from tests.sight.views import make_camera

MODELS = ("plumb_bob", "rational_polynomial", "equidistant")
SPREAD = {
    "plumb_bob": (0.4, 0.2, 2e-3, 2e-3, 0.1),
    "rational_polynomial": (0.4, 0.2, 2e-3, 2e-3, 0.1, 0.4, 0.2, 0.05),
    "equidistant": (0.15, 0.08, 0.03, 0.01),
}
"""Sizes of the coefficients that are tried, as of common lenses."""


def lens(model: str, units: Array) -> Camera:
    distortion = units[: len(SPREAD[model])] * SPREAD[model]
    return make_camera(model=model, distortion=distortion, focal=(812.3, 797.9), center=(333.3, 221.7))


def opencv_pixels(camera: Camera, points_C: Array) -> Array:
    """Pixels of points (n, 3) in the optical frame."""
    still = np.zeros(3)
    if camera.distortion_model == "equidistant":
        points = points_C.reshape(-1, 1, 3)
        pixels, _ = cv2.fisheye.projectPoints(points, still, still, camera.matrix, camera.distortion)
    else:
        pixels, _ = cv2.projectPoints(points_C, still, still, camera.matrix, camera.distortion)
    return pixels.reshape(-1, 2)


def distorted_radius(camera: Camera, radius: Array) -> Array:
    """The radial function of the models' definitions; the tangential terms have no part in it."""
    if camera.distortion_model == "equidistant":
        k1, k2, k3, k4 = camera.distortion
        angle = np.arctan(radius)
        return angle + k1 * angle**3 + k2 * angle**5 + k3 * angle**7 + k4 * angle**9
    k1, k2, _, _, k3, k4, k5, k6 = [*camera.distortion, 0.0, 0.0, 0.0][:8]
    growth = 1 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6
    with np.errstate(divide="ignore"):
        bent: Array = radius * growth / (1 + k4 * radius**2 + k5 * radius**4 + k6 * radius**6)
    return bent


def searched_radius(camera: Camera, radii: Array) -> float:
    """The first of the radii at which the next one lies no further out in the image; infinite if there is none."""
    falls = np.diff(distorted_radius(camera, radii)) <= 0
    return float(radii[falls.argmax()]) if falls.any() else float("inf")


@pytest.mark.parametrize("model", MODELS)
@given(units=st.lists(st.floats(-1, 1), min_size=8, max_size=8), seed=st.integers(0, 2**32 - 1))
def test_pixels_are_those_of_opencv(model, units, seed):
    camera = lens(model, np.array(units))
    projection = Projection(camera)
    rng = np.random.default_rng(seed)
    reach = min(0.999 * projection.radius, 1.5)
    angle, radius = rng.uniform(0, 2 * np.pi, 200), reach * np.sqrt(rng.uniform(0, 1, 200))
    plane = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(200)])
    points_C = plane * rng.uniform(0.1, 5.0, (200, 1))

    pixels, inside = projection.pixels(points_C)

    assert inside.all()
    expected = opencv_pixels(camera, points_C)
    assert np.abs(pixels - expected).max() <= 1e-6 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("model", MODELS)
@given(units=st.lists(st.floats(-1, 1), min_size=8, max_size=8))
def test_the_image_grows_with_the_radius_up_to_the_one_found_and_no_further(model, units):
    assume(model != "rational_polynomial" or (units[:2] + units[4:5]) != units[5:])  # the identity, over its own poles
    camera = lens(model, np.array(units))
    radius = Projection(camera).radius
    radii = np.linspace(0, 20, 200_001)
    found = searched_radius(camera, radii)
    if radius > 19.9:
        # A slope below rounding far out may look flat to the search.
        assert found > 10
    else:
        # The slope is zero at the radius: near it the search cannot tell the sign of a change below rounding.
        flat = abs(np.diff(distorted_radius(camera, np.array([radius, found])))[0]) if np.isfinite(found) else np.inf
        assert abs(found - radius) <= 2e-4 or flat <= 1e-9


@pytest.mark.parametrize(("model", "distortion", "radius"), [
        ("plumb_bob", (-0.1, 0, 0, 0, 0), np.sqrt(1 / 0.3)), ("plumb_bob", (0.1, 0, 0, 0, 0), np.inf),
        ("plumb_bob", (0.0, 0.0, 0.01, 0.01, 0.0), np.inf), ("rational_polynomial", (0, 0, 0, 0, 0, -0.25, 0, 0), 2.0),
        ("equidistant", (-1 / 3, 0, 0, 0), np.tan(1.0)), ("equidistant", (0, 0, 0, 0), np.inf), ("none", (), np.inf),
])  # fmt: skip
def test_radius_worked_out_by_hand(model, distortion, radius):
    assert Projection(make_camera(model=model, distortion=distortion)).radius == pytest.approx(radius)


def test_a_point_beyond_the_radius_is_reported_and_keeps_its_side():
    projection = Projection(make_camera(model="plumb_bob", distortion=(-0.3, 0, 0, 0, 0), focal=(200.0, 200.0)))
    assert projection.radius == pytest.approx(np.sqrt(1 / 0.9))
    # The lens folds this point back to u = r (1 - 0.3 r^2) = 0: right in the middle of the image.
    folded = np.array([[np.sqrt(1 / 0.3), 0.0, 1.0]])

    pixels, inside = projection.pixels(folded)

    assert not inside[0]
    assert pixels[0, 0] > 639.5


LENSES = {
    "none": (),
    "plumb_bob": (-0.28, 0.09, 0.001, -0.0007, -0.01),
    "rational_polynomial": (0.4, 0.1, 0.0004, -0.001, 0.02, 0.5, 0.15, 0.01),
    "equidistant": (-0.02, 0.01, -0.004, 0.001),
}


@pytest.mark.parametrize("model", LENSES)
def test_what_a_camera_looks_at_is_seen_at_its_pixel(model):
    camera = make_camera(model=model, distortion=LENSES[model], focal=(320.0, 326.4), center=(311.0, 251.0))
    pixels = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, 41), np.linspace(-0.5, 479.5, 31)), axis=-1).reshape(-1, 2)
    plane, shown = Projection(camera).plane(pixels)
    points = np.column_stack([plane, np.ones(len(plane))])[shown]
    assert np.abs(opencv_pixels(camera, points) - pixels[shown]).max() < CLOSE
    assert shown.mean() > 0.95


def test_at_pixels_beyond_the_reach_of_the_lens_it_looks_at_nothing():
    camera = make_camera(model="plumb_bob", distortion=LENSES["plumb_bob"], focal=(150.0, 153.0))
    _, shown = Projection(camera).plane(np.array([[319.5, 239.5], [0.0, 0.0], [639.0, 479.0]]))
    assert shown.tolist() == [True, False, False]
