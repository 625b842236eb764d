"""Straight lines, arcs and helices of the tool, checked by forward kinematics at a fine step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, displacement, pose
from sqrp_cli.motion.tool_path import (
    ToolCurve,
    arc_through,
    follow,
    follow_within_limits,
    helix_about,
    limit_reason,
    progress,
    rotation_vector,
    tool_line,
)
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.trajectory import JointPath

READY = np.array([0.3, -1.6, 1.9, -1.9, -1.6, 0.2])
"""The UR5 with its tool about 0.4 m in front of it, far from singularities."""

SOME, FEW = (settings(max_examples=n, suppress_health_check=[HealthCheck.function_scoped_fixture]) for n in (60, 25))


def vectors(length: float) -> st.SearchStrategy[Array]:
    return st.tuples(*(st.floats(-length, length),) * 3).map(np.array)


def straight_line(model: RobotModel, q0: Array, line: ToolCurve) -> JointPath | Infeasible:
    """The joint path that moves the tool along the line, from q0, shape (n,), with the tool at the line's start.

    The path is one polynomial per joint, exact at Chebyshev points and within `TOLERANCE` between them. Infeasible,
    with the place, where the arm becomes singular or a joint reaches its limit.
    """
    (path,) = follow_within_limits(model, q0[None], line, np.zeros(len(model.arm), dtype=bool))
    if isinstance(path, JointPath) and (reason := limit_reason(model, path, line)) is not None:
        return Infeasible((reason,))
    return path


def line_from(model: RobotModel, q: Array, shift: Array, turn: Array) -> ToolCurve:
    X = model.tool_pose(q)
    return tool_line(X, pose(displacement(shift, turn)[:3, :3] @ X[:3, :3], X[:3, 3] + shift))


def followed(ur5: RobotModel, curve: ToolCurve) -> JointPath:
    """The path along a curve: one polynomial, so that its jerk has no steps, with the tool on the curve everywhere."""
    path = straight_line(ur5, READY, curve)
    assert isinstance(path, JointPath), path
    assert len(path.breaks) == 2
    np.testing.assert_allclose(path.positions([0.0])[0], READY, atol=1e-12)
    s = np.linspace(0, 1, 401)
    for q, wanted in zip(path.positions(s), curve.poses(s), strict=True):
        reached = ur5.tool_pose(q)
        assert np.linalg.norm(reached[:3, 3] - wanted[:3, 3]) < 2e-6
        assert np.linalg.norm(rotation_vector(reached[:3, :3] @ wanted[:3, :3].T)) < 2e-6
    return path


@given(shift=vectors(0.1), turn=vectors(0.3))
@SOME
def test_the_tool_follows_position_and_orientation_of_the_line_everywhere(ur5, shift, turn):
    followed(ur5, line_from(ur5, READY, shift, turn))


def test_a_line_out_of_reach_is_infeasible_and_says_where(ur5):
    outward = ur5.tool_pose(READY)[:3, 3] * [1, 1, 0]
    outward *= 1.5 / np.linalg.norm(outward)
    result = straight_line(ur5, READY, line_from(ur5, READY, outward, np.zeros(3)))
    assert "of 1500 mm" in result.reasons[0]
    reached = float(result.reasons[0].split(" mm of")[0].split()[-1])
    edge = line_from(ur5, READY, outward * (reached + 5) / 1500, np.zeros(3))
    assert isinstance(straight_line(ur5, READY, edge), Infeasible)
    inside = line_from(ur5, READY, outward * (reached - 15) / 1500, np.zeros(3))
    assert isinstance(straight_line(ur5, READY, inside), JointPath)


def test_a_joint_limit_on_the_way_is_named_with_the_distance(ur5):
    turned = READY + 2 * np.pi * np.array([1, 0, 0, 0, 0, 0])  # 0.3 rad from home, one turn further: limit at 2 pi
    turned[0] = 2 * np.pi - 0.05
    X = ur5.tool_pose(turned)
    radius = np.linalg.norm(X[:2, 3])
    sideways = axis_rotation(2, np.pi / 2)[:, :2] @ X[:2, 3] / radius * 0.2
    result = straight_line(ur5, turned, tool_line(X, pose(X[:3, :3], X[:3, 3] + sideways)))
    assert result.reasons[0].startswith("joint `shoulder_pan_joint` 21.2 deg past its limit, which it reaches after ")
    assert result.reasons[0].endswith(" mm of 200 mm of the straight line")


@pytest.mark.parametrize(
    ("shift", "some_are_stuck"), [([0.0, 0.1, 0.0], False), ([-0.5, 0.0, 0.0], False), ([-0.3, 0.3, 0.3], True)]
)
def test_branches_followed_at_once_are_each_as_alone(ur5, shift, some_are_stuck):
    X = ur5.tool_pose(READY)
    line = tool_line(X, pose(X[:3, :3], X[:3, 3] + shift))
    q0 = all_solutions(ur5, X)
    assert len(q0) > 4
    together = follow(ur5, q0, line)
    for q, path in zip(q0, together, strict=True):
        (alone,) = follow(ur5, q[None], line)
        if isinstance(alone, JointPath):
            np.testing.assert_allclose(path.coefficients, alone.coefficients, atol=1e-9)
        else:
            assert path == alone
    assert {type(path) for path in together} == ({JointPath, Infeasible} if some_are_stuck else {JointPath})


@given(vectors(1.7))
def test_rotation_vectors_and_matrices_are_inverse(vector):
    np.testing.assert_allclose(rotation_vector(displacement(np.zeros(3), vector)[:3, :3]), vector, atol=1e-9)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8], [-0.6, 0.48, 0.64]])
def test_half_a_turn_gives_one_of_both_axes(axis):
    vector = rotation_vector(displacement(np.zeros(3), np.pi * np.array(axis))[:3, :3])
    assert np.linalg.norm(vector) == pytest.approx(np.pi)
    np.testing.assert_allclose(np.abs(vector @ np.array(axis)), np.pi, rtol=1e-9)


def test_progress_is_in_millimetres_or_degrees(ur5):
    assert progress(line_from(ur5, READY, np.array([0.1, 0, 0]), np.zeros(3)), 0.34) == "34 mm of 100 mm"
    assert progress(line_from(ur5, READY, np.zeros(3), np.array([0, 0, np.pi / 2])), 0.5) == "45 deg of 90 deg"


@given(through=vectors(1.0), end=vectors(1.0))
@FEW
def test_an_arc_passes_its_points_at_one_distance_from_its_centre_and_in_this_order(through, end):
    arc = arc_through(pose(), through, pose(position=end))
    if arc.word == "straight line":
        return
    np.testing.assert_allclose(arc.X_end[:3, 3], end, atol=1e-6)
    on_way = arc.poses(np.linspace(0.0, 1.0, 4001))[:, :3, 3]
    nearest = np.linalg.norm(on_way - through, axis=1).min()
    assert nearest <= arc.length / 4000 + 1e-6
    np.testing.assert_allclose(
        np.linalg.norm(on_way - (arc.X_start[:3, 3] - arc.arm), axis=1), np.linalg.norm(arc.arm), rtol=1e-6, atol=1e-9
    )
    assert np.linalg.norm(np.diff(on_way, axis=0), axis=1).sum() == pytest.approx(arc.length, rel=1e-4)


def test_three_points_on_a_line_make_a_line():
    assert arc_through(pose(), np.array([0.1, 0, 0]), pose(position=(0.3, 0, 0))).word == "straight line"


def test_a_screw_turns_the_last_joint_as_often_as_it_says(ur5):
    X = ur5.tool_pose(READY)
    path = followed(ur5, helix_about(X, X, np.radians(-330), 0.003, keep_orientation=False))
    assert path.end[5] - READY[5] == pytest.approx(np.radians(-330), abs=0.05)
    np.testing.assert_allclose(ur5.tool_pose(path.end)[:3, 3], X[:3, 3] + 0.003 * X[:3, 2], atol=2e-6)


def test_more_turns_than_the_last_joint_has_are_infeasible_and_say_after_how_many_degrees(ur5):
    X = ur5.tool_pose(READY)
    result = straight_line(ur5, READY, helix_about(X, X, np.radians(720), 0.0, keep_orientation=False))
    assert "of 720 deg of the helix" in result.reasons[0]
    reached = float(result.reasons[0].split(" deg of 720")[0].split()[-1])
    last = np.degrees(2 * np.pi - READY[5])
    assert reached == pytest.approx(last, abs=8.0)


@pytest.mark.parametrize("turns", [1, 3])
def test_circles_that_keep_the_orientation_come_back_every_turn(ur5, turns):
    X = ur5.tool_pose(READY)
    axis = pose(np.eye(3), X[:3, 3] + [0.03, 0.01, 0.0])
    path = followed(ur5, helix_about(axis, X, turns * 2 * np.pi, -0.01, keep_orientation=True))
    shifted = straight_line(ur5, READY, tool_line(X, pose(X[:3, :3], X[:3, 3] - [0, 0, 0.01])))
    np.testing.assert_allclose(path.end, shifted.end, atol=1e-5)


def test_a_helix_about_an_axis_far_from_the_tool_turns_the_tool_with_it():
    X = pose(axis_rotation(0, np.pi), (0.5, 0.0, 0.2))
    helix = helix_about(pose(), X, np.pi / 2, 0.1, keep_orientation=False)
    np.testing.assert_allclose(helix.X_end, pose(axis_rotation(2, np.pi / 2) @ X[:3, :3], (0.0, 0.5, 0.3)), atol=1e-12)
    assert helix.length == pytest.approx(np.hypot(0.5 * np.pi / 2, 0.1))
