"""Whole motions are honest: limits, straightness, continuity, no contact, and the fastest of the feasible branches."""

from __future__ import annotations

import gc
import re
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, inverse, pose
from sqrp_cli.motion.collision import CLEARANCE, pair
from sqrp_cli.motion.joint_moves import JointMoves, fastest_sequence
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.sections import MotionProblem
from sqrp_cli.motion.timing import MotionLimits, joint_move, time_paths
from sqrp_cli.motion.tool_path import tool_line
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.skill.skill import HOME, JointMove, Release, Skill, StraightMove, Wait
from sqrp_cli.trajectory import JointPath
from tests.motion.cells import VALUES, Cell, among, assert_keeps_limits, pinocchio_arm, read_waypoints, thing
from tests.motion.test_tool_curves import straight_line

PLACED = {"position": [0.35, 0.35, 0.041], "rpy": ["180 deg", 0, 0]}
"""The tool frame pointing down, where a cube held by its top stands 1 mm above the table."""


TABLE = thing("table", (1.4, 1.8, 0.04), pose(position=(0.35, 0, -0.02)))
CUBE = thing("cube", (0.04, 0.04, 0.04), pose(position=(0.45, -0.25, 0.02)), fixed=False)
OTHER = thing("other", (0.04, 0.04, 0.04), pose(position=(0.55, -0.3, 0.02)), fixed=False)
POST = thing("post", (0.05, 0.05, 0.25), pose(position=(0.62, -0.12, 0.125)))


@pytest.fixture(scope="module")
def pick_and_place(tabletop: Workspace) -> Skill:
    """Pick up, carry to `PLACED`, wait, release, retreat, go home."""
    pickup = tabletop.skills["pickup"]
    speed = {"speed": 0.1, "acceleration": 0.5, "jerk": 5.0}
    added = {"placed": {"pose": PLACED}, "over": {"from": "placed", "raise": 0.05}}
    waypoints = {**pickup.waypoints, **read_waypoints(added)}
    carry = (
        JointMove(name="b1", joint_move="over", speed=0.8), StraightMove(name="b2", straight_move="placed", **speed),
        Wait(name="b3", wait=0.2), Release(name="b4", release=0.5),
        StraightMove(name="b5", straight_move="over", **speed), JointMove(name="b6", joint_move=HOME, speed=1.0),
    )  # fmt: skip
    return replace(pickup, waypoints=waypoints, primitives=(*pickup.primitives[:4], *carry))


@pytest.fixture(scope="module")
def cell(tabletop: Workspace, ur5: RobotModel) -> Cell:
    return among(tabletop, ur5, TABLE, CUBE, OTHER, POST)


@pytest.fixture(scope="module", params=["pick and place", "pickup through vias"])
def motion(request: pytest.FixtureRequest, cell: Cell, pick_and_place: Skill) -> Motion:
    return cell.plan(pick_and_place) if request.param == "pick and place" else cell.plan(vias=vias_of(cell))


def vias_of(cell: Cell) -> dict[str, Array]:
    """Detours of the joint moves of a pickup, in its branches: of one corner and of two."""
    direct = cell.plan()
    a1, a5 = (direct.primitives[k].trajectory.path.positions([0.3, 0.7]) for k in (0, 4))
    aside, back = np.array([[0.0, -0.3, 0.2, 0.4, 0.0, 0.5], [0.2, -0.3, 0.0, 0.0, 0.6, -0.4]])
    return {"a1": a1[:1] + aside, "a5": a5 + back}


def test_what_a_motion_was_planned_with_is_let_go_before_garbage_is_collected(cell):
    gc.disable()  # thousands of candidates would wait for it
    try:
        cell.plan()
        assert not [one for one in gc.get_objects() if isinstance(one, JointMoves | MotionProblem)]
    finally:
        gc.enable()


def test_all_limits_are_kept_throughout_and_primitives_join_at_rest_without_gaps(motion, ur5, cell):
    assert_keeps_limits(ur5, motion)
    np.testing.assert_allclose(motion.positions(0, np.zeros(1))[0], cell.model.home, atol=1e-12)
    last = len(motion.primitives) - 1
    np.testing.assert_allclose(motion.positions(last, [motion.time])[0], cell.model.home, atol=1e-9)
    for primitive in motion.primitives:
        assert primitive.end - primitive.start == pytest.approx(primitive.trajectory.duration, abs=1e-12)


