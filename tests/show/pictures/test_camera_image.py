"""Pictures show what an independent renderer shows; rays and what they meet fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.shapes import Triangles
from sqrp_cli.show.pictures.camera_image import RayScene
from sqrp_cli.sight.scene_states import SceneStates

TABLETOP = Path(__file__).parents[3] / "workspaces" / "tabletop"
RESOLUTION = 160


@pytest.mark.parametrize(
    "lens", [("none", []), ("plumb_bob", [-0.28, 0.09, 0.001, -0.0007, -0.01])], ids=["none", "bent"]
)
def test_a_pixel_shows_the_part_and_the_depth_that_mujoco_renders(lens):
    """Through every camera, but for 1 % of the pixels: those on edges."""
    renderer = pytest.importorskip("tests.sight.renderer", exc_type=ImportError)
    cell = Cell.load(load_workspace(TABLETOP))
    objects = [thing for thing in cell.workspace.objects.values() if thing.X_WO is not None]
    q = cell.model.home + np.array([0.7, -0.1, 0.3, 0.2, -0.4, 0.5])
    frames = {thing.name: thing.X_WO[None] for thing in objects} | {"world": np.eye(4)[None]}
    states = SceneStates(1, {**cell.model.link_poses(q[None]), **frames})
    scene = RayScene.of(cell, states)
    parts = [replace(part, parent="world", X_PG=thing.X_WO @ part.X_PG) for thing in objects for part in thing.parts]
    stage = renderer.MujocoScene(cell.workspace.robot, parts, None, RESOLUTION)
    stage.move(cell.model.joint_values(q))
    stage.show([])
    try:
        for camera in cell.observer.cameras:
            bent = replace(camera, distortion_model=lens[0], distortion=np.array(lens[1]))
            expected = stage.picture(camera.X_FC, np.array([-0.3, -0.22]), 0.5, 0.1)
            rays_C = np.stack([expected.u, expected.v, np.ones_like(expected.u)], axis=-1).reshape(-1, 3)
            hits = scene.view(bent, camera.X_FC, Projection(bent).pixels(rays_C)[0])
            names = np.array([cell.observer.solids[index].name for index in range(len(cell.observer.solids))] + [""])
            shown = np.array([*stage.names, ""])[expected.part.reshape(-1)]
            assert hits.shown.all()
            assert np.mean(names[hits.mesh] == shown) > 0.99, camera.name
            depth = hits.distance / np.linalg.norm(rays_C, axis=1)
            there = hits.mesh >= 0
            close = np.abs(depth - expected.depth.reshape(-1))[there] < 2e-3
            assert np.mean(close) > 0.98, camera.name
    finally:
        stage.close()


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
