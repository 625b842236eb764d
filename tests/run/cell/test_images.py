"""What simulated cameras show, against the camera model of the sensing and the kinematics of the arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import Light
from sqrp_cli.camera.markers import ObjectMarker
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, axis_rotation, inverse, pose, transform
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.run.cell.mujoco_model import build_model
from sqrp_cli.run.cell.render_pool import start_drawing
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.perception.vision import find_markers
from sqrp_cli.shapes import Sphere
from tests.run.cell.scenes import TABLE, camera, cell, empty, thing, workspace, world

AWAY = (2.0, 0.6, 0.5)
"""Seen from where cameras stand, there is no robot in this direction."""
LENSES = {
    "pinhole": camera(target=AWAY),
    "decentred": camera(target=AWAY, center=(280.3, 261.8), focal=(590.0, 610.0)),
    "barrel": camera(target=AWAY, lens=("plumb_bob", (-0.28, 0.09, 0.001, -0.0015, -0.01))),
    "pincushion": camera(target=AWAY, lens=("plumb_bob", (0.18, -0.05, -0.001, 0.002, 0.0))),
    "rational": camera(target=AWAY, lens=("rational_polynomial", (0.4, -0.2, 0.001, 0.0005, 0.02, 0.7, -0.1, 0.01))),
    "fisheye": camera(target=AWAY, lens=("equidistant", (0.03, -0.01, 0.004, -0.001)), focal=(420.0, 420.0)),
}


@contextmanager
def drawing(
    things: Sequence[SceneObject],
    cameras: Sequence[Camera],
    seed: int = 0,
    *,
    base: Workspace | None = None,
    joints: dict[str, float] | None = None,
) -> Iterator[Renderer]:
    """A renderer of some things, with the robot of a workspace at home, or where joints are told."""
    base = cell(base or empty(), things, cameras)
    physics = SimulatedCell(base, world(base, joints))
    renderer = Renderer(physics.model, cameras, seed)
    renderer.move(physics.positions)
    try:
        yield renderer
    finally:
        renderer.close()


def blobs(image: NDArray[np.uint8]) -> Array:
    """Centres [pixels] of the patches of saturated colour, (x, y) each, shape (n, 2)."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    colourful = (hsv[..., 1] > 120) & (hsv[..., 2] > 60)
    centers = cv2.connectedComponentsWithStats(colourful.astype(np.uint8))[3]
    return centers[1:]


@pytest.mark.parametrize("lens", LENSES)
def test_balls_appear_where_the_camera_model_projects_them(lens: str) -> None:
    """Pixels are counted, so a ball's centre is good to some tenths of a pixel, and the mean of many to a tenth."""
    eye = LENSES[lens]
    grid = np.array([(x, y, 0.0) for x in np.linspace(-0.34, 0.34, 6) for y in np.linspace(-0.24, 0.24, 5)])
    centers_C = grid + np.random.default_rng(1).uniform((-0.02, -0.02, 0.9), (0.02, 0.02, 1.1), (30, 3))
    expected, inside = Projection(eye).pixels(centers_C)
    assert inside.all()
    balls = [
        thing(f"ball{k}", center.tolist(), (0.036, 0.036, 0.036), shape=Sphere(0.018), fixed=True)
        for k, center in enumerate(transform(eye.X_FC, centers_C))
    ]
    with drawing(balls, [eye]) as renderer:
        seen = blobs(renderer.image("cam", 0.0))
    errors = np.array([min(seen - pixel, key=np.linalg.norm) for pixel in expected])
    assert len(seen) == 30
    assert np.linalg.norm(errors, axis=1).max() < 0.6
    assert np.abs(errors.mean(axis=0)).max() < 0.1


def test_a_pixel_beyond_the_lens_is_black() -> None:
    """This lens folds back at a radius of 1 / sqrt(3 * 0.6), which projects to 2/3 of that: 298 pixels off the axis."""
    folding = camera(lens=("plumb_bob", (-0.6, 0.0, 0.0, 0.0, 0.0)))
    with drawing([TABLE], [folding]) as renderer:
        image = renderer.image("cam", 0.0)
    v, u = np.mgrid[0:480, 0:640]
    radius = np.hypot(u - 319.5, v - 239.5)
    assert image[radius > 300].mean() < 3.0
    assert image[radius < 295].min() > 3