def test_straight_moves_keep_the_tools_limits(motion, ur5, cell):
    primitive = motion.primitives[1]
    down = cell.skill.primitives[1]
    dt = 1e-3
    t = np.arange(0, primitive.end - primitive.start, dt)
    p = np.array([ur5.tool_pose(q)[:3, 3] for q in primitive.trajectory.positions(t)])
    for order, limit in ((1, down.speed), (2, down.acceleration)):
        assert np.linalg.norm(np.diff(p, order, axis=0) / dt**order, axis=1).max() <= float(limit) * 1.001


def test_approach_and_lift_are_straight_within_a_tenth_of_a_millimetre(motion, ur5):
    for primitive in (p for p in motion.primitives if p.name in ("a2", "a4", "b2", "b5")):
        t = np.linspace(0, primitive.end - primitive.start, 400)
        X = np.array([ur5.tool_pose(q) for q in primitive.trajectory.positions(t)])
        start, end = X[0, :3, 3], X[-1, :3, 3]
        direction = (end - start) / np.linalg.norm(end - start)
        off = (X[:, :3, 3] - start) - ((X[:, :3, 3] - start) @ direction)[:, None] * direction
        assert np.linalg.norm(off, axis=1).max() < 1e-4
        assert np.abs(X[:, :3, :3] - X[0, :3, :3]).max() < 1e-5
        assert abs(direction[2]) == pytest.approx(1.0, abs=1e-6)


def test_grasp_takes_hold_at_its_end_and_the_object_does_not_jump(motion, ur5):
    names = [primitive.name for primitive in motion.primitives]
    grasp, lift = names.index("a3"), names.index("a4")
    assert [p.held for p in motion.primitives[: grasp + 1]] == [None] * (grasp + 1)
    held = motion.primitives[lift]
    assert held.held == "cube"
    assert "cube" not in held.X_WO
    X_WT = ur5.tool_pose(held.trajectory.positions([0.0])[0])
    np.testing.assert_allclose(X_WT @ held.X_TO, motion.primitives[grasp].X_WO["cube"], atol=1e-9)
    np.testing.assert_allclose(X_WT[:3, 3], [0.45, -0.25, 0.04], atol=1e-9)


def test_release_leaves_the_object_where_the_tool_is(cell, pick_and_place):
    motion = cell.plan(pick_and_place)
    held = {p.name: p.held for p in motion.primitives}
    assert [held[name] for name in ("a4", "b1", "b4", "b5")] == ["cube", "cube", "cube", None]
    assert motion.final.held is None
    np.testing.assert_allclose(motion.final.X_WO["cube"][:3, 3], [0.35, 0.35, 0.021], atol=1e-9)
    np.testing.assert_array_equal(motion.primitives[-1].X_WO["cube"], motion.final.X_WO["cube"])


def test_the_world_afterwards_has_the_object_in_the_tool(cell):
    motion = cell.plan()
    X_WT = cell.model.tool_pose(np.array([motion.final.joints[joint] for joint in motion.joint_names]))
    assert motion.final.held == "cube"
    np.testing.assert_allclose(motion.final.X_WO["cube"], X_WT @ motion.final.X_TO, atol=1e-12)
    follow_up = cell.plan(world=motion.final)
    assert follow_up == Infeasible(("the tool still holds `cube`, so `a3` cannot grasp `cube`",))


def test_nothing_touches_at_steps_of_a_millisecond_in_pinocchios_own_model(motion, cell):
    independent, cube = pinocchio_arm(cell), pair("cube", "table")
    meant = {name: {pair("tool", "cube")} for name in ("a2", "a3", "b5")}
    meant |= {name: {cube} for name in ("a4", "b2", "b3", "b4")}
    for index, primitive in enumerate(motion.primitives):
        dt = 1e-3 if primitive.name in ("a1", "a5", "b1", "b6") else 4e-3
        t = np.arange(0, primitive.end - primitive.start, dt)
        found = independent.contacts(motion, index, t, 0.9 * CLEARANCE)
        assert found <= meant.get(primitive.name, set()), primitive.name
        assert primitive.name != "a4" or cube in found  # it does see contacts


