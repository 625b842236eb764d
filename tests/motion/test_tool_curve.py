"""Arcs and helices of the tool."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, pose
from sqrp_cli.motion.tool_curve import ToolCurve, arc_through, helix_about, rotation_vector, tool_line
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.trajectory import JointPath
from tests.motion.straight import straight_line
from tests.motion.test_straight_line import READY

FEW = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def points(size: float) -> st.SearchStrategy[Array]:
    return st.tuples(*(st.floats(-size, size),) * 3).map(np.array)


@given(through=points(1.0), end=points(1.0))
@FEW
def test_an_arc_passes_its_points_at_one_distance_from_its_centre_and_in_this_order(through: Array, end: Array) -> None:
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


def test_three_points_on_a_line_make_a_line() -> None:
    assert arc_through(pose(), np.array([0.1, 0, 0]), pose(position=(0.3, 0, 0))).word == "straight line"


def followed(ur5: RobotModel, curve: ToolCurve) -> JointPath:
    path = straight_line(ur5, READY, curve)
    assert isinstance(path, JointPath), path
    s = np.linspace(0, 1, 401)
    for q, wanted in zip(path.positions(s), curve.poses(s), strict=True):
        reached = ur5.tool_pose(q)
        assert np.linalg.norm(reached[:3, 3] - wanted[:3, 3]) < 2e-6
        assert np.linalg.norm(rotation_vector(reached[:3, :3] @ wanted[:3, :3].T)) < 2e-6
    return path


def test_a_screw_turns_the_last_joint_as_often_as_it_says(ur5: RobotModel) -> None:
    X = ur5.tool_pose(READY)
    path = followed(ur5, helix_about(X, X, np.radians(-330), 0.003, keep_orientation=False))
    assert path.end[5] - READY[5] == pytest.approx(np.radians(-330), abs=0.05)
    np.testing.assert_allclose(ur5.tool_pose(path.end)[:3, 3], X[:3, 3] + 0.003 * X[:3, 2], atol=2e-6)


def test_more_turns_than_the_last_joint_has_are_infeasible_and_say_after_how_many_degrees(ur5: RobotModel) -> None:
    X = ur5.tool_pose(READY)
    result = straight_line(ur5, READY, helix_about(X, X, np.radians(720), 0.0, keep_orientation=False))
    assert isinstance(result, Infeasible)
    assert "of 720 deg of the helix" in result.reasons[0]
    reached = float(result.reasons[0].split(" deg of 720")[0].split()[-1])
    last = np.degrees(2 * np.pi - READY[5])
    assert reached == pytest.approx(last, abs=8.0)


@pytest.mark.parametrize("turns", [1, 3])
def test_circles_that_keep_the_orientation_come_back_every_turn(ur5: RobotModel, turns: int) -> None:
    X = ur5.tool_pose(READY)
    axis = pose(np.eye(3), X[:3, 3] + [0.03, 0.01, 0.0])
    path = followed(ur5, helix_about(axis, X, turns * 2 * np.pi, -0.01, keep_orientation=True))
    shifted = straight_line(ur5, READY, tool_line(X, pose(X[:3, :3], X[:3, 3] - [0, 0, 0.01])))
    assert isinstance(shifted, JointPath)
    np.testing.assert_allclose(path.end, shifted.end, atol=1e-5)


def test_a_helix_about_an_axis_far_from_the_tool_turns_the_tool_with_it() -> None:
    X = pose(axis_rotation(0, np.pi), (0.5, 0.0, 0.2))
    helix = helix_about(pose(), X, np.pi / 2, 0.1, keep_orientation=False)
    np.testing.assert_allclose(helix.X_end, pose(axis_rotation(2, np.pi / 2) @ X[:3, :3], (0.0, 0.5, 0.3)), atol=1e-12)
    assert helix.length == pytest.approx(np.hypot(0.5 * np.pi / 2, 0.1))
