"""What of a link beside or over the lens is before it, by rays from it."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import Array, Mask, inverse, pose, rpy_to_matrix, transform
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.runtime.perception.projected import LEAST_DEPTH, PosedCamera
from sqrp_cli.runtime.perception.vision import dilated
from sqrp_cli.runtime.robot_body import Surface
from sqrp_cli.shapes import Box, Part
from tests.runtime.cell.scenes import camera

EYE = camera("beside", (0.3, 0.4, 0.5), (0.0, 0.0, 0.0), size=(160, 120), focal=(150.0, 150.0))
VIEW = PosedCamera(Projection.of(EYE), EYE.X_FC)


FINE = 5
"""Rays across a pixel: what a link shows may be thinner."""


def met(X_CP: Array, size: Array) -> Mask:
    """The pixels of which any ray meets a box at a pose before the optical frame."""
    v, u = (np.mgrid[: EYE.height * FINE, : EYE.width * FINE] + 0.5) / FINE - 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(EYE.matrix).T
    X_PC = inverse(X_CP)
    start, steps = transform(X_PC, np.zeros((1, 3)))[0], rays @ X_PC[:3, :3].T
    sides = (0.5 * np.stack([-size, size])[:, None, None] - start) / steps
    first, last = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    meets = last > np.maximum(first, LEAST_DEPTH)
    return meets.reshape(EYE.height, FINE, EYE.width, FINE).any(axis=(1, 3))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (1, 2))])
@pytest.mark.parametrize("mesh", [False, True], ids=["box", "mesh"])
def test_a_link_that_reaches_behind_the_camera_still_hides_what_is_behind_it(seed: int, mesh: bool) -> None:
    random = np.random.default_rng(seed)
    found = 0
    for _ in range(40):
        size = random.uniform((0.05, 0.05, 0.6), (0.2, 0.2, 1.6))
        X_CP = pose(rpy_to_matrix(random.uniform(-np.pi, np.pi, 3)), random.uniform(-0.4, 0.4, 3))
        corners = transform(X_CP, 0.5 * size * np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T)
        around = (np.abs(inverse(X_CP)[:3, 3]) < size / 2 + 0.02).all()
        if around or not corners[:, 2].min() < 0 < corners[:, 2].max() or not (shown := met(X_CP, size)).any():
            continue
        shape = Box(tuple(size.tolist()))
        drawn = shape.triangles(4, enclosing=False)
        surface = (
            Surface("link", drawn.vertices, drawn.faces) if mesh else Surface.of(Part("link/0", "link", shape, pose()))
        )
        mask = VIEW.silhouette([surface], {"link": EYE.X_FC @ X_CP}).mask(VIEW.whole)
        assert not (mask & ~dilated(shown, 1)).any()
        assert not (shown & ~dilated(mask, 1)).any()
        found += 1
    assert found > 1
