"""Straight lines of the tool, checked by forward kinematics at a fine step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, displacement, pose
from sqrp_cli.motion.straight_line import follow
from sqrp_cli.motion.tool_curve import ToolCurve, progress, rotation_vector, tool_line
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.trajectory import JointPath
from tests.motion.straight import straight_line

READY = np.array([0.3, -1.6, 1.9, -1.9, -1.6, 0.2])
"""The UR5 with its tool about 0.4 m in front of it, far from singularities."""

HAPPENS_ON_SESSION_FIXTURES = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


def vectors(length: float) -> st.SearchStrategy[Array]:
    return st.tuples(*(st.floats(-length, length),) * 3).map(np.array)


def line_from(model: RobotModel, q: Array, shift: Array, turn: Array) -> ToolCurve:
    X = model.tool_pose(q)
    return tool_line(X, pose(displacement(shift, turn)[:3, :3] @ X[:3, :3], X[:3, 3] + shift))


@given(shift=vectors(0.1), turn=vectors(0.3))
@HAPPENS_ON_SESSION_FIXTURES
def test_the_tool_follows_position_and_orientation_of_the_line_everywhere(
    ur5: RobotModel, shift: Array, turn: Array
) -> None:
    line = line_from(ur5, READY, shift, turn)
    path = straight_line(ur5, READY, line)
    assert isinstance(path, JointPath)
    np.testing.assert_allclose(path.positions([0.0])[0], READY, atol=1e-12)
    s = np.linspace(0, 1, 173)
    for at, q in zip(s, path.positions(s), strict=True):
        reached, wanted = ur5.tool_pose(q), line.poses(np.array([at]))[0]
        assert np.linalg.norm(reached[:3, 3] - wanted[:3, 3]) < 2e-6
        assert np.linalg.norm(rotation_vector(reached[:3, :3] @ wanted[:3, :3].T)) < 2e-6


def test_a_line_is_one_polynomial_so_its_jerk_has_no_steps(ur5: RobotModel) -> None:
    path = straight_line(ur5, READY, line_from(ur5, READY, np.array([0.0, 0.2, 0.1]), np.zeros(3)))
    assert isinstance(path, JointPath)
    assert len(path.breaks) == 2


def test_a_line_out_of_reach_is_infeasible_and_says_where(ur5: RobotModel) -> None:
    outward = ur5.tool_pose(READY)[:3, 3] * [1, 1, 0]
    outward *= 1.5 / np.linalg.norm(outward)
    result = straight_line(ur5, READY, line_from(ur5, READY, outward, np.zeros(3)))
    assert isinstance(result, Infeasible)
    assert "of 1500 mm" in result.reasons[0]
    reached = float(result.reasons[0].split(" mm of")[0].split()[-1])
    edge = line_from(ur5, READY, outward * (reached + 5) / 1500, np.zeros(3))
    assert isinstance(straight_line(ur5, READY, edge), Infeasible)
    inside = line_from(ur5, READY, outward * (reached - 15) / 1500, np.zeros(3))
    assert isinstance(straight_line(ur5, READY, inside), JointPath)


def test_a_joint_limit_on_the_way_is_named_with_the_distance(ur5: RobotModel) -> None:
    turned = READY + 2 * np.pi * np.array([1, 0, 0, 0, 0, 0])  # 0.3 rad from home, one turn further: limit at 2 pi
    turned[0] = 2 * np.pi - 0.05
    X = ur5.tool_pose(turned)
    radius = np.linalg.norm(X[:2, 3])
    sideways = axis_rotation(2, np.pi / 2)[:, :2] @ X[:2, 3] / radius * 0.2
    result = straight_line(ur5, turned, tool_line(X, pose(X[:3, :3], X[:3, 3] + sideways)))
    assert isinstance(result, Infeasible)
    assert result.reasons[0].startswith("joint `shoulder_pan_joint` 21.2 deg past its limit, which it reaches after ")
    assert result.reasons[0].endswith(" mm of 200 mm of the straight line")


@pytest.mark.parametrize(
    ("shift", "some_are_stuck"), [([0.0, 0.1, 0.0], False), ([-0.5, 0.0, 0.0], False), ([-0.3, 0.3, 0.3], True)]
)
def test_branches_followed_at_once_are_each_as_alone(ur5: RobotModel, shift: list[float], some_are_stuck: bool) -> None:
    X = ur5.tool_pose(READY)
    line = tool_line(X, pose(X[:3, :3], X[:3, 3] + shift))
    q0 = all_solutions(ur5, X).solutions
    assert len(q0) > 4
    together = follow(ur5, q0, line)
    for q, path in zip(q0, together, strict=True):
        (alone,) = follow(ur5, q[None], line)
        if isinstance(alone, JointPath):
            assert isinstance(path, JointPath)
            np.testing.assert_allclose(path.coefficients, alone.coefficients, atol=1e-9)
        else:
            assert path == alone
    assert {type(path) for path in together} == ({JointPath, Infeasible} if some_are_stuck else {JointPath})


@given(vectors(1.7))
def test_rotation_vectors_and_matrices_are_inverse(vector: Array) -> None:
    np.testing.assert_allclose(rotation_vector(displacement(np.zeros(3), vector)[:3, :3]), vector, atol=1e-9)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8], [-0.6, 0.48, 0.64]])
def test_half_a_turn_gives_one_of_both_axes(axis: list[float]) -> None:
    vector = rotation_vector(displacement(np.zeros(3), np.pi * np.array(axis))[:3, :3])
    assert np.linalg.norm(vector) == pytest.approx(np.pi)
    np.testing.assert_allclose(np.abs(vector @ np.array(axis)), np.pi, rtol=1e-9)


def test_progress_is_in_millimetres_or_degrees(ur5: RobotModel) -> None:
    assert progress(line_from(ur5, READY, np.array([0.1, 0, 0]), np.zeros(3)), 0.34) == "34 mm of 100 mm"
    assert progress(line_from(ur5, READY, np.zeros(3), np.array([0, 0, np.pi / 2])), 0.5) == "45 deg of 90 deg"