def test_a_camera_on_a_link_moves_with_it() -> None:
    X_LC, base, point_C = (
        pose(axis_rotation(0, 0.3), (0.05, 0.02, 0.03)),
        workspace("workspaces/tabletop"),
        [0.06, -0.04, 0.35],
    )
    eye, model = camera(frame="tool0", X_FC=X_LC), RobotModel.load(base.robot)
    q = model.home + np.array([0.4, 0.2, -0.3, 0.1, 0.2, 0.5])
    X_WC = model.link_poses(q[None])["tool0"][0] @ X_LC
    at = transform(X_WC, np.array([point_C]))[0].tolist()
    ball = thing("ball", at, (0.02,) * 3, shape=Sphere(0.01), fixed=True)
    with drawing([ball], [eye], base=base, joints=dict(zip(model.arm, q, strict=True))) as renderer:
        (seen,) = blobs(renderer.image("cam", 0.0))
    assert np.linalg.norm(seen - Projection(eye).pixels(np.array(point_C))[0]) < 0.3


def test_processes_draw_what_one_process_draws() -> None:
    base = workspace("workspaces/tabletop")
    cameras = tuple(base.cameras.values())
    with drawing(tuple(base.objects.values()), cameras, 7, base=base) as renderer:
        pool = start_drawing(renderer._model, cameras, 7)
        for t in (0.0, 0.1):
            drawn = pool.map([(eye.name, renderer._data.qpos, t) for eye in cameras])
            for eye, image in zip(cameras, drawn, strict=True):
                assert np.array_equal(image, renderer.image(eye.name, t))
        pool.close()


def test_noise_depends_on_seed_camera_and_time_alone_and_is_never_that_of_the_image_before() -> None:
    eyes = [camera("cam"), camera("other")]
    with drawing([TABLE], eyes, seed=3) as first, drawing([TABLE], eyes, seed=3) as second:
        image = first.image("cam", 0.1)
        second.image("cam", 0.0)
        assert np.array_equal(image, second.image("cam", 0.1))
        for other in (first.image("cam", 0.2), first.image("other", 0.1)):
            difference = image.astype(float) - other
            assert 1.5 < difference[200:, :].std() < 3.0  # two noises of 1.5
    small = camera("cam", size=(64, 48))
    with drawing([TABLE], eyes, seed=4) as third, drawing([TABLE], [small]) as fourth:
        assert not np.array_equal(image, third.image("cam", 0.1))
        fourth._rendered = lambda *_: np.full((48, 64, 3), 128, dtype=np.uint8)
        images = [fourth.image("cam", number / small.rate) for number in range(5000)]
    assert not any(np.array_equal(one, following) for one, following in pairwise(images))


@pytest.mark.parametrize(
    ("name", "constant", "turn"),
    [
        *(("original", cv2.aruco.DICT_ARUCO_ORIGINAL, turn) for turn in (0.0, 0.7, 2.5)),
        *((name, getattr(cv2.aruco, f"DICT_{kind}"), 0.0) for name, kind in (
            ("4x4_50", "4X4_50"), ("7x7_1000", "7X7_1000"), ("apriltag_36h11", "APRILTAG_36h11"),
            ("apriltag_16h5", "APRILTAG_16h5"), ("aruco_mip_36h12", "ARUCO_MIP_36h12"))),
    ],
)  # fmt: skip
def test_a_marker_lies_on_top_of_its_object_the_right_way_round(name: str, constant: int, turn: float) -> None:
    marker: int | ObjectMarker = 23 if name == "original" else ObjectMarker(id=23, dictionary=name, side=0.06)
    size, rotation = (0.09, 0.12, 0.1), axis_rotation(2, turn)
    plate = thing("plate", (0.3, 0.1, 0.05), size, color="white", marker=marker, rotation=rotation)
    eye = camera(eye=(0.6, 0.3, 0.7))
    with drawing([TABLE, plate], [eye]) as renderer:
        image = renderer.image("cam", 0.0)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(constant), settings)
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    assert ids is not None
    assert ids.ravel().tolist() == [23]
    assert plate.X_WO is not None
    # OpenCV's corners: upper left first, clockwise, as one who looks at the marker sees it.
    half = 0.035 if name == "original" else 0.03
    square = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) + [0, 0, 0.05]
    expected, _ = Projection(eye).pixels(transform(inverse(eye.X_FC) @ plate.X_WO, square))
    assert np.abs(corners[0][0] - expected).max() < 1.0
    ((number, corners),) = find_markers(image, *(() if name == "original" else (name,)))
    assert number == 23
    assert np.abs(corners - expected).max() < 1.0
    assert [one for one, _ in find_markers(image)] == ([23] if name == "original" else [])


