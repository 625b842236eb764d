"""Distances of solids, against formulas and against coal, whose distances are sure to a micrometre."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest

from sqrp_cli.geometry import Array, matrix_to_quaternion, pose, quaternion_to_matrix
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere
from sqrp_cli.sight.solids import Solid, distance, load_solid
from tests.coal_geometry import coal_geometry

FORMS = [Box((0.1, 0.2, 0.3)), Sphere(0.1), Cylinder(0.05, 0.2), Capsule(0.05, 0.2)]


def solid(shape: Shape, X_PG: Array | None = None) -> Solid:
    return load_solid(Part("part", "part", shape, pose() if X_PG is None else X_PG))


def drawn(rng: np.random.Generator, reach: float) -> Array:
    """A random pose with the origin within a cube."""
    return pose(quaternion_to_matrix(rng.normal(size=4)), rng.uniform(-reach, reach, 3))


@pytest.fixture
def sheet(tmp_path: Path) -> Solid:
    """A square in the plane z = 0, from the origin to 0.1 m along x and y."""
    path = tmp_path / "sheet.obj"
    path.write_text("v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3\nf 1 3 4\n")
    return solid(Mesh(path))


@pytest.fixture
def knot(tmp_path: Path) -> Solid:
    """A closed tube along a trefoil knot, 2,400 triangles."""
    t, turn = (np.linspace(0, 2 * np.pi, n, endpoint=False) for n in (100, 12))
    middle = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1) / 10
    ring = 0.03 * np.stack([np.cos(turn), np.sin(turn), np.zeros(12)], axis=1)
    points = (middle[:, None] + ring).reshape(-1, 3)
    corners = [(12 * i + j, 12 * i + k, 12 * m + k, 12 * m + j) for i in range(100) for j in range(12)
               for k, m in [((j + 1) % 12, (i + 1) % 100)]]  # fmt: skip
    path = tmp_path / "knot.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in points.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in corners]
    path.write_text("\n".join(lines))
    return solid(Mesh(path))


def of_coal(first: Solid, X_1: Array, second: Solid, X_2: Array) -> float:
    placed = (coal.Transform3s(X[:3, :3], X[:3, 3]) for X in (X_1 @ first.part.X_PG, X_2 @ second.part.X_PG))
    X_1G, X_2G = placed
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return max(0.0, float(coal.distance(coal_geometry(first), X_1G, coal_geometry(second), X_2G, request, result)))


@pytest.mark.parametrize("one", FORMS)
@pytest.mark.parametrize("other", FORMS)
def test_forms_are_as_far_apart_as_coal_says(one: Shape, other: Shape) -> None:
    rng = np.random.default_rng(0)
    first, second = solid(one, drawn(rng, 0.1)), solid(other, drawn(rng, 0.1))
    meet = 0
    for _ in range(60):
        X_1, X_2 = drawn(rng, 0.2), drawn(rng, 0.2)
        found, truth = distance(first, X_1, second, X_2, 10.0), of_coal(first, X_1, second, X_2)
        assert found == pytest.approx(truth, abs=2e-6)
        assert distance(second, X_2, first, X_1, 10.0) == pytest.approx(found, abs=1e-9)
        meet += found == 0.0
    assert 5 < meet < 55


def test_meshes_are_as_far_apart_as_coal_says(knot: Solid, sheet: Solid) -> None:
    rng, meet = np.random.default_rng(0), 0
    wide = solid(Mesh(sheet.part.shape.path, (2000.0, 2000.0, 1.0)))  # 200 m, mostly aslant
    for other in (knot, sheet, wide, *map(solid, FORMS)):
        for _ in range(12):
            X_1, X_2 = drawn(rng, 0.3), drawn(rng, 0.3)
            found = distance(knot, X_1, other, X_2, 10.0)
            assert found == pytest.approx(of_coal(knot, X_1, other, X_2), abs=2e-6)
            assert found is not None
            for within in (0.9 * found - 1e-6, 1.1 * found + 1e-6):  # what is asked for needs no more than that
                assert (distance(knot, X_1, other, X_2, within, within) is not None) == (within >= found)
            meet += found == 0.0
    assert 10 < meet < 72


@pytest.mark.parametrize("gap", [0.0, 1e-7, 1e-3, 0.2])
def test_distances_that_are_known_are_exact(gap: float, sheet: Solid) -> None:
    lifted = {
        "sphere over box": (Sphere(0.1), Box((0.1, 0.2, 0.3)), 0.25),
        "capsule over box": (Capsule(0.05, 0.2), Box((0.1, 0.2, 0.3)), 0.3),
        "cylinder over cylinder": (Cylinder(0.05, 0.2), Cylinder(0.2, 0.01), 0.105),
        "box over box": (Box((0.1, 0.1, 0.1)), Box((1.0, 1.0, 0.02)), 0.06),
    }
    for name, (upper, lower, height) in lifted.items():
        found = distance(solid(upper), pose(position=(0.01, 0.02, height + gap)), solid(lower), pose(), 1.0)
        assert found == pytest.approx(gap, abs=2e-10), name
    found = distance(solid(Sphere(0.02)), pose(position=(0.05, 0.05, 0.02 + gap)), sheet, pose(), 1.0)
    assert found == pytest.approx(gap, abs=2e-10)


def test_boxes_that_are_turned_are_as_far_apart_as_a_corner_from_a_face() -> None:
    up = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)
    axis, angle = np.cross(up, [0, 0, 1.0]), np.arccos(up[2])
    turn = quaternion_to_matrix([*(np.sin(angle / 2) * axis / np.linalg.norm(axis)), np.cos(angle / 2)])
    assert matrix_to_quaternion(turn)[3] > 0
    on_its_corner = pose(turn, (0.0, 0.0, 0.05 * np.sqrt(3.0) + 0.01 + 0.003))
    cube, plate = solid(Box((0.1, 0.1, 0.1))), solid(Box((1.0, 1.0, 0.02)))
    assert distance(cube, on_its_corner, plate, pose(), 1.0) == pytest.approx(0.003, abs=2e-10)
    assert distance(cube, on_its_corner, plate, pose(), 0.0029) is None


def test_what_is_inside_a_mesh_touches_nothing_and_what_is_inside_a_form_does(knot: Solid) -> None:
    inside, away = solid(Sphere(0.005)), pose(position=(0.0, -0.1, 0.0))
    assert distance(inside, away, knot, pose(), 0.0) is None
    assert distance(inside, pose(), solid(Box((0.1, 0.1, 0.1))), pose(), 0.0) == 0.0


def test_a_pose_that_is_not_finite_never_reaches_the_kernel() -> None:
    with pytest.raises(ValueError, match="finite"):
        distance(solid(FORMS[0]), pose(position=(np.nan, 0, 0)), solid(FORMS[1]), pose(), 1.0)
