"""Rays find what they must."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.shapes import Triangles
from sqrp_cli.show.pictures.camera_image import RayScene

SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


def wall(x: float) -> Triangles:
    return Triangles(np.array([[x, -1.0, -1.0], [x, 1.0, -1.0], [x, 1.0, 1.0], [x, -1.0, 1.0]]), SQUARE)


def test_a_ray_meets_the_nearest_mesh_and_its_normal_looks_back():
    hits = RayScene([wall(3.0), wall(2.0)]).first_hits(np.zeros(3), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
    assert hits.mesh.tolist() == [1, -1]
    assert hits.distance[0] == pytest.approx(2.0, rel=1e-6)  # Embree computes in single precision
    assert hits.normal[0].tolist() == [-1.0, 0.0, 0.0]


def test_a_surface_does_not_shade_itself():
    scene = RayScene([wall(2.0), wall(3.0)])
    points, normals = np.array([[2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert scene.blocked(points[:1], normals[:1], np.array([-1.0, 0.0, 0.0])).tolist() == [False]
    assert scene.blocked(points[1:], normals[1:], np.array([1.0, 0.0, 0.0])).tolist() == [True]
