"""Why a pose cannot be reached, with figures that geometry gives independently."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sqrp_cli.geometry import Array, axis_rotation, pose, rpy_to_matrix
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable, beyond_reach
from tests.task.robots import FEW_AXES, REAL_ARMS, ROBOTS, real_arm, robot, small_arm, spherical_wrist_arm, written_urdf

UPPER, FORE, SHOULDER = 0.5, 0.3, np.array([0.0, 0.0, 0.5])
SLIDE, TURN = (
    ("slide", "base", "l1", "prismatic", "0 0 0", "1 0 0"),
    ("turn", "l1", "tip", "continuous", "0 0 0", "0 0 1"),
)


@pytest.fixture
def spherical(tmp_path) -> RobotModel:
    return RobotModel.load(robot(spherical_wrist_arm(tmp_path, UPPER, FORE), "tip"))


def with_wrist_at(distance: float, seed: int) -> Array:
    """A pose of the tool with the wrist at a distance [m] from the shoulder, in random directions."""
    rng = np.random.default_rng(seed)
    R = rpy_to_matrix(rng.uniform(-3, 3, 3))
    direction = rng.normal(size=3)
    return pose(R, SHOULDER + distance * direction / np.linalg.norm(direction) + 0.1 * R[:, 2])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("distance", "missing", "said"), [
        (UPPER + FORE + 0.005, 0.005, "out of reach by 5 mm"), (UPPER + FORE + 0.21, 0.21, "out of reach by 0.21 m"),
        (UPPER + FORE + 1.7, 1.7, "out of reach by 1.70 m"), (UPPER - FORE - 0.02, 0.02, "too close by 0.02 m"),
        (UPPER - FORE - 0.15, 0.15, "too close by 0.15 m"),
])  # fmt: skip
def test_too_far_or_too_close_by_what_the_stretched_or_folded_arm_lacks(spherical, seed, distance, missing, said):
    reason = all_solutions(spherical, with_wrist_at(distance, seed))
    assert reason.missing == pytest.approx(missing, abs=1e-4)
    assert str(reason) == said


@pytest.mark.parametrize("turn", [-40.0, 25.0])
def test_an_arm_of_four_axes_says_by_which_turn_a_place_is_within_reach(turn: float, tmp_path) -> None:
    """Where it stands is within reach; turned about the vertical it is not, until it is turned back."""
    model = RobotModel.load(robot(written_urdf(tmp_path / "four.urdf", *FEW_AXES["four axes"]), "tool0"))
    there = model.tool_pose(np.array([0.3, -0.2, 0.6, 1.1]))
    turned = pose(axis_rotation(2, np.radians(turn)) @ there[:3, :3], there[:3, 3])
    reason = all_solutions(model, turned)
    assert isinstance(reason, Unreachable)
    assert reason.why == "turned"
    assert np.degrees(reason.missing) == pytest.approx(-turn, abs=0.3)
    assert "only when turned by" in str(reason)


@pytest.mark.parametrize("away", [0.0, 0.05])
def test_a_ur5_cannot_bring_its_wrist_closer_to_its_axis_than_its_offset(away):
    """Joints 2 to 4 are parallel and 0.10915 m from the first axis where the wrist is, whatever they do."""
    X_WT = pose(rpy_to_matrix([np.pi, 0, 0]), [away, 0.0, 0.3])
    reason = all_solutions(real_arm("ur5"), X_WT)
    assert reason.why == "too close"
    assert reason.missing == pytest.approx(0.10915 - away, abs=1e-4)


@pytest.mark.parametrize("place", [(0.9, 0.1, 0.3), (-0.5, 0.9, 0.6), (0.2, -0.3, 1.6)])
def test_the_distance_of_a_ur5_is_the_least_that_makes_it_reachable(place):
    model = real_arm("ur5")
    X_WT = pose(rpy_to_matrix([np.pi, 0.2, 0.3]), place)
    reason = all_solutions(model, X_WT)
    assert reason.why == "too far"
    assert reason.missing == pytest.approx(least_distance_of_a_ur5(X_WT), abs=2e-3)


def least_distance_of_a_ur5(X_WT: Array) -> float:
    """How far a pose is from the nearest one of the same orientation that a UR5 reaches, from its dimensions.

    At a given first joint, the orientation fixes up to a sign how the fifth axis lies, and so where joint 4 must be:
    in the plane of upper arm and forearm, d4 beside the first axis, and no further from the shoulder than they stretch.
    """
    distances = []
    a2, a3, d1, d4, d5, d6 = 0.425, 0.39225, 0.089159, 0.10915, 0.09465, 0.0823
    R = X_WT[:3, :3]
    approach = R[:, 2]
    for q1 in np.linspace(-np.pi, np.pi, 1441):
        radial, side = np.array([np.cos(q1), np.sin(q1), 0]), np.array([-np.sin(q1), np.cos(q1), 0])
        bend = approach @ side
        in_plane = approach - bend * side
        if np.linalg.norm(in_plane) < 1e-6:
            continue
        fifth = np.cross(side, in_plane / np.linalg.norm(in_plane))
        for sign in (1.0, -1.0):
            wrist = X_WT[:3, 3] - d6 * approach - sign * d5 * fifth
            offset = wrist - np.array([0, 0, d1])
            across = offset @ side - d4
            planar = np.hypot(offset @ radial, offset[2])
            distances.append(float(np.hypot(across, max(planar - a2 - a3, 0.0))))
    return min(distances)


def test_the_limit_in_the_way_is_named_with_its_excess():
    urdf, frame = REAL_ARMS["ur5"]
    q = np.array([0.3, -1.2, 1.5, -0.8, 1.1, 0.2])
    free = real_arm("ur5")
    X_WT = free.tool_pose(q)
    elbows = np.abs(all_solutions(free, X_WT)[:, 2])
    limit = float(elbows.min() - np.radians(12.0))
    limits = {"elbow_joint": (-limit, limit)}
    reason = all_solutions(RobotModel.load(robot(ROBOTS / urdf, frame, limits=limits)), X_WT)
    assert reason == Unreachable("past limit", pytest.approx(np.radians(12.0), abs=1e-9), "elbow_joint")
    assert str(reason) == "joint `elbow_joint` 12 deg past its limit"


def test_a_sliding_joint_past_its_limit_is_reported_in_metres(tmp_path):
    lift = ("lift", "base", "l1", "prismatic", "0 0 0", "0 0 1", '<limit lower="0" upper="0.5" velocity="1"/>')
    reason = all_solutions(small_arm(tmp_path, "tip", lift, TURN), pose(position=[0.0, 0.0, 0.75]))
    assert str(reason) == "joint `lift` 0.25 m past its limit"


def test_an_orientation_that_the_arm_cannot_take_is_reported_as_such(tmp_path):
    tilted = pose(rpy_to_matrix([0.5, 0.0, 0.0]), [1.0, 0.0, 0.0])
    reason = all_solutions(small_arm(tmp_path, "tip", SLIDE, TURN), tilted)
    assert reason.why == "wrong way round"
    assert reason.missing == pytest.approx(0.5, abs=1e-3)
    assert "29 deg at best" in str(reason)


def any_positions(model: RobotModel, count: int) -> Array:
    """Joint positions within the limits, and as many stretched out by turning single joints of them to zero."""
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(model.lower, -np.pi), np.minimum(model.upper, np.pi), (count, len(model.arm)))
    stretched = q * (rng.random(q.shape) < 0.5)
    return np.concatenate([q, np.clip(stretched, model.lower, model.upper)])


@pytest.mark.parametrize("name", REAL_ARMS)
def test_no_pose_that_an_arm_takes_is_beyond_its_reach_and_some_come_close(name):
    model = real_arm(name)
    beyond = [beyond_reach(model, X_WT) for X_WT in model.tool_poses(any_positions(model, 3000))]
    assert max(beyond) < 1e-9
    assert max(beyond) > -0.02


@pytest.mark.parametrize("seed", range(6))
def test_what_is_proven_is_no_more_than_what_is_missing(seed):
    rng = np.random.default_rng(seed)
    model = real_arm(("ur5", "panda")[seed % 2])
    direction = rng.normal(size=3)
    place = np.array([0, 0, 0.2]) + rng.uniform(1.0, 1.6) * direction / np.linalg.norm(direction)
    X_WT = pose(rpy_to_matrix(rng.uniform(-3, 3, 3)), place)
    reason = all_solutions(model, X_WT)
    assert reason.why == "too far"
    assert beyond_reach(model, X_WT) <= reason.missing + 1e-9


def test_a_pose_that_is_proven_too_far_is_not_searched_for(monkeypatch):
    def searched(*_: object) -> Callable[[], None]:
        return pytest.fail("it was searched for")

    monkeypatch.setattr(inverse_kinematics, "_branches", searched)
    reason = all_solutions(real_arm("ur5"), pose(rpy_to_matrix([np.pi, 0, 0]), [1.2, 0.0, 0.1]))
    assert reason.why == "too far"


def test_nothing_is_proven_of_an_arm_with_a_sliding_joint(tmp_path):
    assert beyond_reach(small_arm(tmp_path, "tip", SLIDE, TURN), pose(position=[99.0, 0, 0])) == -np.inf


def test_an_arm_of_a_single_joint_reaches_as_far_as_its_tool(tmp_path):
    """Its tool turns about an axis, which the sphere of radius 0 stands for: other places have no bound to fail."""
    model = small_arm(tmp_path, "tip", ("turn", "base", "tip", "revolute", "0 0 1", "0 0 1"))
    assert beyond_reach(model, model.tool_pose(np.array([0.7]))) == pytest.approx(0.0, abs=1e-9)
    assert beyond_reach(model, pose(position=[0.0, 0.3, 1.4])) == pytest.approx(0.5)


@pytest.mark.filterwarnings("error")
def test_an_arm_whose_axes_all_meet_in_one_point_is_bound_to_it(tmp_path):
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    chain = [(f"j{k}", f"l{k}", f"l{k + 1}", "revolute", "0 0 0", axis) for k, axis in enumerate(axes)]
    model = small_arm(tmp_path, "l5", *chain)
    assert beyond_reach(model, pose(position=[0.0, 3.0, 4.0])) == pytest.approx(5.0)
