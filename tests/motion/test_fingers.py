"""Fingers close until they touch, within their limits, and touch nothing but what they grasp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, pose
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.fingers import closed_on, move_fingers
from sqrp_cli.motion.plan_motion import Motion, plan_motion
from sqrp_cli.robot.kinematics import FingerModel
from sqrp_cli.skill.skill import Release, SkillChoice
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.grips import grips
from sqrp_cli.task.task import read_task

GRIPPER = Path(__file__).parents[1] / "cases" / "gripper"
FINGER = "left_finger_joint"
OPEN = 0.04
IN_TOOL = pose(axis_rotation(0, np.pi))
"""An object upright between the fingertips of a gripper that points down."""


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell.load(load_workspace(GRIPPER))


def motion_of(cell: Cell, task: str) -> Motion | Infeasible:
    return feasible_motion(cell, read_task(task, cell.workspace).candidates[0], cell.initial_world)


def turned(angle: float) -> Array:
    return IN_TOOL @ pose(axis_rotation(2, angle))


@pytest.mark.parametrize(("thing", "X_TO", "expected"), [
        ("cube", IN_TOOL, 0.02), ("cube", turned(np.pi / 2), 0.02), ("can", turned(0.7), 0.03),
        # Pads 20 mm wide do not reach past the corners of a square turned by half a right angle.
        ("cube", turned(np.pi / 4), 0.02 * np.sqrt(2)),
        ("cube", pose(position=(0, 0.005, 0)) @ IN_TOOL, 0.025),  # off centre, the nearer finger touches first
        ("slab", IN_TOOL, "`slab` does not fit between the open fingers"),
        ("cube", pose(position=(0, 0, 0.1)) @ IN_TOOL, "the fingers close without touching `cube`"),
])  # fmt: skip
def test_fingers_stop_where_the_object_is_as_wide_as_the_gap_or_say_why_they_do_not(cell, thing, X_TO, expected):
    found = closed_on(cell.collision, thing, X_TO, np.array([OPEN]))
    assert found == (expected if isinstance(expected, str) else pytest.approx([expected], abs=3e-6))


def test_what_does_not_fit_is_told_with_both_widths_and_taken_by_its_other_sides(cell):
    slab = cell.workspace.objects["slab"]
    stated = replace(cell.workspace.robot, fingers=replace(cell.workspace.robot.fingers, width=0.08))
    wide = Cell.load(replace(cell.workspace, robot=stated))
    found = closed_on(wide.collision, "slab", IN_TOOL, np.array([OPEN]))
    assert found.endswith(f": it is {1000 * slab.size[1]:.3g} mm across, the fingers open to 80 mm")
    (candidate,) = (one for one in read_task("pickup_two_finger slab", cell.workspace).candidates)
    turns = {round(np.degrees(one.values["approach_yaw"])) for one in grips(cell, candidate, cell.initial_world)}
    assert turns == {0, 90, 180, -90}


def test_fingers_take_the_stated_time_or_what_their_limits_ask_for():
    def fingers(velocity: float) -> FingerModel:
        limits = [np.array([value]) for value in (0.0, 0.04, velocity, 5.0, 50.0)]
        return FingerModel(*limits, joints=("finger",), open=limits[1], closed=limits[0], links=frozenset())

    start, end = np.array([0.04]), np.array([0.01])
    assert move_fingers(fingers(0.1), start, end, 1.0).duration == pytest.approx(1.0)
    slow = move_fingers(fingers(0.01), start, end, 1.0)
    assert slow.duration > 3.0  # 30 mm at 10 mm/s
    t = np.linspace(0.0, slow.duration, 1001)
    assert np.abs(slow.motion(t, 1)[1]).max() <= 0.01 + 1e-9
    assert slow.positions([0.0, slow.duration])[:, 0] == pytest.approx([0.04, 0.01])


def test_fingers_move_during_the_grasp_only_and_never_open_in_it(cell):
    motion = motion_of(cell, "pickup_two_finger cube")
    assert motion.joint_names[-1] == FINGER
    for index, primitive in enumerate(motion.primitives):
        q = motion.positions(index, np.linspace(primitive.start, primitive.end, 50))
        finger = q[:, -1]
        if primitive.name == "a3":
            assert np.ptp(q[:, :-1], axis=0).max() == 0.0
            assert (np.diff(finger) <= 1e-12).all()
            assert finger[[0, -1]] == pytest.approx([OPEN, 0.02], abs=3e-6)
        else:
            assert np.ptp(finger) == 0.0
            assert finger[0] == pytest.approx(OPEN if primitive.name in ("a1", "a2") else 0.02, abs=3e-6)
    assert motion.final.joints[FINGER] == pytest.approx(0.02, abs=3e-6)


def test_release_opens_the_fingers_where_it_leaves_the_object(cell):
    candidate = read_task("pickup_two_finger cube", cell.workspace).candidates[0]
    a1, a2, a3, *_ = candidate.skill.primitives
    back = replace(candidate, skill=replace(candidate.skill, primitives=(a1, a2, a3, Release(name="a4", release=0.5))))
    motion = feasible_motion(cell, back, cell.initial_world)
    assert motion.final.joints[FINGER] == pytest.approx(OPEN)
    assert motion.final.held is None
    assert motion.final.X_WO["cube"] == pytest.approx(cell.initial_world.X_WO["cube"], abs=1e-9)


def test_open_fingers_keep_their_clearance_from_what_they_grasp_and_from_its_neighbours(cell):
    assert "right_finger hits neighbour" in "\n".join(motion_of(cell, "pickup_two_finger crowded").reasons)
    wide = motion_of(cell, "pickup_two_finger slab")
    assert wide.reasons == ("a3: `slab` does not fit between the open fingers",)


def test_fingers_that_close_on_a_neighbour_are_found_out(cell):
    """Nothing is in the way of the open fingers, but something thin stands between one of them and the object."""
    world = cell.initial_world
    X_WO = {**world.X_WO, "neighbour": pose(position=(0.45, 0.1 + 0.0305, 0.02))}
    candidate = read_task("pickup_two_finger cube", cell.workspace).candidates[0]
    motion = feasible_motion(cell, candidate, replace(world, X_WO=X_WO))
    assert any("hits neighbour as the fingers move in a3" in reason for reason in motion.reasons), motion.reasons


def test_a_move_by_home_stops_there_and_takes_as_long_as_both_parts(cell):
    lifted = motion_of(cell, "pickup_two_finger object=cube").final
    world = replace(lifted, facts=frozenset())
    q = np.array([lifted.joints[name] for name in cell.model.arm]) + np.array([0.4, 0.1, 0, 0, 0, 0])
    away = replace(world, joints={**lifted.joints, **dict(zip(cell.model.arm, q.tolist(), strict=True))})
    away = replace(away, X_WO={**away.X_WO, "cube": cell.model.tool_pose(q) @ away.X_TO})
    place = cell.workspace.skills["place"]
    values = {parameter.name: parameter.values[0] for parameter in place.motion_parameters}
    times = {}
    for via in ("direct", "home"):
        binding = {"object": "cube", "onto": "table"}
        motion = plan_motion(SkillChoice(place, binding, {**values, "via": via}), away, cell.collision)
        move = motion.primitives[0]
        t = np.linspace(move.start, move.end, 2001)
        home = np.abs(motion.positions(0, t)[:, :-1] - cell.model.home).max(axis=1)
        assert (home.min() < 1e-3) == (via == "home")
        if via == "home":
            rest = np.abs(move.trajectory.motion(t[home.argmin()][None] - move.start, 1)[1]).max()
            assert rest < 0.01
        times[via] = move.end - move.start
    assert times["home"] > times["direct"]
