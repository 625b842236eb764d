"""Inverse kinematics: every branch, by its name, and only true ones; of arms with few axes within the tolerance."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.errors import Infeasible, InputError
from sqrp_cli.geometry import Array, axis_rotation, pose, rpy_to_matrix
from sqrp_cli.motion.tool_path import tool_line
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.robot.branches import WORDS, chosen_branches
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable
from tests.motion.test_tool_curves import straight_line
from tests.task.robots import (
    FEW_AXES,
    LIFTS,
    REAL_ARMS,
    ROBOTS,
    jacobian,
    real_arm,
    robot,
    rounded,
    small_arm,
    spherical_wrist_arm,
    written_urdf,
)


@pytest.fixture
def no_closed_form(monkeypatch):
    """Lets the arms be searched, as those that EAIK cannot decompose."""
    monkeypatch.setattr(inverse_kinematics, "_solver", lambda *_: None)


def angles_between(q: Array, other: Array) -> Array:
    """Largest difference of joint angles, whole turns aside."""
    return np.abs(np.angle(np.exp(1j * (q - other)))).max(axis=-1)


def assert_true(model: RobotModel, X_WT: Array, solutions: Array) -> None:
    for q in solutions:
        np.testing.assert_allclose(model.tool_pose(q), X_WT, atol=1e-9)
        assert (q >= model.lower).all()
        assert (q <= model.upper).all()
    rounded = np.round(solutions, 6).tolist()
    assert rounded == sorted(rounded)
    for k, q in enumerate(solutions):
        assert (angles_between(solutions[k + 1 :], q) > 1e-4).all()


def reachable_poses(model: RobotModel, count: int, seed: int) -> list[tuple[Array, Array]]:
    lower, upper = np.maximum(model.lower, -np.pi), np.minimum(model.upper, np.pi)
    positions = np.random.default_rng(seed).uniform(lower, upper, (count, len(model.arm)))
    return [(q, model.tool_pose(q)) for q in positions]


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "z1"])
def test_solutions_are_true_and_hold_the_one_that_made_the_pose(name):
    model = real_arm(name)
    for q, X_WT in reachable_poses(model, 25, seed=0):
        solutions = all_solutions(model, X_WT)
        assert_true(model, X_WT, solutions)
        assert angles_between(solutions, q).min() < 1e-6


@pytest.mark.parametrize(("name", "count"), [("ur5", 20), ("z1", 20)])
def test_a_search_finds_the_branches_of_the_closed_form(name, count, request):
    model = real_arm(name)
    poses = [X_WT for _, X_WT in reachable_poses(model, count, seed=1)]
    expected = [all_solutions(model, X_WT) for X_WT in poses]
    request.getfixturevalue("no_closed_form")
    for X_WT, solutions in zip(poses, expected, strict=True):
        np.testing.assert_allclose(all_solutions(model, X_WT), solutions, atol=1e-6)


def test_brute_force_finds_no_further_branch():
    model = real_arm("ur5")
    rng = np.random.default_rng(2)
    for _, X_WT in reachable_poses(model, 3, seed=3):
        known = all_solutions(model, X_WT)
        for q in rng.uniform(-np.pi, np.pi, (150, 6)):
            found = plain_newton(model, q, X_WT)
            assert found is None or angles_between(known, found).min() < 1e-6


def plain_newton(model: RobotModel, q: Array, X_WT: Array) -> Array | None:
    """One damped step after the other from one start, orientation errors as half the sum of cross products."""
    for _ in range(60):
        X = model.tool_pose(q)
        turn = 0.5 * sum(np.cross(X[:3, k], X_WT[:3, k]) for k in range(3))
        error = np.concatenate([X_WT[:3, 3] - X[:3, 3], turn])
        if np.abs(X - X_WT).max() < 1e-11:
            return q
        J = jacobian(model, q)
        q = q + np.clip(J.T @ np.linalg.solve(J @ J.T + 1e-3 * (error @ error) * np.eye(6), error), -0.5, 0.5)
    return None


@pytest.mark.usefixtures("no_closed_form")
def test_an_arm_with_a_spherical_wrist_has_its_eight_branches(tmp_path):
    model = RobotModel.load(robot(spherical_wrist_arm(tmp_path, 0.5, 0.4), "tip"))
    X_WT = model.tool_pose(np.array([0.3, 0.6, 0.9, 0.4, 0.8, -0.5]))
    solutions = all_solutions(model, X_WT)
    assert len(solutions) == 8
    assert_true(model, X_WT, solutions)


def test_a_moved_base_changes_no_solution():
    X_WB = pose(rpy_to_matrix([0.4, 0.2, -1.0]), [0.3, 2.0, 1.0])
    urdf, frame = REAL_ARMS["ur5"]
    still, moved = real_arm("ur5"), RobotModel.load(robot(ROBOTS / urdf, frame, X_WB=X_WB))
    for _, X_BT in reachable_poses(still, 5, seed=4):
        expected = all_solutions(still, X_BT)
        np.testing.assert_allclose(all_solutions(moved, X_WB @ X_BT), expected, atol=1e-9)


def test_a_calibrated_arm_is_solved_from_its_nominal_one(tmp_path, request):
    rng = np.random.default_rng(5)
    tree = ET.parse(ROBOTS / REAL_ARMS["ur5"][0])  # noqa: S314
    for origin in tree.iterfind("joint/origin"):
        for key in ("xyz", "rpy"):
            values = np.array(origin.get(key, "0 0 0").split(), dtype=float) + rng.normal(scale=1e-4, size=3)
            origin.set(key, " ".join(f"{value:.17g}" for value in values))
    tree.write(tmp_path / "calibrated.urdf")
    model = RobotModel.load(robot(tmp_path / "calibrated.urdf", "tool0"))
    X_WT = model.tool_pose(np.array([0.3, -1.2, 1.5, -0.8, 1.1, 0.2]))
    assert len(inverse_kinematics.approximate_solutions(model, X_WT)) == 8
    expected = all_solutions(model, X_WT)
    assert_true(model, X_WT, expected)
    assert len(expected) == 8
    request.getfixturevalue("no_closed_form")
    np.testing.assert_allclose(all_solutions(model, X_WT), expected, atol=1e-6)


def test_a_singular_pose_gives_the_points_nearest_home_and_few():
    model = real_arm("ur5")
    X_WT = model.tool_pose(np.array([0.3, -1.0, 1.2, 0.4, 0.0, 0.5]))
    solutions = all_solutions(model, X_WT)
    assert_true(model, X_WT, solutions)
    assert 4 <= len(solutions) <= 12
    singular = solutions[np.abs(solutions[:, 4]) < 1e-6]
    assert len(singular) > 0
    for q in singular:
        tangent = np.linalg.svd(jacobian(model, q))[2][-1]
        assert abs(tangent @ np.angle(np.exp(1j * (model.home - q)))) < 1e-4


def test_limits_take_branches_away_and_whole_turns_bring_them_back():
    urdf, frame = REAL_ARMS["ur5"]
    free = real_arm("ur5")
    X_WT = free.tool_pose(np.array([0.3, -1.2, 1.5, -0.8, 1.1, 0.2]))
    everything = all_solutions(free, X_WT)
    narrow = RobotModel.load(robot(ROBOTS / urdf, frame, limits={"elbow_joint": (0.0, np.pi)}))
    expected = everything[everything[:, 2] >= 0.0]
    np.testing.assert_allclose(all_solutions(narrow, X_WT), expected, atol=1e-9)
    turned = RobotModel.load(robot(ROBOTS / urdf, frame, limits={"shoulder_pan_joint": (np.pi, 3 * np.pi)}))
    solutions = all_solutions(turned, X_WT)
    assert len(solutions) == len(everything)
    assert_true(turned, X_WT, solutions)


@pytest.mark.usefixtures("no_closed_form")
def test_nothing_depends_on_the_global_random_state():
    model = real_arm("panda")
    X_WT = model.tool_pose(np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.8, 0.4]))
    results = []
    for seed in (1, 2):
        np.random.seed(seed)  # noqa: NPY002
        results.append(all_solutions(model, X_WT))
    np.testing.assert_array_equal(*results)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_a_seven_axis_arm_is_solved_at_stated_positions_of_one_joint(name):
    model = real_arm(name)
    (held,) = inverse_kinematics.held_joints(model)
    for _, X_WT in reachable_poses(model, 4, seed=6):
        solutions = all_solutions(model, X_WT)
        assert len(solutions) > 0
        assert_true(model, X_WT, solutions)
        positions = np.unique(np.round(np.mod(solutions[:, held] + np.pi, 2 * np.pi), 6))
        assert len(positions) <= inverse_kinematics.REDUNDANCY_SAMPLES
    other = all_solutions(model, X_WT, seed=1)
    assert_true(model, X_WT, other)
    assert other.shape != solutions.shape or np.abs(other - solutions).max() > 1e-3


def test_arms_with_sliding_joints_are_solved(tmp_path):
    model = small_arm(
        tmp_path, "tip", ("a", "base", "l1", "revolute", "0 0 1", "0 0 1"),
        ("b", "l1", "l2", "revolute", "0.5 0 0", "0 0 1"),
        ("c", "l2", "l3", "prismatic", "0.4 0 0", "0 0 -1", '<limit lower="0" upper="0.5" velocity="1"/>'),
        ("d", "l3", "tip", "continuous", "0 0 0", "0 0 1"),
    )  # fmt: skip
    X_WT = model.tool_pose(np.array([0.4, 1.1, 0.3, -0.7]))
    solutions = all_solutions(model, X_WT)
    assert_true(model, X_WT, solutions)
    expected = [
        [0.4, 1.1, 0.3, -0.7],
        [0.4 + 2 * np.arctan2(0.4 * np.sin(1.1), 0.5 + 0.4 * np.cos(1.1)), -1.1, 0.3, 0.0],
    ]
    expected[1][3] = 0.8 - expected[1][0] + 1.1
    np.testing.assert_allclose(solutions, expected, atol=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("joints", [6, 7, 8])
@pytest.mark.parametrize("seed", range(3))
def test_joints_without_limits_are_solved_without_a_warning(tmp_path, joints, seed):
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0")[:joints]
    chain = [(f"j{k}", f"l{k}", f"l{k + 1}", "continuous", "0.02 0 0.25", axis) for k, axis in enumerate(axes)]
    model = small_arm(tmp_path, f"l{joints}", *chain)
    q = np.random.default_rng(seed).uniform(-2, 2, joints)
    X_WT = model.tool_pose(q)
    found = all_solutions(model, X_WT, seed)
    assert len(found)
    for solution in found:
        np.testing.assert_allclose(model.tool_pose(solution), X_WT, atol=1e-9)
    too_far = all_solutions(model, pose(position=[9.0, 0, 0]), seed)
    assert isinstance(too_far, Unreachable)
    assert too_far.why == "too far"


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_closed_forms_of_a_seven_axis_arm_are_all_that_a_search_finds_at_the_same_positions(name, monkeypatch):
    model = real_arm(name)
    inverse_kinematics.held_joints(model)
    poses = [X_WT for _, X_WT in reachable_poses(model, 4, seed=8)]
    closed = [inverse_kinematics._held_branches(model, X_WT, 0, 4) for X_WT in poses]
    monkeypatch.setattr(inverse_kinematics, "_solver", lambda *_: None)
    for X_WT, solutions in zip(poses, closed, strict=True):
        for q in inverse_kinematics._held_branches(model, X_WT, 0, 4):
            assert angles_between(solutions, q).min() < 1e-6


def test_an_arm_of_which_the_closed_form_takes_parallel_axes_for_crossing_ones_is_searched():
    model = RobotModel.load(robot(ROBOTS / "tiago_description/robots/tiago.urdf", "arm_tool_link"))
    ((_, X_WT),) = reachable_poses(model, 1, seed=0)
    solutions = all_solutions(model, X_WT)
    assert len(solutions)
    assert_true(model, X_WT, solutions)


DOWN = pose(axis_rotation(0, np.pi), (0.35, 0.35, 0.2))


def test_each_name_halves_the_branches_of_a_ur5_and_together_they_leave_one(ur5):
    q = all_solutions(ur5, DOWN)
    assert len(q) == 8
    for name, words in WORDS.items():
        first, second = (chosen_branches(ur5, q, {name: word}) for word in words)
        assert (first != second).all(), name
        assert first.sum() == 4, name
    chosen = [chosen_branches(ur5, q, dict(zip(WORDS, words, strict=True))) for words in product(*WORDS.values())]
    assert np.array_equal(np.sum(chosen, axis=0), np.ones(8))


def test_elbow_and_wrist_of_a_ur5_go_by_the_signs_of_its_joints(ur5):
    """Reaching forward, its elbow is up where joint 3 is positive; the wrist as at home where joint 5 is negative."""
    q = all_solutions(ur5, DOWN)
    forward = chosen_branches(ur5, q, {"shoulder": "left"})
    up = chosen_branches(ur5, q, {"elbow": "up"})
    assert (up[forward] == (q[forward, 2] > 0)).all()
    assert ur5.home[4] < 0
    assert (chosen_branches(ur5, q, {"wrist": "no_flip"}) == (np.sin(q[:, 4]) < 0)).all()


def test_an_elbow_that_is_up_is_higher(ur5):
    q = all_solutions(ur5, DOWN)
    for others in product(*[*WORDS.values()][1:]):
        rows = [chosen_branches(ur5, q, dict(zip(WORDS, (elbow, *others), strict=True))) for elbow in ("up", "down")]
        up, down = (ur5.joint_origins(q[row][0])[2, 2] for row in rows)
        assert up > down + 0.05


def test_a_name_without_meaning_is_refused_and_any_has_one_for_every_arm():
    panda = real_arm("panda")
    assert chosen_branches(panda, panda.home[None], {}).all()
    with pytest.raises(InputError, match="`elbow=up` has no meaning for this arm: it takes an arm with six joints"):
        chosen_branches(panda, panda.home[None], {"elbow": "up"})


TOLERANCE = np.radians(0.5)
BY = 0.0016
"""Half a turn written as 3.14 is wrong by this [rad]."""

READY = {
    "five axes": [0.3, -0.2, 0.6, 1.1, 0.4], "four axes": [0.3, -0.2, 0.6, 1.1], "SCARA": [0.3, 0.8, -0.1, 0.2],
    "gantry": [0.1, 0.2, 0.5],
}  # fmt: skip


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
    assert isinstance(exact, Unreachable)
    model = arm(name, tmp_path, BY, TOLERANCE)
    found = all_solutions(model, X_WT)
    assert np.abs(found - READY[name]).max(axis=1).min() < 0.05
    for q in found:
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
    q0 = min(all_solutions(model, start), key=lambda q: float(np.abs(q - READY[name]).max()))
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
    assert isinstance(found, Unreachable)
    assert found.why == "wrong way round"
    assert "0.80 deg at best" in str(found)


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
    assert len(found)
    line = tool_line(X_WT, pose(position=(0.0, 0.0, -0.1)) @ X_WT)
    for q in found:
        assert (model.lower <= q).all()
        assert (q <= model.upper).all()
        np.testing.assert_allclose(model.tool_pose(q)[:3, 3], X_WT[:3, 3], atol=1e-9)
        assert angle_between(model.tool_pose(q), X_WT) < TOLERANCE
        if name == "the arm as one joint":
            assert angle_between(model.tool_pose(q), X_WT) == pytest.approx(0.5 * np.pi - 1.57, abs=1e-6)
    assert any(not isinstance(straight_line(model, q, line), Infeasible) for q in found)
    exact = all_solutions(RobotModel.load(robot(urdf, "tip")), X_WT)
    assert str(exact) == "joint `pitch` 0.0456 deg past its limit"
