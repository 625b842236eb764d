"""Objects in one place whose shapes are not only boxes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.cell_warnings import overlapping_shapes
from sqrp_cli.checks.placement import PlacedBox
from sqrp_cli.geometry import Array, box_corners, pose, quaternion_to_matrix, transform
from sqrp_cli.shapes import BOX_TRIANGLES, Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere

SIDE = 0.1
"""Of the cube to compare with [m]."""

Placed = tuple[Shape, Array]
FindMessages = Callable[..., list[str]]


@pytest.fixture
def problems(tabletop: Workspace) -> FindMessages:
    """Finds the messages about two objects `a` and `b` of these parts, each a shape with its pose in the world."""

    def messages(first: list[Placed], second: list[Placed]) -> list[str]:
        def item(name: str, placed: list[Placed]) -> SceneObject:
            parts = tuple(Part(f"{name}/{index}", name, *one) for index, one in enumerate(placed))
            return replace(tabletop.objects["g1"], name=name, pose=np.eye(4), parts=parts)

        objects = {"a": item("a", first), "b": item("b", second)}
        return [problem.message for problem in overlapping_shapes(replace(tabletop, objects=objects))]

    return messages


def written(path: Path, *boxes: tuple[Array, tuple[float, float, float]]) -> Mesh:
    """A mesh of boxes, with its scale in millimetres, as a binary STL."""
    corners = [1000 * transform(X, box_corners(size))[BOX_TRIANGLES] for X, size in boxes]
    faces = [struct.pack("<12f", 0, 0, 0, *triangle.ravel()) + b"\0\0" for triangle in np.concatenate(corners)]
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(faces))
    return Mesh(path, (0.001, 0.001, 0.001))


def at(x: float, y: float = 0.0, z: float = 0.0) -> Array:
    return pose(position=(x, y, z))


@pytest.fixture
def cube(tmp_path: Path) -> Mesh:
    return written(tmp_path / "cube.stl", (np.eye(4), (SIDE, SIDE, SIDE)))


@pytest.fixture
def tray(tmp_path: Path) -> Mesh:
    """20 cm wide and 6 cm high, its walls and its floor 1 cm thick; the floor's top is at z = 0."""
    walls = [(at(0.0, 0.0, -0.005), (0.2, 0.2, 0.01))]
    walls += [(at(x, 0.0, 0.025), (0.01, 0.2, 0.05)) for x in (-0.095, 0.095)]
    walls += [(at(0.0, y, 0.025), (0.2, 0.01, 0.05)) for y in (-0.095, 0.095)]
    return written(tmp_path / "tray.stl", *walls)


@pytest.mark.parametrize("shape", [Sphere(0.05), Cylinder(0.05, 0.1), Capsule(0.05, 0.1), "mesh"], ids=str)
@pytest.mark.parametrize("against", ["box", "mesh"])
def test_what_sinks_in_by_more_than_a_millimetre_is_reported(
    problems: FindMessages, cube: Mesh, shape: Shape | str, against: str
) -> None:
    wall = Box((SIDE, SIDE, SIDE)) if against == "box" else cube
    first = cube if isinstance(shape, str) else shape
    for depth, expected in ((-0.005, 0), (0.0, 0), (0.0005, 0), (0.003, 1), (0.05, 1), (0.1, 1)):
        assert len(problems([(first, at(0.05 - depth))], [(wall, at(-SIDE / 2))])) == expected, depth


def test_meshes_of_boxes_are_in_one_place_where_the_boxes_are(problems: FindMessages, tmp_path: Path) -> None:
    rng, compared = np.random.default_rng(3), {True: 0, False: 0}
    mesh = written(tmp_path / "slab.stl", (at(0.02, 0.0, 0.05), (0.1, 0.06, 0.04)))
    for _ in range(150):
        X = pose(quaternion_to_matrix([*rng.uniform(-1, 1, 3), 0.8]), rng.uniform(-0.1, 0.1, 3))
        size = rng.uniform(0.02, 0.1, 3)
        depth = -PlacedBox(at(0.02, 0.0, 0.05), np.array([0.1, 0.06, 0.04])).gap(PlacedBox(X, size))
        if not 0.0 < depth < 0.004:  # less is taken off across edges and corners
            deep = depth > 0
            assert bool(problems([(mesh, np.eye(4))], [(Box(tuple(size)), X)])) == deep
            compared[deep] += 1
    assert min(compared.values()) > 30


@pytest.mark.parametrize("inner", ["box", "mesh"])
def test_what_lies_in_a_tray_or_touches_its_walls_is_not_in_it(
    problems: FindMessages, tray: Mesh, tmp_path: Path, inner: str
) -> None:
    size = (0.04, 0.04, 0.04)
    small: Shape = Box(size) if inner == "box" else written(tmp_path / "small.stl", (np.eye(4), size))
    for place, expected in (
        (at(0.0, 0.0, 0.02), 0),
        (at(0.07, 0.07, 0.02), 0),  # floor and two walls
        (at(0.0, 0.0, 0.03), 0),
        (at(0.0, 0.0, 0.017), 1),
        (at(0.073, 0.0, 0.02), 1),
    ):
        assert len(problems([(tray, np.eye(4))], [(small, place)])) == expected
        assert len(problems([(small, place)], [(tray, np.eye(4))])) == expected


def test_what_is_all_inside_a_closed_mesh_is_reported_and_inside_an_open_one_is_not(
    problems: FindMessages, cube: Mesh, tmp_path: Path
) -> None:
    inside = [(Sphere(0.01), at(0.02))]
    assert len(problems(inside, [(cube, np.eye(4))])) == 1
    flush = [(Box((0.04, 0.04, 0.04)), at(0.0, 0.0, 0.03))]
    assert len(problems(flush, [(cube, np.eye(4))])) == 1
    content = cube.path.read_bytes()
    bin_of_sheets = tmp_path / "bin.stl"
    bin_of_sheets.write_bytes(content[:80] + struct.pack("<I", 10) + content[84 : 84 + 500])
    assert problems(inside, [(Mesh(bin_of_sheets, cube.scale), np.eye(4))]) == []


def test_a_pair_is_reported_once_and_boxes_are_left_to_the_lint(problems: FindMessages) -> None:
    boxes = [(Box((0.1, 0.1, 0.1)), at(0.0)), (Cylinder(0.05, 0.1), at(0.0))]
    (message,) = problems(boxes, [(Sphere(0.05), at(0.01)), (Sphere(0.05), at(0.0))])
    assert message == (
        "objects `a` and `b` are in one place: a box of the first and a sphere of the second are more than 1 mm deep in"
        " each other"
    )
    assert problems(boxes[:1], [(Box((0.1, 0.1, 0.1)), at(0.01))]) == []
