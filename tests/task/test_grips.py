"""Grips: what looks the same, what is a choice, and how a way is said."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import axis_rotation, pose
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Box, Capsule, Cylinder, Part, Shape, Sphere
from sqrp_cli.skill.settings import Reference
from sqrp_cli.task.grips import ROUND, equal_sides, equal_turns, first_grip, grips, part_turns, tool_turns, way_in_words
from sqrp_cli.task.task import read_task
from tests.cells import ROOT

FLAT = pose()


def an_object(*shapes: tuple[Shape, object], symmetry: int | str | None = None) -> SceneObject:
    parts = tuple(Part(f"part{i}", "thing", shape, X) for i, (shape, X) in enumerate(shapes))  # type: ignore[arg-type]
    size = next((shape.size for shape, _ in shapes if isinstance(shape, Box)), (0.05, 0.05, 0.05))
    return SceneObject(name="thing", type="part", size=size, pose=None, parts=parts, symmetry=symmetry)  # type: ignore[arg-type]


CUBE, LONG = Box((0.04, 0.04, 0.04)), Box((0.04, 0.06, 0.04))
ASIDE = pose(position=(0.01, 0.0, 0.0))


@pytest.mark.parametrize(
    ("thing", "side", "turns"),
    [
        (an_object((CUBE, FLAT)), "+z", 4),
        (an_object((LONG, FLAT)), "+z", 2),
        (an_object((LONG, FLAT)), "-y", 4),
        (an_object((Cylinder(0.02, 0.1), FLAT)), "+z", ROUND),
        (an_object((Cylinder(0.02, 0.1), FLAT)), "+x", 2),
        (an_object((Capsule(0.02, 0.1), FLAT)), "-z", ROUND),
        (an_object((Sphere(0.02), FLAT)), "+y", ROUND),
        (an_object((CUBE, FLAT), (Cylinder(0.02, 0.1), FLAT)), "+z", 4),  # parts in one axis
        (an_object((CUBE, FLAT), (Cylinder(0.01, 0.1), ASIDE)), "+z", 1),
        (an_object((CUBE, pose(axis_rotation(2, 0.3)))), "+z", 4),
        (an_object((CUBE, pose(axis_rotation(0, 0.3)))), "+z", 1),
        (an_object((LONG, FLAT), symmetry="round"), "+z", ROUND),
        (an_object((LONG, FLAT), symmetry=1), "+z", 1),
        (an_object((LONG, FLAT), symmetry=1), "+y", 4),  # which is stated about z only
    ],
)
def test_shapes_and_stated_symmetry_say_in_how_many_turns_an_object_looks_the_same(
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
    gripper = load_workspace(ROOT / "tests" / "cases" / "gripper").robot
    assert (tool_turns(ur5), tool_turns(RobotModel.load(gripper))) == (ROUND, 1)


def test_a_cup_with_something_beside_it_is_not_round(ur5: RobotModel) -> None:
    beside = Part("camera", "suction_mount", Box((0.02, 0.02, 0.02)), pose(position=(0.05, 0.0, 0.0)))
    assert tool_turns(replace(ur5, parts=(*ur5.parts, beside))) == 1


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


def choices(cell: Cell, task: str, world: World | None = None) -> dict[str, list[object]]:
    """What the grips of a task's first candidate choose, angles in degrees."""
    candidate = read_task(task, cell.workspace).candidates[0]
    found: dict[str, list[object]] = {}
    for grip in grips(cell, candidate, world or cell.initial_world):
        for name, value in grip.values.items():
            if candidate.values[name] != value:
                found.setdefault(name, []).append(value if isinstance(value, str) else round(np.degrees(value)))
    return found


def test_a_round_cup_turns_at_home_and_does_not_stop_there(cell: Cell) -> None:
    assert choices(cell, "pickup g1") == {"approach_yaw": [0, 90, 180, -90], "via": ["direct"] * 4}


def test_elsewhere_a_stop_at_home_is_a_choice(cell: Cell) -> None:
    world = cell.initial_world
    away = replace(world, joints={name: q + 0.1 for name, q in world.joints.items()})
    assert choices(cell, "pickup g1", away)["via"] == ["direct", "home"] * 4


def test_what_a_task_states_is_no_choice(cell: Cell) -> None:
    assert choices(cell, "pickup g1 approach_yaw=45deg via=home") == {}


def test_what_is_put_down_turns_by_its_own_symmetry(cell: Cell) -> None:
    assert choices(cell, "place g1 crate via=direct")["yaw"] == [0, 90, 180, -90]


def test_the_first_grip_is_the_first_choice_of_each(cell: Cell) -> None:
    candidate = read_task("pickup g1", cell.workspace).candidates[0]
    first = first_grip(candidate).values
    assert (first["approach_yaw"], first["via"], first["elbow"]) == (0.0, "direct", "any")
    assert grips(cell, candidate, cell.initial_world)[0].values == first


FREE = {"object": "g1", "approach_yaw": "any", "elbow": "any", "shoulder": "any", "wrist": "any", "via": "any"}


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        (
            {"approach_yaw": pi / 2, "elbow": "up", "shoulder": "left", "wrist": "flip"},
            "shoulder left, wrist flipped, tool turned 90 deg",
        ),
        ({"approach_yaw": 0.0, "elbow": "down", "shoulder": "right", "wrist": "no_flip"}, "shoulder right, elbow down"),
        ({"shoulder": "left", "via": "home"}, "shoulder left, via home"),
        ({"elbow": "up", "via": "direct"}, "as at home"),
        ({"path": "seen", "shoulder": "left"}, "shoulder left, path in sight"),
        ({"a1.solution": 7.0}, "arm position 7"),
        ({"a1.shoulder": "left"}, "shoulder left (approach)"),
    ],
)
def test_a_way_is_said_by_what_is_unusual(chosen: dict[str, float | str], words: str, tabletop: Workspace) -> None:
    assert way_in_words(tabletop.skills["pickup"], FREE, {**FREE, **chosen}) == words


def test_where_two_moves_are_free_each_choice_says_for_which_it_is(tabletop: Workspace) -> None:
    pickup = tabletop.skills["pickup"]
    first, *others = pickup.primitives
    own = {setting: Reference(f"{setting}2") for setting in ("elbow", "shoulder", "wrist")}
    second = first.model_copy(update={"name": "a5", **own})
    skill = replace(pickup, primitives=(first, *others[:-1], second))
    asked = {**FREE, "elbow2": "any", "shoulder2": "any", "wrist2": "any", "path": "direct"}
    chosen = {"shoulder": "left", "wrist": "no_flip", "shoulder2": "right", "wrist2": "flip", "elbow2": "down"}
    second = "shoulder right (approach, a5), wrist flipped (approach, a5), elbow down (approach, a5)"
    said = f"shoulder left (approach, a1), {second}"
    assert way_in_words(skill, asked, {**asked, **chosen}) == said
    of_both = replace(skill, primitives=(first, *others[:-1], first.model_copy(update={"name": "a5"})))
    assert way_in_words(of_both, FREE, {**FREE, "shoulder": "left", "wrist": "flip"}) == "shoulder left, wrist flipped"


def test_a_path_that_was_to_be_seen_and_is_direct_is_said(tabletop: Workspace) -> None:
    asked, found = {**FREE, "path": "seen"}, {**FREE, "shoulder": "left"}
    assert way_in_words(tabletop.skills["pickup"], asked, found) == "shoulder left, direct path"
    assert way_in_words(tabletop.skills["pickup"], asked, {**found, "path": "seen"}) == "shoulder left"
