"""Visible shares against random rays that are traced one by one through the same triangles, by other formulas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, look_at, pose, quaternion_to_matrix, transform
from sqrp_cli.shapes import BOX_TRIANGLES
from sqrp_cli.sight.sight_scene import SKIN
from sqrp_cli.sight.solids import Solid
from tests.sight.plain_geometry import hits, through_box
from tests.sight.views import look, make_box, make_camera, make_detector, random_rotation, solid_of

RAYS = 20_000
"""Of a reference: its standard deviation is at most 0.35 points."""

CLOSE = 0.012
"""How far a share may be from its reference: three standard deviations, and what the grid may be off."""


def share(solids: list[Solid], X_WC: Array, X_WB: Array, size: Array) -> float:
    camera = make_camera(X_WC, focal=(60.0, 60.0))
    box = make_box(tuple((size + 2 * SKIN).tolist()), X_WB, detector=make_detector(0.001))
    return float(look(camera, box, solids).visible[0, 0])


def traced(solids: list[Solid], X_WC: Array, X_WB: Array, size: Array) -> float:
    """The share by rays through random points of the outline of the box in the image."""
    generator = np.random.default_rng(5)
    corners = transform(inverse(X_WC) @ X_WB, 0.5 * size * BOX_SIGNS)
    image = corners[:, :2] / corners[:, 2:]
    outline = image[ConvexHull(image).vertices]
    a, b, c = outline[0], outline[1:-1], outline[2:]  # a fan of triangles
    areas = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    of, (u, v) = generator.choice(len(areas), RAYS, p=areas / areas.sum()), generator.uniform(size=(2, RAYS, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    rays = np.append(a + u * (b - a)[of] + v * (c - a)[of], np.ones((RAYS, 1)), axis=1) @ X_WC[:3, :3].T
    _, leaves = through_box(X_WC[:3, 3], rays, X_WB, size / 2, np.zeros(3))
    met = [hits(X_WC[:3, 3], rays, solid.vertices[solid.triangles]) for solid in solids]
    return float((np.min(met, axis=0) >= leaves).mean())


def view(generator: np.random.Generator) -> tuple[Array, Array, Array]:
    """A camera, a box that it looks at from 0.4 to 1.5 m, and the box's size."""
    size = generator.uniform(0.02, 0.3, 3)
    X_WB = pose(random_rotation(generator), generator.normal(scale=0.2, size=3))
    direction = generator.normal(size=3)
    eye = X_WB[:3, 3] + direction / np.linalg.norm(direction) * generator.uniform(0.4, 1.5)
    return look_at(eye, X_WB[:3, 3] + generator.normal(scale=0.05, size=3)), X_WB, size


@pytest.mark.parametrize("inside_out", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_closed_box_around_the_camera_blocks_what_single_rays_say(seed: int, *, inside_out: bool) -> None:
    generator = np.random.default_rng(200 + seed)
    X_WC, X_WB, size = view(generator)
    apart = np.linalg.norm(X_WB[:3, 3] - X_WC[:3, 3]) + generator.uniform(-0.5, 0.5) * size.min()
    X_WO = X_WC @ pose(quaternion_to_matrix([*generator.normal(scale=0.2, size=3), 1.0]))
    triangles = BOX_TRIANGLES[:, ::-1] if inside_out else BOX_TRIANGLES
    solid = solid_of(transform(X_WO, apart * BOX_SIGNS), triangles)
    assert share([solid], X_WC, X_WB, size) == pytest.approx(traced([solid], X_WC, X_WB, size), abs=CLOSE)


def test_an_open_shell_blocks_from_both_sides() -> None:
    X_WC, X_WB, size = look_at([0.0, -1.0, 0.0], [0.0, 0.0, 0.0]), pose(), np.full(3, 0.1)
    sheet = np.array([[-0.2, -0.3, 0.0], [0.2, -0.3, 0.0], [0.2, -0.3, 0.2], [-0.2, -0.3, 0.2]])
    for triangles in ([[0, 1, 2], [0, 2, 3]], [[2, 1, 0], [3, 2, 0]], [[0, 1, 2], [3, 2, 0]]):
        solid = solid_of(sheet, np.array(triangles))
        assert share([solid], X_WC, X_WB, size) == pytest.approx(0.5, abs=0.01)


def test_what_is_level_with_the_image_is_as_exact_as_what_is_not() -> None:
    X_WC, X_WB, size = look_at([0.0, -1.0, 0.0], [0.0, 0.0, 0.0]), pose(), np.array([0.1, 1e-3, 0.1])
    for height in np.linspace(-0.045, 0.045, 37):
        sheet = np.array([[-0.2, -0.5, 0.5 * height], [0.2, -0.5, 0.5 * height], [0.2, -0.5, 0.2], [-0.2, -0.5, 0.2]])
        seen = share([solid_of(sheet, np.array([[0, 1, 2], [0, 2, 3]]))], X_WC, X_WB, size)
        assert seen == pytest.approx(0.5 + height / 0.1, abs=0.005)


@pytest.mark.parametrize("size", [(0.2, 0.004, 0.004), (0.1, 0.1, 0.0002), (0.3, 0.01, 0.01), (0.2, 0.002, 0.002)])
def test_thin_boxes_are_measured_as_exactly_as_others(size: tuple[float, float, float]) -> None:
    generator = np.random.default_rng(11)
    X_WC, extents = look_at([0.0, -1.0, 0.0], [0.0, 0.0, 0.0]), np.array(size)
    for _ in range(4):
        X_WB = pose(random_rotation(generator), generator.normal(scale=0.05, size=3))
        cut = generator.uniform(-0.3, 0.3) * size[0]
        across = transform(X_WB, np.array([[cut, -9.0, -9.0], [cut, -9.0, 9.0], [cut, 9.0, -9.0], [cut, 9.0, 9.0]]))
        sheet = solid_of(across, np.array([[0, 1, 2], [2, 1, 3]]))
        seen = share([sheet], X_WC, X_WB, extents)
        assert seen == pytest.approx(traced([sheet], X_WC, X_WB, extents), abs=CLOSE)
