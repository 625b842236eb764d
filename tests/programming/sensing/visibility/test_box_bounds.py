"""Boxes around solids as seen from points, against points strewn over them and along rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import BOX_SIGNS, Array, quaternion_to_matrix
from sqrp_cli.programming.sensing.solids import Solid
from sqrp_cli.programming.sensing.visibility.triangulation import box_distances, box_is_met
from tests.programming.sensing.solids import solid_of

SIZES = [(0.3, 0.2, 0.1), (0.5, 0.01, 0.3), (0.4, 0.2, 0.0)]


def turned_box(size: tuple[float, float, float], seed: int) -> Solid:
    generator = np.random.default_rng(seed)
    half_axes = 0.5 * np.diag(size) @ quaternion_to_matrix(generator.normal(size=4)).T
    center = generator.normal(size=3)
    flat = solid_of(center + BOX_SIGNS @ half_axes, np.array([[0, 1, 2]]))
    return replace(flat, center=center, half_axes=half_axes)


def strewn(solid: Solid, count: int) -> Array:
    """Points in the box around a solid, among them its corners."""
    shares = np.random.default_rng(1).uniform(-1.0, 1.0, (count, 3))
    return solid.center + np.concatenate([BOX_SIGNS, shares]) @ solid.half_axes


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(3))
def test_every_point_of_the_box_lies_between_its_distances(size, seed):
    solid = turned_box(size, seed)
    points = solid.center + np.random.default_rng(seed).normal(scale=0.3, size=(30, 3))
    least, greatest = box_distances(solid, points)
    distances = np.linalg.norm(strewn(solid, 40_000) - points[:, None], axis=2)
    assert (distances.min(axis=1) >= least - 1e-12).all()
    assert (distances.min(axis=1) <= least + 0.02).all()
    np.testing.assert_allclose(greatest, distances.max(axis=1))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(3))
def test_a_ray_that_has_a_point_in_the_box_meets_it_and_one_that_passes_it_by_does_not(size, seed):
    solid = turned_box(size, seed)
    generator = np.random.default_rng(seed)
    starts = solid.center + generator.normal(scale=0.5, size=(300, 3))
    rays = generator.normal(scale=0.5, size=(300, 3))
    rays[:50] = strewn(solid, 50)[-50:] - starts[:50]
    met = box_is_met(solid, starts, rays)
    along = starts[:, None] + np.linspace(0.0, 1.0, 2001)[:, None] * rays[:, None]
    nearest = np.stack([box_distances(solid, points)[0] for points in along]).min(axis=1)
    step = np.linalg.norm(rays, axis=1) / 2000
    assert met[:50].all()
    assert met[nearest == 0.0].all()
    assert not met[nearest > step].any()
    assert (nearest > step).sum() > 50


def test_a_ray_along_a_face_meets_the_box():
    solid = solid_of(0.1 * BOX_SIGNS, np.array([[0, 1, 2]]))
    assert box_is_met(solid, np.array([[-1.0, 0.1, 0.0]]), np.array([[2.0, 0.0, 0.0]])).all()
    assert not box_is_met(solid, np.array([[-1.0, 0.101, 0.0]]), np.array([[2.0, 0.0, 0.0]])).any()
