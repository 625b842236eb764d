"""Joint moves around vias and obstacles: smooth, honest in every respect, and the same each time."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, pose
from sqrp_cli.motion import joint_moves
from sqrp_cli.motion.collision import CLEARANCE
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.stop_and_return import recovery_over
from sqrp_cli.motion.timing import MotionLimits, joint_move, joint_move_duration
from sqrp_cli.motion.way_around import blended_path, motion_through
from sqrp_cli.robot.kinematics import RobotModel
from tests.motion.cells import Cell, among, assert_keeps_limits, even_steps, phase_samples, pinocchio_arm, thing

TABLE = thing("table", (2, 2, 0.04), pose(position=(0, 0, -0.02)))
CUBE = thing("cube", (0.04, 0.04, 0.04), pose(position=(0.45, -0.25, 0.02)), fixed=False)
WALL = thing("wall", (0.6, 0.02, 0.4), pose(position=(0.62, -0.08, 0.2)))
BACK = thing("back", (0.02, 1.2, 1.2), pose(position=(-0.3, 0, 0.6)))
"""The wall stands between home and cube; the other one keeps the arm from going round behind its base."""

FARTHEST = 1.3
"""No point of arm, tool or held cube is further from any joint's axis than this [m]."""


@pytest.fixture(scope="module")
def cell(tabletop: Workspace, ur5: RobotModel) -> Cell:
    return among(tabletop, ur5, TABLE, CUBE)


@pytest.fixture(scope="module")
def walled(tabletop: Workspace, ur5: RobotModel) -> Cell:
    return among(tabletop, ur5, TABLE, CUBE, WALL, BACK)


@pytest.fixture(scope="module")
def motion(walled: Cell) -> Motion:
    started = time.process_time()
    planned = walled.plan()
    assert time.process_time() - started < 10.0
    return planned


def test_a_way_around_touches_nothing_at_steps_of_a_millimetre_in_pinocchios_own_model(motion, walled, ur5):
    assert motion.remarks == ("a1 goes around wall", "a5 goes around wall")
    independent, limits = pinocchio_arm(walled), MotionLimits(ur5.velocity, ur5.acceleration, ur5.jerk)
    for index in (0, 4):
        t = even_steps(motion.primitives[index].trajectory, 1e-3 / FARTHEST)
        assert independent.contacts(motion, index, t, 0.9 * CLEARANCE) == set()
    direct = joint_move(*motion.primitives[4].trajectory.path.positions([0.0, 1.0]), limits)
    blocked = replace(motion, primitives=(*motion.primitives[:4], replace(motion.primitives[4], trajectory=direct)))
    assert any("wall" in names for names in independent.contacts(blocked, 4, even_steps(direct, 0.01), 0.0))


def test_padding_is_kept_around_walls_on_the_way_too(tabletop, ur5):
    cell = among(tabletop, ur5, TABLE, CUBE, WALL, BACK, padding=0.015)
    padded = cell.plan()
    t = even_steps(padded.primitives[0].trajectory, 4e-3 / FARTHEST)
    near = pinocchio_arm(cell).contacts(padded, 0, t, 0.9 * (CLEARANCE + 0.015))
    assert not [names for names in near if {"wall", "back"} & set(names)]


def test_a_way_around_keeps_velocity_acceleration_and_jerk_and_moves_smoothly(motion, ur5):
    assert_keeps_limits(ur5, motion)


def test_the_same_seed_gives_the_same_way_whatever_was_planned_before(walled, motion):
    other, again, before = (
        [one.trajectory.to_numbers() for one in planned.primitives]
        for planned in (walled.plan(seed=7), walled.plan(), motion)
    )
    assert again == before
    assert other[0] != before[0]


def test_the_planner_is_asked_only_where_no_combination_of_branches_is_direct(tabletop, ur5, monkeypatch):
    monkeypatch.setattr(joint_moves, "find_way", lambda *_: pytest.fail("a way around was looked for"))
    motion = among(tabletop, ur5, TABLE, CUBE, WALL).plan()
    assert motion.remarks == ()


def test_where_no_way_is_found_the_pair_that_touches_is_named(walled, monkeypatch):
    monkeypatch.setattr(joint_moves, "MOST_TRIES", 2)
    result = walled.plan()
    assert " hits wall at " in result.reasons[0]
    assert result.reasons[0].endswith("no way around was found in 2 tries")


def test_an_object_in_a_closed_cage_is_blocked_by_a_wall_of_it(tabletop, ur5):
    around = {"left": (0.0, 0.1), "right": (0.0, -0.1), "front": (-0.1, 0.0), "rear": (0.1, 0.0)}
    sides = [thing("cage_top", (0.2, 0.2, 0.004), pose(position=(0.45, -0.25, 0.15)))]
    for name, (x, y) in around.items():
        size = (0.004, 0.2, 0.15) if x else (0.2, 0.004, 0.15)
        sides.append(thing(f"cage_{name}", size, pose(position=(0.45 + x, -0.25 + y, 0.075))))
    started = time.process_time()
    result = among(tabletop, ur5, TABLE, CUBE, *sides).plan()
    assert time.process_time() - started < 10.0
    assert " hits cage_" in result.reasons[0]


