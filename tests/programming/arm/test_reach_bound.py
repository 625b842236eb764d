"""The sphere that proves places too far, against forward kinematics and the search for the closest pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sqrp_cli.geometry import Array, pose, rpy_to_matrix
from sqrp_cli.programming.arm import inverse_kinematics
from sqrp_cli.programming.arm.inverse_kinematics import all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.arm.reach import OutOfReach
from sqrp_cli.programming.arm.reach_bound import beyond_reach
from tests.programming.robots import REAL_ARMS, joint, real_arm, robot, written_urdf


def any_positions(model: RobotModel, count: int) -> Array:
    """Joint positions within the limits, and as many stretched out by turning single joints of them to zero."""
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(model.lower, -np.pi), np.minimum(model.upper, np.pi), (count, len(model.arm)))
    stretched = q * (rng.random(q.shape) < 0.5)
    return np.concatenate([q, np.clip(stretched, model.lower, model.upper)])


@pytest.mark.parametrize("name", REAL_ARMS)
def test_no_pose_that_an_arm_takes_is_beyond_its_reach_and_some_come_close(name: str) -> None:
    model = real_arm(name)
    beyond = [beyond_reach(model, X_WT) for X_WT in model.tool_poses(any_positions(model, 3000))]
    assert max(beyond) < 1e-9
    assert max(beyond) > -0.02


@pytest.mark.parametrize("seed", range(6))
def test_what_is_proven_is_no_more_than_what_is_missing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = real_arm(("ur5", "panda")[seed % 2])
    direction = rng.normal(size=3)
    place = np.array([0, 0, 0.2]) + rng.uniform(1.0, 1.6) * direction / np.linalg.norm(direction)
    X_WT = pose(rpy_to_matrix(rng.uniform(-3, 3, 3)), place)
    reason = all_solutions(model, X_WT).reason
    assert isinstance(reason, OutOfReach)
    assert beyond_reach(model, X_WT) <= reason.distance + 1e-9


def test_a_pose_that_is_proven_too_far_is_not_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def searched(*_: object) -> Callable[[], None]:
        return pytest.fail("it was searched for")

    monkeypatch.setattr(inverse_kinematics, "_branches", searched)
    reason = all_solutions(real_arm("ur5"), pose(rpy_to_matrix([np.pi, 0, 0]), [1.2, 0.0, 0.1])).reason
    assert isinstance(reason, OutOfReach)
    assert not reason.too_close


def test_nothing_is_proven_of_an_arm_with_a_sliding_joint(tmp_path) -> None:
    urdf = written_urdf(
        tmp_path / "rail.urdf",
        joint("rail", "base", "l1", "prismatic", "0 0 0", "1 0 0"),
        joint("turn", "l1", "tip", "continuous", "0 0 0", "0 0 1"),
    )
    assert beyond_reach(RobotModel.load(robot(urdf, "tip")), pose(position=[99.0, 0, 0])) == -np.inf


def test_an_arm_of_a_single_joint_reaches_as_far_as_its_tool(tmp_path) -> None:
    """Its tool turns about an axis, which the sphere of radius 0 stands for: other places have no bound to fail."""
    urdf = written_urdf(tmp_path / "one.urdf", joint("turn", "base", "tip", "revolute", "0 0 1", "0 0 1"))
    model = RobotModel.load(robot(urdf, "tip"))
    assert beyond_reach(model, model.tool_pose(np.array([0.7]))) == pytest.approx(0.0, abs=1e-9)
    assert beyond_reach(model, pose(position=[0.0, 0.3, 1.4])) == pytest.approx(0.5)


@pytest.mark.filterwarnings("error")
def test_an_arm_whose_axes_all_meet_in_one_point_is_bound_to_it(tmp_path) -> None:
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    chain = [joint(f"j{k}", f"l{k}", f"l{k + 1}", "revolute", "0 0 0", axis) for k, axis in enumerate(axes)]
    model = RobotModel.load(robot(written_urdf(tmp_path / "point.urdf", *chain), "l5"))
    assert beyond_reach(model, pose(position=[0.0, 3.0, 4.0])) == pytest.approx(5.0)
