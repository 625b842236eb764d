"""No motion leaves the limits of position, velocity, acceleration and jerk at any instant, whatever the arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, pose
from sqrp_cli.motion import plan_motion
from sqrp_cli.motion.plan_motion import MEASURED, Motion
from sqrp_cli.motion.position_limits import LIMIT_SLACK, past_limits
from sqrp_cli.motion.stop_and_return import recovery_over
from sqrp_cli.motion.tool_path import ToolCurve, follow, tool_line
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.trajectory import JointPath
from tests.motion.cells import Cell, assert_keeps_limits, thing
from tests.motion.test_tool_curves import straight_line
from tests.task.robots import robot, small_arm, torso_arm

BENT = (0.3, 0.5, 0.2, -1.4, 0.1, -0.9, 0.3)
"""The seven joints beyond the torso, far from their limits."""

TABLE = thing("table", (3.0, 3.0, 0.04), pose(position=(0, 0, -0.02)))


def model_of(folder: FilePath, joints: int = 8) -> RobotModel:
    return RobotModel.load(robot(torso_arm(folder, joints), "tip"))


def down(model: RobotModel, q: Array, length: float) -> ToolCurve:
    X = model.tool_pose(q)
    return tool_line(X, pose(X[:3, :3], X[:3, 3] - [0, 0, length]))


@given(arrays(float, (2, 7, 3), elements=st.floats(-2, 2)))
def test_the_extremes_of_a_path_are_those_of_all_its_positions(coefficients):
    path = JointPath(np.array([0.0, 0.3, 1.0]), coefficients)
    # At the break, the earlier piece has its end just before.
    q = path.positions(np.unique([*np.linspace(0, 1, 4001), np.nextafter(0.3, 0)]))
    low, high = path.range_bounds()
    for column in range(3):
        least, greatest = path.extremes(column)
        assert low[column] - 1e-12 <= least <= greatest <= high[column] + 1e-12
        assert least - 1e-9 <= q[:, column].min() <= least + 1e-3
        assert greatest - 1e-3 <= q[:, column].max() <= greatest + 1e-9


def test_an_arm_with_a_torso_holds_it_still_where_it_would_leave_its_limit(tmp_path):
    """As the arm moves least, the torso takes its share of the way down, past its lower limit."""
    model = model_of(tmp_path)
    q0 = np.array([0.005, *BENT])
    line = down(model, q0, 0.1)
    (free,) = follow(model, q0[None], line)
    assert past_limits(free, model.lower, model.upper)[0] > 0.01
    path = straight_line(model, q0, line)
    s = np.linspace(0, 1, 501)
    q = path.positions(s)
    assert ((q >= model.lower - 2 * LIMIT_SLACK) & (q <= model.upper + 2 * LIMIT_SLACK)).all()
    np.testing.assert_allclose(model.tool_poses(q), line.poses(s), atol=2e-6)


def test_a_line_past_the_limit_of_a_sliding_joint_says_which_and_how_far(tmp_path):
    rail = '<limit lower="0" upper="0.5" velocity="1" effort="1"/>'
    model = small_arm(
        tmp_path, "tip", ("rail", "base", "l1", "prismatic", "0 0 0", "1 0 0", rail),
        ("lift", "l1", "l2", "prismatic", "0 0 0", "0 0 1"), ("turn", "l2", "tip", "continuous", "0 0 0", "0 0 1"),
    )  # fmt: skip
    q0 = np.array([0.4, 0.2, 0.0])
    X = model.tool_pose(q0)
    result = straight_line(model, q0, tool_line(X, pose(X[:3, :3], X[:3, 3] + [0.119, 0, 0])))
    assert result.reasons[0].startswith("joint `rail` 0.019 m past its limit, which it reaches after 10")


def random_cell(tabletop: Workspace, folder: FilePath, seed: int, joints: int) -> Cell:
    """A torso arm with its torso near a limit at home, over a table with a cube somewhere."""
    rng = np.random.default_rng(seed)
    urdf = torso_arm(folder, joints)
    torso = float(rng.choice([0.0, 0.01, 0.05, 0.2, 0.35]))
    position = rng.uniform([-0.2, -0.2], [0.2, 0.2])
    bent = [float(rng.uniform(-0.3, 0.3)) for _ in range(joints - 8)]
    angles = [float(np.arctan2(position[1], 0.45 + position[0])), *bent, 0.3, 0.0, 1.2, 0.0, 1.4, 0.0]
    home = dict(zip((f"j{k}" for k in range(joints)), [torso, *angles], strict=True))
    arm = robot(urdf, "tip", home=home)
    cube = thing("cube", (0.04, 0.04, 0.04), pose(position=(0.45 + position[0], position[1], 0.02)), fixed=False)
    return Cell(arm, RobotModel.load(arm), tabletop.skills["pickup"], (TABLE, cube))


@pytest.mark.parametrize("joints", [8, 9])
@pytest.mark.parametrize("seed", range(6))
def test_every_instant_of_every_motion_of_an_arm_of_many_joints_keeps_all_limits(tabletop, tmp_path, seed, joints):
    cell = random_cell(tabletop, tmp_path, seed, joints)
    model, motion = cell.model, cell.plan(lift=0.15)
    assert isinstance(motion, Motion), motion
    assert_keeps_limits(model, motion, 2e-3)
    assert np.isfinite(recovery_over(motion, model, 0.0)[1]).all()


def test_a_motion_past_a_limit_is_infeasible_wherever_it_comes_from(tabletop, tmp_path, monkeypatch):
    """The last check looks at the motion itself: here one with a detour that something upstream got wrong."""
    cell = random_cell(tabletop, tmp_path, 0, 8)
    made = plan_motion.with_fingers

    def off(model: RobotModel, arm: plan_motion.Trajectory, *rest: object) -> plan_motion.Trajectory:
        trajectory = made(model, arm, *rest)  # type: ignore[arg-type]
        shift = np.zeros(len(model.joints))
        shift[0] = model.lower[0] - trajectory.path.extremes(0)[0] - 0.019
        return replace(trajectory, path=trajectory.path.shifted(shift))

    monkeypatch.setattr(plan_motion, "with_fingers", off)
    result = cell.plan()
    assert result == Infeasible(("a1: joint `j0` 0.019 m past its limit",))


def test_a_motion_begins_at_the_limit_where_a_joint_is_measured_to_be_just_past_it(tabletop, tmp_path):
    cell = random_cell(tabletop, tmp_path, 0, 8)
    measured = replace(cell.world, joints={**cell.world.joints, "j0": -0.5 * MEASURED})
    motion = cell.plan(world=measured)
    assert motion.positions(0, np.zeros(1))[0, 0] == 0.0
    far = cell.plan(world=replace(cell.world, joints={**cell.world.joints, "j0": -0.03}))
    assert far == Infeasible(("joint `j0` 0.03 m past its limit before anything moves",))
