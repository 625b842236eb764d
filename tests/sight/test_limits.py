"""Every limit of camera and detector, and their order, against the plain reference and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import Detector
from sqrp_cli.geometry import Array, pose
from sqrp_cli.sight.limits import SIDES, Cause
from sqrp_cli.sight.targets import SoughtBox
from tests.sight import reference
from tests.sight.reference import Verdict
from tests.sight.views import look, make_box, make_camera, make_detector, random_rotation

Case = tuple[Camera, Detector, tuple[float, ...], Array, Array | None]
"""A camera, the limits, size, pose in the optical frame and normal of a box."""


def random_case(seed: int) -> Case:
    """Each limit fails now and then."""
    rng = np.random.default_rng(seed)
    distortion = rng.uniform(-1, 1, 5) * (0.3, 0.1, 1e-3, 1e-3, 0.02)
    bent = rng.random() < 0.5
    camera = make_camera(
        model="plumb_bob" if bent else "none",
        distortion=distortion if bent else (),
        focal=tuple(rng.uniform(300, 900, 2)),
        center=(rng.uniform(250, 390), rng.uniform(180, 300)),
        near=rng.uniform(0.0, 0.4),
        far=rng.uniform(1.2, 4.0),
    )
    detector = make_detector(
        distance=(rng.uniform(0.0, 0.5), rng.uniform(1.0, 4.0)),
        max_incidence=rng.uniform(0.3, np.pi / 2),
        min_pixels=rng.uniform(0.0, 60.0),
    )
    depth = rng.uniform(-0.1, 2.5)
    center = (depth * rng.uniform(-0.5, 0.5), depth * rng.uniform(-0.4, 0.4), depth)
    X_CB = pose(random_rotation(rng), center)
    normal = random_rotation(rng)[0] if rng.random() < 0.5 else None
    return camera, detector, tuple(rng.uniform(0.001, 0.25, 3).tolist()), X_CB, normal


def boxed(detector: Detector, size: tuple[float, ...], normal: Array | None) -> SoughtBox:
    return make_box(size, frame="thing", detector=detector, normal=normal if normal is None else tuple(normal.tolist()))


def verdict(
    camera: Camera, detector: Detector, size: tuple[float, ...], X_CB: Array, normal: Array | None
) -> tuple[Cause, str | None, float]:
    found = look(camera, boxed(detector, size, normal), frames={"thing": X_CB[None]})
    cause = Cause(int(found.cause[0, 0]))
    side = SIDES[found.by[0, 0]] if cause is Cause.OUT_OF_IMAGE else None
    assert cause is Cause.OUT_OF_IMAGE or found.by[0, 0] == -1
    return cause, side, float(found.figure[0, 0])


def said(camera: Camera, detector: Detector, size: tuple[float, ...], X_CB: Array, normal: Array | None) -> Verdict:
    frames = {"world": pose(), "thing": X_CB}
    return reference.limit(reference.Scene(camera, boxed(detector, size, normal), (), frames))


@given(seed=st.integers(0, 2**32 - 1))
def test_cause_side_and_figure_are_those_of_the_specification(seed: int) -> None:
    expected = said(*random_case(seed))
    assume(expected.sure)
    found = verdict(*random_case(seed))
    assert found == (expected.cause, expected.by, pytest.approx(expected.figure, abs=1e-6))


def test_every_limit_that_needs_no_scene_is_reached_by_the_cases_above() -> None:
    assert {said(*random_case(seed)).cause for seed in range(300)} == {one for one in Cause if one < Cause.HIDDEN}


def at(*position: float) -> Array:
    return pose(position=position)


PLAIN = make_camera(near=0.2, far=2.0)
DETECTOR = make_detector(distance=(0.4, 1.5), max_incidence=1.0, min_pixels=20.0)
SIDE = 0.04


@pytest.mark.parametrize(
    ("X_CB", "cause", "side", "figure"),
    [
        (at(0, 0, 0.01), Cause.BEHIND, None, 0.01),
        (at(0, 0, 0.02), Cause.BEHIND, None, 0.0),
        (at(0, 0, 0.03), Cause.TOO_NEAR, None, 0.2 - (0.03 - 0.02)),
        (at(0, 0, 0.2), Cause.TOO_NEAR, None, 0.02),
        (at(0, 0, -1.0), Cause.BEHIND, None, 1.02),
        (at(0, 0, 2.01), Cause.TOO_FAR, None, 0.03),
        (at(5.0, 0, 2.1), Cause.TOO_FAR, None, 0.12),
        (at(-1.0, 0, 1.02), Cause.OUT_OF_IMAGE, "left", 600 * 1.02 - 319.5 - 0.5),
        (at(1.0, 0, 1.02), Cause.OUT_OF_IMAGE, "right", 600 * 1.02 + 319.5 - 639.5),
        (at(0, -1.0, 1.02), Cause.OUT_OF_IMAGE, "top", 600 * 1.02 - 239.5 - 0.5),
        (at(0, 1.0, 1.02), Cause.OUT_OF_IMAGE, "bottom", 600 * 1.02 + 239.5 - 479.5),
        (at(0, 0, 0.35), Cause.DETECTOR_NEAR, None, 0.05),
        (at(0, 0, 1.7), Cause.DETECTOR_FAR, None, 0.2),
        (at(0, 0, 1.3), Cause.TOO_SMALL, None, 20 - 600 * 0.04 / 1.28),
        (at(0, 0, 1.0), Cause.NONE, None, 0.0),
    ],
)
def test_figures_worked_out_by_hand(X_CB: Array, cause: Cause, side: str | None, figure: float) -> None:
    found = verdict(PLAIN, DETECTOR, (SIDE, SIDE, SIDE), X_CB, None)
    assert found == (cause, side, pytest.approx(figure))


def test_a_normal_that_points_away_is_oblique_and_none_is_exempt() -> None:
    away, towards = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
    size = (SIDE, SIDE, 0.001)
    assert verdict(PLAIN, DETECTOR, size, at(0, 0, 1), away) == (Cause.OBLIQUE, None, pytest.approx(np.pi - 1.0))
    assert verdict(PLAIN, DETECTOR, size, at(0, 0, 1), towards)[0] is Cause.NONE
    assert verdict(PLAIN, DETECTOR, size, at(0, 0, 1), None)[0] is Cause.NONE


@pytest.mark.parametrize("edge", [-0.5, 639.5])
def test_the_image_reaches_half_a_pixel_beyond_the_outer_centres(edge: float) -> None:
    """The corner farthest out lies just inside, then just outside."""
    depth, half = 1.0, 0.005
    sign = -1 if edge < 0 else 1
    x = (edge - 319.5) / 600 * (depth - half) - sign * half
    for shift, cause in ((-1e-9, Cause.NONE), (1e-9, Cause.OUT_OF_IMAGE)):
        detector = make_detector()
        assert verdict(PLAIN, detector, (2 * half,) * 3, at(x + sign * shift, 0, depth), None)[0] is cause