def test_only_things_with_a_colour_are_colourful() -> None:
    base = workspace("workspaces/tabletop")
    plain = [item for item in base.objects.values() if item.color == "grey"]
    eyes = tuple(base.cameras.values())
    with drawing(plain, eyes, base=base) as renderer:
        for eye in eyes:
            hue_free = cv2.cvtColor(cv2.GaussianBlur(renderer.image(eye.name, 0.0), (5, 5), 0), cv2.COLOR_RGB2HSV)
            assert hue_free[..., 1].max() < 60


@pytest.mark.parametrize(("color", "hue"), [("red", 0), ("orange", 15), ("yellow", 28), ("green", 60), ("cyan", 92),
                                            ("blue", 117), ("purple", 137), ("magenta", 157)])  # fmt: skip
def test_a_colour_keeps_its_hue_on_every_side(color: str, hue: int) -> None:
    """Hues in OpenCV's half degrees."""
    cube = thing("cube", (0.3, 0.1, 0.05), (0.1, 0.1, 0.1), color=color)
    eyes = [camera(f"cam{k}", eye=(0.3 + np.cos(k), 0.1 + np.sin(k), 0.4), target=(0.3, 0.1, 0.05)) for k in (0, 2, 4)]
    with drawing([TABLE, cube], eyes) as renderer:
        for eye in eyes:
            hsv = cv2.cvtColor(renderer.image(eye.name, 0.0), cv2.COLOR_RGB2HSV)
            middle = hsv[225:255, 305:335].reshape(-1, 3)
            turn = (middle[:, 0].astype(int) - hue + 90) % 180 - 90
            assert np.abs(turn).max() <= 6
            assert middle[:, 1].min() > 110
            assert middle[:, 2].min() > 50


def test_each_of_eight_lamps_is_drawn() -> None:
    """Each lights a plate of its own, which is dark without it."""
    spots = [(x, y, 0.0) for x in (0.45, 0.6, 0.75, 0.9) for y in (-0.1, 0.1)]
    lamps = {
        f"lamp{number}": Light(intensity=1.0, position=(x, y, 1.0), look_at=(x, y, 0.0), beam=np.radians(6))
        for number, (x, y, _) in enumerate(spots)
    }
    eye = camera(eye=(0.65, -0.5, 0.9), target=(0.65, 0.0, 0.0), size=(160, 120), focal=(150.0, 150.0))
    pixels = Projection(eye).pixels(transform(inverse(eye.X_FC), np.array(spots)))[0].round().astype(int)
    plates = [thing(f"plate{k}", spot, (0.04, 0.04, 0.001), color=None, fixed=True) for k, spot in enumerate(spots)]
    for dark in (None, "lamp0", "lamp7"):
        lights = {name: lamp for name, lamp in lamps.items() if name != dark}
        with drawing(plates, [eye], base=replace(empty(), lights=lights)) as renderer:
            lit = renderer.image("cam", 0.0)[pixels[:, 1], pixels[:, 0]].max(axis=1) > 100
        assert lit.tolist() == [name != dark for name in lamps]


def test_an_object_of_unknown_place_is_not_there() -> None:
    base = workspace("workspaces/tabletop")
    somewhere = {name: X for name, X in world(base).X_WO.items() if name != "g2"}
    model = build_model(base, somewhere)
    assert "g2" not in {model.body(index).name for index in range(model.nbody)}