def test_it_is_the_fastest_of_all_feasible_branches(cell):
    """Of every branch of `pickup`, with every turn of every joint, that touches nothing."""
    model, world, values = cell.model, cell.world, VALUES
    limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
    down, lift = cell.skill.primitives[1], cell.skill.primitives[3]
    X_grasp = pose(axis_rotation(0, np.pi) @ axis_rotation(2, values["approach_yaw"]), (0.45, -0.25, 0.04))
    X_above, X_lifted = X_grasp.copy(), X_grasp.copy()
    X_above[2, 3] += 0.02
    X_lifted[2, 3] += values["lift"]
    held = replace(world, held="cube", X_TO=inverse(X_grasp) @ world.X_WO["cube"])
    touched = frozenset({pair("cube", "table"), *(pair("cube", link) for link in model.tool_links)})
    free, tied = cell.scene.placed(world), cell.scene.placed(world, touched)
    carried, carried_home = cell.scene.placed(held, touched), cell.scene.placed(held)
    turns = [np.array(t) * 2 * np.pi for t in product((-1, 0, 1), repeat=6)]
    times = []
    for q in all_solutions(model, X_above):
        for turn in turns:
            start = q + turn
            if (start < model.lower).any() or (start > model.upper).any():
                continue
            first = second = straight_line(model, start, tool_line(X_above, X_grasp))
            if isinstance(first, JointPath):
                second = straight_line(model, first.end, tool_line(X_grasp, X_lifted))
            if not isinstance(second, JointPath):
                continue
            a1, a5 = joint_move(model.home, start, limits), joint_move(second.end, model.home, limits)
            tool = [np.array([m.speed, m.acceleration, m.jerk], dtype=float) for m in (down, lift)]
            (a2,) = time_paths([first], limits, MotionLimits(*(tool[0] / 0.02)))
            (a4,) = time_paths([second], limits, MotionLimits(*(tool[1] / values["lift"])))
            checks = ((free, a1), (tied, a2), (carried, a4), (carried_home, a5))
            if all(scene.check_path(trajectory.path) is None for scene, trajectory in checks):
                times.append(a1.duration + a2.duration + 1.0 + a4.duration + a5.duration)
    assert len(times) > 4
    assert cell.plan().time == pytest.approx(min(times), abs=1e-6)


def test_speed_slows_joint_moves_down_and_leaves_straight_ones(cell):
    fast, slow = ([one.trajectory for one in cell.plan(speed=speed).primitives] for speed in (1.0, 0.3))
    assert slow[0].duration > fast[0].duration
    assert slow[1].duration == pytest.approx(fast[1].duration)
    velocities = slow[0].motion(np.linspace(0, slow[0].duration, 500), 1)[1]
    assert (np.abs(velocities) / cell.model.velocity).max() == pytest.approx(0.3, abs=1e-6)


AT_CUBE = (0.45, -0.25)

INFEASIBLE = {
    "out of reach": ({"cube": (1.5, 0, 0.02)}, (), {}, r"\Aa1 to `above`: .*\d m\b"),
    "under a roof": ({}, [((0.3, 0.3, 0.01), (*AT_CUBE, 0.15))], {}, r"\A.*hits thing0 at the end of a1"),
    "beside a neighbour without a gap": ({"other": (0.49, -0.25, 0.02)}, (), {}, "cube hits other"),
    "a line that leaves the reach": ({}, (), {"lift": 1.5}, "of 1500 mm"),
    # A slat overhangs the cube's rim by 1 mm, its underside 45 mm above it: just before half of a lift of 100 mm.
    "a shelf above": ({}, [((0.01, 0.3, 0.01), (0.474, -0.25, 0.09))], {}, r"\Acube hits thing0 at 4[0-8] % of a4$"),
}


@pytest.mark.parametrize("case", INFEASIBLE)
def test_what_cannot_be_done_says_why_and_where(cell, tabletop, case):
    places, more, values, said = INFEASIBLE[case]
    things = [thing(f"thing{k}", size, pose(position=at)) for k, (size, at) in enumerate(more)]
    used = among(tabletop, cell.model, TABLE, CUBE, *things) if things else cell
    X_WO = {**used.world.X_WO, **{name: pose(position=at) for name, at in places.items()}}
    result = used.plan(world=replace(used.world, X_WO=X_WO), **values)
    assert re.search(said, "\n".join(result.reasons), re.MULTILINE), result.reasons


