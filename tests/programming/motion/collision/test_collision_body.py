"""Bodies for the collision check."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np

from sqrp_cli.geometry import pose
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.solids import load_solid
from sqrp_cli.shapes import Mesh, Part


def test_a_flat_mesh_collides_as_what_it_is(tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.obj"
    sheet.write_text("v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3\nf 1 3 4\n")
    body = Body.of(load_solid(Part("sheet", "sheet", Mesh(sheet, (1.0, 1.0, 1.0)), pose())))
    ball, result = coal.Sphere(0.02), coal.DistanceResult()
    above = coal.Transform3s(np.eye(3), np.array([0.05, 0.05, 0.05]))
    found = coal.distance(body.hull, coal.Transform3s.Identity(), ball, above, coal.DistanceRequest(), result)
    np.testing.assert_allclose(found, 0.03, atol=1e-6)
