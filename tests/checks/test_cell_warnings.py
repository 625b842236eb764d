"""What is doubtful about shapes: meshes in the wrong unit, parts outside the size of their object, lamps in objects."""

from __future__ import annotations

import itertools
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.camera.light import Light
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.cell_warnings import doubtful_meshes, lamps_inside, parts_outside_size
from sqrp_cli.errors import Place, Problem
from sqrp_cli.geometry import Array, pose, rpy_to_matrix, transform
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere
from sqrp_cli.sight.solids import load_solid

LYING = rpy_to_matrix((0.0, np.pi / 2, 0.0))
SIZE = (0.06, 0.06, 0.08)


def written_stl(path: Path, side: float) -> Path:
    """A tetrahedron in a cube of this side, as a binary STL."""
    corners = side * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]])
    faces = [
        b"".join(struct.pack("<3f", *p) for p in (np.zeros(3), *corners[list(three)])) + b"\0\0"
        for three in itertools.combinations(range(4), 3)
    ]
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(faces))
    return path


@pytest.mark.parametrize(("side", "scale"), [(40, "0.001"), (4e-5, "1000"), (0.04, None)])
def test_a_mesh_in_the_wrong_unit_is_doubted(
    tabletop: Workspace, ur5: RobotModel, tmp_path: Path, side: float, scale: str | None
) -> None:
    mesh = Mesh(written_stl(tmp_path / "cube.stl", side))
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


def test_the_meshes_of_the_shipped_robot_are_not_doubted(tabletop: Workspace, ur5: RobotModel) -> None:
    assert list(doubtful_meshes(tabletop, ur5)) == []


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
    mesh = Mesh(written_stl(tmp_path / "cube.stl", 0.03))
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
