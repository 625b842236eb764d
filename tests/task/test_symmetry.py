from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import axis_rotation, pose
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Shape, Sphere
from sqrp_cli.task.grips import ROUND, equal_sides, equal_turns, part_turns, tool_turns
from tests.conftest import TABLETOP

FLAT = pose()


def an_object(*shapes: tuple[Shape, object], symmetry: int | str | None = None) -> SceneObject:
    parts = tuple(Part(f"part{i}", "thing", shape, X) for i, (shape, X) in enumerate(shapes))  # type: ignore[arg-type]
    size = next((shape.size for shape, _ in shapes if isinstance(shape, Box)), (0.05, 0.05, 0.05))
    return SceneObject(name="thing", type="part", size=size, pose=None, parts=parts, symmetry=symmetry)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("shape", "side", "turns"),
    [
        (Box((0.04, 0.04, 0.04)), "+z", 4),
        (Box((0.04, 0.06, 0.04)), "+z", 2),
        (Box((0.04, 0.06, 0.04)), "-y", 4),
        (Cylinder(0.02, 0.1), "+z", ROUND),
        (Cylinder(0.02, 0.1), "+x", 2),
        (Capsule(0.02, 0.1), "-z", ROUND),
        (Sphere(0.02), "+y", ROUND),
    ],
)
def test_a_shape_looks_the_same_in_as_many_turns_as_its_geometry_says(shape: Shape, side: str, turns: int) -> None:
    assert part_turns(an_object((shape, FLAT)), side) == turns


CUBE = Box((0.04, 0.04, 0.04))


@pytest.mark.parametrize(
    ("thing", "side", "turns"),
    [
        (an_object((CUBE, FLAT), (Cylinder(0.02, 0.1), FLAT)), "+z", 4),
        (an_object((CUBE, FLAT), (Cylinder(0.01, 0.1), pose(position=(0.01, 0.0, 0.0)))), "+z", 1),
        (an_object((CUBE, pose(axis_rotation(2, 0.3)))), "+z", 4),
        (an_object((CUBE, pose(axis_rotation(0, 0.3)))), "+z", 1),
        (an_object((Box((0.04, 0.06, 0.04)), FLAT), symmetry="round"), "+z", ROUND),
        (an_object((Box((0.04, 0.06, 0.04)), FLAT), symmetry=1), "+z", 1),
        (an_object((Box((0.04, 0.06, 0.04)), FLAT), symmetry=1), "+y", 4),
    ],
    ids=["parts in one axis", "a part aside", "turned", "tilted", "stated round", "stated none", "stated about z only"],
)
def test_parts_and_stated_symmetry_decide_how_an_object_looks_the_same(
    thing: SceneObject, side: str, turns: int
) -> None:
    assert part_turns(thing, side) == turns


def test_turns_begin_with_none_and_stay_within_half_a_turn() -> None:
    assert np.degrees(equal_turns(1)).tolist() == [0.0]
    assert np.degrees(equal_turns(4)).round(9).tolist() == [0.0, 90.0, 180.0, -90.0]
    assert np.degrees(equal_turns(3)).round(9).tolist() == [0.0, 120.0, -120.0]
    assert equal_turns(ROUND) == equal_turns(4)


@pytest.mark.parametrize(
    ("shape", "sides"),
    [
        (Box((0.04, 0.04, 0.04)), ["+z", "+x", "-x", "+y", "-y", "-z"]),
        (Box((0.04, 0.06, 0.08)), ["+z", "-z"]),
        (Box((0.04, 0.06, 0.04)), ["+z", "+x", "-x", "-z"]),
        (Cylinder(0.025, 0.05), ["+z", "-z"]),
    ],
)
def test_sides_are_equal_where_their_faces_are(shape: Shape, sides: list[str]) -> None:
    assert equal_sides(an_object((shape, FLAT))) == sides


def test_a_suction_cup_is_round_and_a_gripper_is_not(ur5: RobotModel) -> None:
    gripper = load_workspace(TABLETOP.parent.parent / "tests" / "cases" / "gripper").robot
    assert (tool_turns(ur5), tool_turns(RobotModel.load(gripper))) == (ROUND, 1)


def test_a_cup_with_something_beside_it_is_not_round(ur5: RobotModel) -> None:
    beside = Part("camera", "suction_mount", Box((0.02, 0.02, 0.02)), pose(position=(0.05, 0.0, 0.0)))
    assert tool_turns(dataclasses.replace(ur5, parts=(*ur5.parts, beside))) == 1