def test_moving_back_after_a_fault_goes_around_as_well(motion, ur5):
    """At the very end, the arm is at home again; within a4, it goes to where a1 ended and back along a1."""
    instants, durations = recovery_over(motion, ur5, 0.0)
    limits = MotionLimits(ur5.velocity, ur5.acceleration, ur5.jerk)
    a1, a4 = motion.primitives[0], motion.primitives[3]
    row = int(np.flatnonzero((instants > a4.start) & (instants < a4.end))[-1])
    q = motion.positions(3, instants[row : row + 1])[0]
    least = a1.trajectory.duration + float(joint_move_duration(q, a1.trajectory.path.positions([1.0])[0], limits))
    assert least - 0.5 <= durations[row] <= least + 2.0


def ends(motion: Motion, index: int) -> Array:
    return motion.primitives[index].trajectory.path.positions([0.0, 1.0])


@given(st.integers(0, 10_000), st.integers(3, 6), st.integers(1, 4))
def test_a_blended_polyline_is_smooth_and_stays_near_it(seed, corners, joints):
    rng = np.random.default_rng(seed)
    polyline = rng.normal(size=(corners, joints))
    lengths = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    reaches = [float(rng.uniform(0.05, 0.5)) * min(pieces) for pieces in pairwise(lengths.tolist())]
    path = blended_path(polyline, lengths, reaches)
    np.testing.assert_allclose(path.positions([0.0, 1.0]), polyline[[0, -1]], atol=1e-12)
    inner = path.breaks[1:-1]
    for order in (0, 1, 2):
        before, after = path.derivatives(np.nextafter(inner, 0), order), path.derivatives(inner, order)
        np.testing.assert_allclose(before, after, atol=1e-6 * lengths.sum() ** order / min(reaches))
    for corner, reach in zip(polyline[1:-1], reaches, strict=True):
        off = np.linalg.norm(path.positions(np.linspace(0, 1, 500)) - corner, axis=1).min()
        assert off <= reach


@given(st.integers(0, 10_000), st.integers(1, 3))
def test_a_move_around_vias_bends_near_them_without_a_stop_and_keeps_all_limits(seed, count):
    rng = np.random.default_rng(seed)
    q0, *vias, q1 = rng.uniform(-2, 2, (count + 2, 6))
    limits = MotionLimits(*(rng.uniform(*span, 6) for span in ((0.3, 2), (1, 4), (5, 50))))
    motion = motion_through(q0, np.array(vias), q1, limits)
    np.testing.assert_allclose(motion.positions([0.0, motion.duration]), [q0, q1], atol=1e-12)
    t = np.concatenate([np.linspace(0, motion.duration, 2000), phase_samples(motion, 9)])
    for order, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        assert (np.abs(motion.motion(t, order)[order]) <= limit * (1 + 1e-9)).all()
    assert (motion.law.derivatives(np.linspace(0, motion.duration, 500)[1:-1])[1] > 0).all()
    longest = np.abs(np.diff([q0, *vias, q1], axis=0)).max()
    for via in vias:
        assert np.abs(motion.path.positions(np.linspace(0, 1, 500)) - via).max(axis=1).min() < longest


def test_vias_at_the_ends_or_twice_at_one_place_count_once():
    limits = MotionLimits(*(np.full(2, limit) for limit in (1.0, 2.0, 10.0)))
    q0, via, q1 = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, 2.0]])
    once = motion_through(q0, via[None], q1, limits)
    twice = motion_through(q0, np.stack([q0, via, via, q1]), q1, limits)
    assert once.to_numbers() == twice.to_numbers()
    direct = joint_move(q0, q1, limits)
    assert motion_through(q0, np.stack([q0, q1]), q1, limits).to_numbers() == direct.to_numbers()


def test_moves_with_vias_take_the_branches_and_turns_of_the_direct_ones(cell):
    direct = cell.plan()
    far = ends(direct, 0)[1] + [0.3, 0.0, 0.0, 0.0, 0.0, 1.5]
    motion = cell.plan(vias={"a1": far[None]})
    for index in range(5):
        np.testing.assert_allclose(ends(motion, index), ends(direct, index), atol=1e-12)
    assert motion.primitives[0].trajectory.duration > direct.primitives[0].trajectory.duration
    for index in range(1, 5):
        same = motion.primitives[index].trajectory.to_numbers()
        assert same == direct.primitives[index].trajectory.to_numbers()


def test_vias_that_lead_through_an_obstacle_are_infeasible_and_say_what_touches(cell):
    under_the_table = ends(cell.plan(), 0)[1] + [0.0, 0.9, 0.0, 0.0, 0.0, 0.0]
    result = cell.plan(vias={"a1": under_the_table[None]})
    assert " hits table at " in result.reasons[0]
    assert result.reasons[0].endswith(" of a1 with its vias")


def test_vias_that_lead_around_an_obstacle_need_no_planner(walled, motion, monkeypatch):
    along = {name: motion.primitives[index].trajectory.path for name, index in (("a1", 0), ("a5", 4))}
    monkeypatch.setattr("sqrp_cli.motion.joint_moves.find_way", lambda *_: pytest.fail("asked"))
    again = walled.plan(vias={name: path.positions(np.linspace(0.1, 0.9, 9)) for name, path in along.items()})
    assert again.remarks == ("a1 goes around wall", "a5 goes around wall")


def test_a_move_by_home_has_no_vias(cell):
    by_home = cell.plan(via="home")
    vias = {"a1": ends(by_home, 0).mean(axis=0)[None] + 0.1}
    again = cell.plan(via="home", vias=vias)
    assert again.primitives[0].trajectory.to_numbers() == by_home.primitives[0].trajectory.to_numbers()