def test_grasping_from_the_side_works_too(cell, tabletop):
    tall = thing("cube", (0.05, 0.05, 0.4), pose(position=(0.5, -0.2, 0.2)), fixed=False)
    grasp = {"object": "object", "side": "-x", "yaw": 0.0}
    others = {"above": {"from": "grasp", "retreat": 0.05}, "lifted": {"from": "grasp", "raise": 0.1}}
    skill = replace(cell.skill, waypoints=read_waypoints({"grasp": grasp, **others}))
    motion = Cell(tabletop.robot, cell.model, skill, (TABLE, tall)).plan()
    q_grasp = motion.primitives[2].trajectory.positions([0.0])[0]
    np.testing.assert_allclose(cell.model.tool_pose(q_grasp)[:3, 2], [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_a_lift_goes_at_the_stated_speed_between_ramps_or_the_one_that_joints_allow_is_said(cell, speed):
    """At 5 cm/s and with the ramps of the tool alone, 0.2 s to 5 cm/s, 10 cm would take 2.2 s; 50 cm/s are too fast."""
    at_speed = [
        one.model_copy(update={"speed": speed}) if isinstance(one, StraightMove) else one
        for one in cell.skill.primitives
    ]
    motion = cell.plan(replace(cell.skill, primitives=tuple(at_speed)))
    lift = motion.primitives[3].trajectory
    t = np.linspace(0.0, lift.duration, 2000)
    places = cell.model.tool_poses(lift.positions(t))[:, :3, 3]
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(t)
    if speed == 0.05:
        assert 2.2 < lift.duration < 2.36
        assert speeds.max() == pytest.approx(0.05, rel=1e-3)
        assert (speeds > 0.0499).mean() > 0.6
        assert motion.remarks == ()
    else:
        said = re.fullmatch(r"a4 reaches ([\d.]+) of 50 cm/s", motion.remarks[-1])
        assert float(said[1]) == pytest.approx(100 * speeds.max(), rel=0.05)


@given(st.integers(0, 100_000), st.lists(st.integers(1, 4), min_size=1, max_size=4), st.booleans())
def test_the_sequence_is_the_fastest_that_works_with_ties_by_joint_values(seed, sizes, ties):
    rng = np.random.default_rng(seed)

    def times(*shape: int) -> np.ndarray:
        return rng.integers(1, 3, shape).astype(float) if ties else rng.uniform(0, 1, shape)

    starts, durations = [rng.normal(size=(k, 2)) for k in sizes], [times(k) for k in sizes]
    moves = [times(a, b) for a, b in pairwise(sizes)]
    blocked = {
        (i, previous, chosen)
        for i, size in enumerate(sizes)
        for previous in (range(sizes[i - 1]) if i else (-1,))
        for chosen in range(size)
        if rng.random() < 0.4
    }
    asked: list[tuple[int, ...]] = []

    def works(*question: int) -> bool:
        asked.append(question)
        return question[:3] not in blocked

    def total(chosen: tuple[int, ...]) -> float:
        own = sum(float(duration[k]) for duration, k in zip(durations, chosen, strict=True))
        return own + sum(float(moves[i][chosen[i], chosen[i + 1]]) for i in range(len(moves)))

    def possible(chosen: tuple[int, ...]) -> bool:
        return not any((i, chosen[i - 1] if i else -1, k) in blocked for i, k in enumerate(chosen))

    def order(chosen: tuple[int, ...]) -> tuple[float, list[float]]:
        joints = [np.round(start[k], 6) for start, k in zip(starts, chosen, strict=True)]
        return round(total(chosen), 6), np.concatenate(joints).tolist()

    best = min(filter(possible, product(*map(range, sizes))), key=order, default=None)
    assert fastest_sequence(starts, durations, moves, works) == best
    assert len(asked) == len(set(asked))
    least = [duration * rng.choice([0.5, 1.0], len(duration)) for duration in durations]
    assert fastest_sequence(starts, least, moves, works, takes=lambda i, k: float(durations[i][k])) == best
