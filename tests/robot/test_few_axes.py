"""Arms with fewer than six axes: the tool is where it is wanted, and turned within the tolerance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, axis_rotation, pose
from sqrp_cli.motion.tool_path import tool_line
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from tests.motion.test_tool_curves import straight_line
from tests.task.robots import FEW_AXES, LIFTS, jacobian, robot, rounded, written_urdf

TOLERANCE = np.radians(0.5)
BY = 0.0016
"""Half a turn written as 3.14 is wrong by this [rad]."""

READY = {
    "five axes": [0.3, -0.2, 0.6, 1.1, 0.4],
    "four axes": [0.3, -0.2, 0.6, 1.1],
    "SCARA": [0.3, 0.8, -0.1, 0.2],
    "gantry": [0.1, 0.2, 0.5],
}


def arm(name: str, folder: Path, by: float, tolerance: float) -> RobotModel:
    urdf = written_urdf(folder / f"arm{by:g}.urdf", *rounded(FEW_AXES[name], by))
    return RobotModel.load(robot(urdf, "tool0", angle_tolerance=tolerance))


def angle_between(X: Array, Y: Array) -> float:
    return float(np.arccos(np.clip((np.trace(X[:3, :3].T @ Y[:3, :3]) - 1) / 2, -1, 1)))


@pytest.mark.parametrize("name", FEW_AXES)
def test_a_pose_of_the_exact_arm_is_taken_by_the_rounded_one_within_the_tolerance(name, tmp_path):
    """The rounded arm cannot take it exactly; its solutions put the origin there, turned as far as it goes."""
    X_WT = arm(name, tmp_path, 0.0, 0.0).tool_pose(np.array(READY[name]))
    exact = all_solutions(arm(name, tmp_path, BY, 0.0), X_WT)
    assert not len(exact.solutions)
    model = arm(name, tmp_path, BY, TOLERANCE)
    found = all_solutions(model, X_WT)
    assert np.abs(found.solutions - READY[name]).max(axis=1).min() < 0.05
    for q in found.solutions:
        reached = model.tool_pose(q)
        np.testing.assert_allclose(reached[:3, 3], X_WT[:3, 3], atol=1e-10)
        angle = angle_between(reached, X_WT)
        assert 1e-4 < angle < TOLERANCE
        if len(q) > 3:
            assert_turned_as_far_as_it_goes(model, q, X_WT, angle)


def assert_turned_as_far_as_it_goes(model: RobotModel, q: Array, X_WT: Array, angle: float) -> None:
    """No small motion that keeps the tool's origin brings the tool closer to the pose."""
    J = jacobian(model, q)
    for still in np.linalg.svd(J[:3])[2][3:]:
        for step in (-1e-4, 1e-4):
            assert angle_between(model.tool_pose(q + step * still), X_WT) > angle - 2e-7


@pytest.mark.parametrize("name", FEW_AXES)
def test_a_straight_line_keeps_to_its_line_and_within_the_tolerance(name, tmp_path):
    model = arm(name, tmp_path, BY, TOLERANCE)
    start = arm(name, tmp_path, 0.0, 0.0).tool_pose(np.array(READY[name]))
    line = tool_line(start, pose(position=(0.0, 0.0, -0.05)) @ start)
    q0 = min(all_solutions(model, start).solutions, key=lambda q: float(np.abs(q - READY[name]).max()))
    path = straight_line(model, q0, line)
    assert not isinstance(path, Infeasible)
    s = np.linspace(0.0, 1.0, 200)
    for wanted, q in zip(line.poses(s), path.positions(s), strict=True):
        reached = model.tool_pose(q)
        assert np.linalg.norm(reached[:3, 3] - wanted[:3, 3]) < 2e-6
        assert angle_between(reached, wanted) < TOLERANCE


def test_what_is_beyond_the_tolerance_is_out_of_reach_and_the_reason_says_by_how_much(tmp_path):
    model = arm("SCARA", tmp_path, 0.0, TOLERANCE)
    tilted = model.tool_pose(np.array(READY["SCARA"])) @ pose(axis_rotation(0, np.radians(0.8)))
    found = all_solutions(model, tilted)
    assert not len(found.solutions)
    assert found.reason is not None
    assert found.reason.why == "wrong way round"
    assert "0.80 deg at best" in str(found.reason)


@pytest.mark.parametrize("name", LIFTS)
@pytest.mark.parametrize("yaw", [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi])
def test_a_wrist_whose_limit_is_rounded_points_down_within_the_tolerance(name, yaw, tmp_path):
    """Straight down the wrist is singular, and 0.8 mrad past its limit; lines go down and up again, too."""
    urdf = written_urdf(tmp_path / "lift.urdf", *LIFTS[name])
    limits = {"pitch": (-1.6, 0.56)}
    beyond = RobotModel.load(robot(urdf, "tip", limits=limits))
    model = RobotModel.load(robot(urdf, "tip", angle_tolerance=TOLERANCE))
    extended = [0.05] * (len(model.arm) - 4) if len(model.arm) > 5 else [0.2]
    X_WT = beyond.tool_pose(np.array([0.6, *extended, 0.7, -0.5 * np.pi, 0.3]))
    X_WT[:3, :3] = axis_rotation(2, yaw) @ X_WT[:3, :3]
    found = all_solutions(model, X_WT)
    assert len(found.solutions)
    line = tool_line(X_WT, pose(position=(0.0, 0.0, -0.1)) @ X_WT)
    for q in found.solutions:
        assert (model.lower <= q).all()
        assert (q <= model.upper).all()
        np.testing.assert_allclose(model.tool_pose(q)[:3, 3], X_WT[:3, 3], atol=1e-9)
        assert angle_between(model.tool_pose(q), X_WT) < TOLERANCE
        if name == "the arm as one joint":
            assert angle_between(model.tool_pose(q), X_WT) == pytest.approx(0.5 * np.pi - 1.57, abs=1e-6)
    assert any(not isinstance(straight_line(model, q, line), Infeasible) for q in found.solutions)
    exact = all_solutions(RobotModel.load(robot(urdf, "tip")), X_WT)
    assert str(exact.reason) == "joint `pitch` 0.0456 deg past its limit"
