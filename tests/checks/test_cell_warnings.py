"""What is doubtful about shapes: meshes in the wrong unit, parts outside the size of their object, lamps and other
objects in objects."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.camera.light import Light
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.cell_warnings import doubtful_meshes, lamps_inside, overlapping_shapes, parts_outside_size
from sqrp_cli.errors import Place, Problem
from sqrp_cli.geometry import Array, box_corners, pose, quaternion_to_matrix, rpy_to_matrix, transform
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import BOX_TRIANGLES, Box, Capsule, Cylinder, Mesh, Part, PlacedBox, Shape, Sphere
from sqrp_cli.sight.solids import load_solid

LYING = rpy_to_matrix((0.0, np.pi / 2, 0.0))
SIZE = (0.06, 0.06, 0.08)


def written_stl(path: Path, *triangles: Array) -> Path:
    """A binary STL of triangles, shape (n, 3, 3) each."""
    faces = [struct.pack("<12f", 0, 0, 0, *one.ravel()) + b"\0\0" for one in np.concatenate(triangles)]
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(faces))
    return path


TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]])[list(combinations(range(4), 3))]
"""In a cube of side 1, at its corner."""


@pytest.mark.parametrize(("side", "scale"), [(40, "0.001"), (4e-5, "1000"), (0.04, None)])
def test_a_mesh_in_the_wrong_unit_is_doubted(
    tabletop: Workspace, ur5: RobotModel, tmp_path: Path, side: float, scale: str | None
) -> None:
    mesh = Mesh(written_stl(tmp_path / "cube.stl", side * TETRAHEDRON))
    g1 = replace(tabletop.objects["g1"], parts=(Part("g1/0", "g1", mesh, np.eye(4)),))
    of_object = list(doubtful_meshes(replace(tabletop, objects={"g1": g1}), ur5))
    big = replace(ur5, parts=(Part("forearm_link", "forearm_link", mesh, np.eye(4)),))
    of_robot = list(doubtful_meshes(replace(tabletop, objects={}), big))
    if scale is None:
        assert of_object == of_robot == []
    else:
        for (problem,), name in ((of_object, "`g1`"), (of_robot, "`forearm_link`")):
            assert problem.severity == "warning"
            assert name in problem.message
            assert f"`scale` of {scale}" in (problem.mend or "")


def problems_of_g1(tabletop: Workspace, *placed: tuple[Shape, Array]) -> list[Problem]:
    """The problems of `g1` with these parts."""
    parts = tuple(Part(f"g1/{index}", "g1", *one) for index, one in enumerate(placed))
    item = replace(tabletop.objects["g1"], size=SIZE, parts=parts)
    places = {f"objects.g1.parts.{index}": Place(Path("w.yaml"), index + 1, 9) for index in range(len(parts))}
    return list(parts_outside_size(replace(tabletop, objects={"g1": item}, places=places)))


@pytest.mark.parametrize(
    ("shape", "X_PG", "outside", "size"),
    [
        (Cylinder(0.06, 0.08), pose(), "a cylinder, reaches 30.0 mm outside the object's `size`", "0.12, 0.12, 0.08"),
        (Cylinder(0.03, 0.08), pose(LYING), "10.0 mm outside the object's `size` along x", "0.08, 0.06, 0.08"),
        (Capsule(0.03, 0.08), pose(), "30.0 mm outside the object's `size` along z", "0.06, 0.06, 0.14"),
        (Sphere(0.03), pose(position=(0, -0.01, 0)), "10.0 mm outside the object's `size` along y", "0.06, 0.08, 0.08"),
        (Box((0.06, 0.06, 0.083)), pose(), "1.5 mm outside the object's `size` along z", "0.06, 0.06, 0.083"),
    ],
)  # fmt: skip
def test_a_part_outside_the_size_is_reported_with_the_size_that_holds_it(
    tabletop: Workspace, shape: Shape, X_PG: Array, outside: str, size: str
) -> None:
    (problem,) = problems_of_g1(tabletop, (Sphere(0.02), pose()), (shape, X_PG))
    assert (problem.code, problem.severity) == ("part-outside-size", "warning")
    assert problem.message.startswith("part `g1/1` of `g1`")
    assert outside in problem.message
    assert f"`size: [{size}]`" in (problem.mend or "")
    assert str(problem.place) == "w.yaml:2:9"


def test_a_mesh_that_its_pose_moves_out_of_the_box_is_reported(tabletop: Workspace, tmp_path: Path) -> None:
    mesh = Mesh(written_stl(tmp_path / "cube.stl", 0.03 * TETRAHEDRON))
    assert problems_of_g1(tabletop, (mesh, pose())) == []
    (problem,) = problems_of_g1(tabletop, (mesh, pose(position=(0.0, 0.0, 0.3))))
    assert "a mesh, reaches 290.0 mm outside the object's `size` along z" in problem.message
    assert "[0.06, 0.06, 0.66]" in (problem.mend or "")
    in_millimetres = Mesh(mesh.path, (1e3, 1e3, 1e3))
    assert problems_of_g1(tabletop, (in_millimetres, pose())) == [], (
        "its scale is doubted, and that is reported elsewhere"
    )


def test_one_warning_counts_the_other_parts_outside(tabletop: Workspace) -> None:
    (problem,) = problems_of_g1(tabletop, *((Sphere(radius), pose()) for radius in (0.04, 0.05, 0.02, 0.035)))
    assert problem.message.startswith("part `g1/1`")
    assert problem.message.endswith("and 2 other parts outside it too")


def test_a_millimetre_is_allowed(tabletop: Workspace) -> None:
    assert problems_of_g1(tabletop, (Cylinder(0.031, 0.082), pose()), (Box(SIZE), pose())) == []


@pytest.mark.parametrize(("position", "inside"), [((0.0, 0.0, 0.03), True), ((0.0, 0.0, 0.06), False)])
def test_a_lamp_inside_an_object_is_named_with_it(
    tabletop: Workspace, position: tuple[float, float, float], inside: bool
) -> None:
    g1 = replace(
        tabletop.objects["g1"], pose=pose(LYING, (0.5, 0.1, 0.2)), parts=(Part("g1/0", "g1", Box(SIZE), pose()),)
    )
    lamp = Light(intensity=1.0, position=tuple(transform(g1.X_WO, np.array([position]))[0]), look_at=(0.0, 0.0, 9.0))
    lights = {"sun": Light(intensity=1.0, direction=(0.0, 0.0, -1.0)), "lamp": lamp, "room": Light(intensity=0.2)}
    workspace = replace(
        tabletop, objects={"g1": g1}, lights=lights, places={"lights.lamp": Place(Path("w.yaml"), 7, 3)}
    )
    found = list(lamps_inside(workspace, [load_solid(g1.parts[0])]))
    assert [(problem.code, problem.severity, str(problem.place)) for problem in found] == (
        [("light-inside-object", "warning", "w.yaml:7:3")] if inside else []
    )
    assert all("light `lamp` is inside `g1`" in problem.message for problem in found)


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
    return Mesh(written_stl(path, *corners), (0.001, 0.001, 0.001))


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
