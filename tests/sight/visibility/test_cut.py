"""What the image's edge leaves of a box, where detectors usually judge that, against counted rays."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.camera.camera import Camera, DistortionModel
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import BOX_SIGNS, Array, pose, transform
from sqrp_cli.logic.literal import Atom
from sqrp_cli.shapes import Box, Part
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import load_solid
from sqrp_cli.sight.targets import Target
from tests.sight.plain_geometry import through_box
from tests.sight.views import make_box, make_camera, make_detector, random_rotation

HALF, CLOSE = 0.5, 0.02
"""Share of a box that must be seen, and how near to it a share may be for either answer: of 64 rows of rays, one."""

ACROSS = 120
"""Rays across the image of a box."""


def met(size: Array, X_CB: Array, rays: Array) -> Array:
    """How far along rays (n, 3) of the optical frame a box is, infinite where it is not met."""
    enter, leave = through_box(np.zeros(3), rays, X_CB, size / 2, np.zeros(3))
    return np.where(enter < leave, enter, np.inf)


def shown(camera: Camera, size: Array, X_CB: Array, before: tuple[Array, Array] | None) -> float:
    """The share of the box's rays that end in pixels of the image with nothing before it."""
    corners = transform(X_CB, 0.5 * size * BOX_SIGNS)
    plane = corners[:, :2] / corners[:, 2:]
    grid = [np.linspace(low, high, ACROSS) for low, high in zip(plane.min(axis=0), plane.max(axis=0), strict=True)]
    rays = np.stack([*map(np.ravel, np.meshgrid(*grid)), np.ones(ACROSS**2)], axis=1)
    depth = met(size, X_CB, rays)
    rays, depth = rays[np.isfinite(depth)], depth[np.isfinite(depth)]
    (u, v), bent = Projection(camera).pixels(rays)[0].T, Projection(camera).pixels(rays)[1]
    free = bent & (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    if before is not None:
        free &= met(*before, rays) > depth
    return float(free.mean())


@pytest.mark.parametrize(
    ("lens", "distortion"),
    [("none", ()), ("plumb_bob", (-0.25, 0.08, 0.001, 0.001, 0.0))],
)
@pytest.mark.parametrize("hidden", [False, True])
def test_a_box_is_usually_seen_that_shows_enough_within_the_image(
    lens: DistortionModel, distortion: tuple[float, ...], *, hidden: bool
) -> None:
    rng = np.random.default_rng(27)
    camera, states = make_camera(model=lens, distortion=distortion), SceneStates(1, {"world": pose()[None]})
    answers = {False: 0, True: 0}
    for _ in range(120):
        size, depth = rng.uniform(0.03, 0.08, 3), rng.uniform(0.3, 0.8)
        edge = rng.uniform(-0.5, 0.5, 2) * (640, 480)
        axis = rng.integers(2)
        edge[axis] = np.copysign((320, 240)[axis], edge[axis]) + rng.uniform(-20, 50)
        X_CB = pose(random_rotation(rng), np.array([*(edge / 600.0 * depth), depth]))
        middle = np.array([*(edge / 600.0 * depth), depth]) * 0.6 + rng.uniform(-0.02, 0.02, 3)
        before = (rng.uniform(0.01, 0.03, 3), pose(random_rotation(rng), middle)) if hidden else None
        part = [] if before is None else [Part("finger", "world", Box(tuple(before[0].tolist())), before[1])]
        box = make_box(tuple(size.tolist()), X_CB, detector=make_detector(min_visible=HALF))
        sought = Target(Atom.of("seen"), 1, (box,))
        asked = [sought, sought.usual]
        observer = Observer((camera,), tuple(map(load_solid, part)))
        sure, usual = (bool(found[0]) for found in observer.coverage(asked, states, [np.array([0])] * 2))
        share = shown(camera, size, X_CB, before)
        assert usual or not sure
        if abs(share - HALF) > CLOSE:
            assert usual == (share > HALF)
            answers[usual] += not sure
    assert min(answers.values()) > 15
