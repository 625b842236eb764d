"""Laws of the robot model, against hand-rolled products and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import Array, inverse, pose, rpy_to_matrix
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.urdf import UrdfModel
from tests.task.robots import REAL_ARMS, ROBOTS, SUCTION_CUP, joint, mounted, real_arm, robot, written_urdf

X_WB = pose(rpy_to_matrix([0.3, -0.5, 1.2]), [1.0, -2.0, 0.5])
X_LT = pose(rpy_to_matrix([0.1, 0.2, 0.3]), [0.01, 0.02, 0.03])


def rotation(axis: Array, angle: float) -> Array:
    """By the power series of the matrix exponential."""
    x, y, z = axis
    K = angle * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    total = term = np.eye(3)
    for k in range(1, 40):
        term = term @ K / k
        total = total + term
    return total


def hand_rolled_pose(urdf: UrdfModel, values: dict[str, float], link: str) -> Array:
    """Pose of a link in the root, one joint after the other."""
    carriers = {joint.child: joint for joint in urdf.joints.values()}
    X = np.eye(4)
    while link in carriers:
        joint = carriers[link]
        value = values.get(joint.name, 0.0)
        motion = pose(position=value * joint.axis) if joint.type == "prismatic" else pose(rotation(joint.axis, value))
        X, link = joint.X_PJ @ motion @ X, joint.parent
    return X


@pytest.mark.parametrize("name", REAL_ARMS)
def test_link_poses_are_the_product_along_the_chain(name):
    model, urdf = real_arm(name), read_urdf(ROBOTS / REAL_ARMS[name][0])
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (3, len(model.arm)))
    X_WL = model.link_poses(q)
    assert set(X_WL) == set(urdf.links) == set(model.links)
    for row in range(3):
        values = model.joint_values(q[row])
        for link in urdf.links:
            np.testing.assert_allclose(X_WL[link][row], hand_rolled_pose(urdf, values, link), atol=1e-12)


@pytest.mark.parametrize("name", REAL_ARMS)
def test_the_tool_stands_where_its_link_does(name):
    model = real_arm(name)
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (5, len(model.arm)))
    np.testing.assert_allclose(model.tool_poses(q), model.link_poses(q)[model.tool_frame], atol=1e-12)


def finite_differences(model: RobotModel, q: Array, h: float = 1e-6) -> Array:
    columns = []
    for step in h * np.eye(len(q)):
        before, after = model.tool_pose(q - step), model.tool_pose(q + step)
        turn = (after[:3, :3] - before[:3, :3]) @ model.tool_pose(q)[:3, :3].T
        columns.append([*(after - before)[:3, 3], turn[2, 1], turn[0, 2], turn[1, 0]])
    return np.array(columns).T / (2 * h)


@pytest.mark.parametrize("name", REAL_ARMS)
def test_the_jacobian_is_the_derivative_of_the_tool_pose(name):
    model = real_arm(name)
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (3, len(model.arm))):
        np.testing.assert_allclose(model.jacobian(q), finite_differences(model, q), atol=1e-8)


def test_moving_the_base_moves_every_link_rigidly():
    urdf, frame = REAL_ARMS["ur5"]
    still, moved = real_arm("ur5"), RobotModel.load(robot(ROBOTS / urdf, frame, X_WB=X_WB))
    q = np.random.default_rng(4).uniform(-2.0, 2.0, (4, 6))
    for link, X_WL in moved.link_poses(q).items():
        np.testing.assert_allclose(X_WL, X_WB @ still.link_poses(q)[link], atol=1e-12)
    np.testing.assert_allclose(moved.tool_pose(q[0]), X_WB @ still.tool_pose(q[0]), atol=1e-12)
    R = X_WB[:3, :3]
    np.testing.assert_allclose(moved.jacobian(q[0])[:3], R @ still.jacobian(q[0])[:3], atol=1e-12)


def test_a_tool_moves_with_the_link_that_carries_it():
    urdf, frame = REAL_ARMS["ur5"]
    plain, tooled = (
        real_arm("ur5"),
        RobotModel.load(robot(ROBOTS / urdf, "suction_tip", mounted(SUCTION_CUP, frame, X_LT))),
    )
    q = np.random.default_rng(5).uniform(-2.0, 2.0, 6)
    along_z = pose(position=[0.0, 0.0, 0.02 + 0.06 + 0.02])
    np.testing.assert_allclose(tooled.tool_pose(q), plain.tool_pose(q) @ X_LT @ along_z, atol=1e-12)
    assert tooled.tool_links == {"suction_mount", "suction_tube", "suction_cup", "suction_tip"}
    assert tooled.arm == plain.arm
    assert {part.parent for part in tooled.parts} - {part.parent for part in plain.parts} == tooled.tool_links - {
        "suction_tip"
    }
    np.testing.assert_allclose(tooled.jacobian(q), finite_differences(tooled, q), atol=1e-8)


def test_neighbours_and_rigidly_connected_links_are_adjacent():
    urdf, frame = REAL_ARMS["ur5"]
    pairs = RobotModel.load(robot(ROBOTS / urdf, "suction_tip", mounted(SUCTION_CUP, frame, np.eye(4)))).adjacent_pairs
    assert {
        ("forearm_link", "upper_arm_link"),
        ("suction_cup", "suction_tube"),
        ("suction_cup", "wrist_3_link"),
    } <= pairs
    assert ("suction_cup", "wrist_2_link") in pairs
    assert not {("forearm_link", "shoulder_link"), ("suction_cup", "wrist_1_link")} & pairs
    assert all(first < second for first, second in pairs)


def gantry(folder):
    """A rail along y that lifts a turning arm; its two fingers follow each other, and one joint follows the rail."""
    return written_urdf(
        folder / "gantry.urdf",
        joint("rail", "base", "cart", "prismatic", "0 0 1", "0 1 0"),
        joint(
            "geared", "cart", "wheel", "revolute", "0 0 0", "0 0 1", '<mimic joint="rail" multiplier="2" offset="0.5"/>'
        ),
        joint("turn", "wheel", "arm", "continuous", "0 0 0.3", "0 0 1"),
        joint("mount", "arm", "hand", "fixed", "1 0 0", "0 0 1"),
        joint(
            "finger", "hand", "left", "prismatic", "0 0.1 0", "0 1 0", '<limit lower="0.02" upper="1" velocity="1"/>'
        ),
        joint("other", "hand", "right", "prismatic", "0 -0.1 0", "0 1 0", '<mimic joint="finger" multiplier="-1"/>'),
    )


def test_sliding_following_and_resting_joints_move_as_the_urdf_says(tmp_path):
    model = RobotModel.load(robot(gantry(tmp_path), "hand"))
    assert (model.arm, model.turns.tolist(), model.joints_move_alone) == (("rail", "turn"), [False, True], False)
    assert np.isinf(model.upper[1])
    q = np.array([0.4, 0.7])
    values = {"rail": 0.4, "geared": 1.3, "turn": 0.7, "finger": 0.02, "other": -0.02}
    assert model.joint_values(q) == pytest.approx(values)
    angle = 1.3 + 0.7
    expected = pose(rpy_to_matrix([0, 0, angle]), [np.cos(angle), 0.4 + np.sin(angle), 1.3])
    np.testing.assert_allclose(model.tool_pose(q), expected, atol=1e-12)
    np.testing.assert_allclose(model.jacobian(q), finite_differences(model, q), atol=1e-8)
    poses = model.link_poses(q[None])
    np.testing.assert_allclose(inverse(poses["hand"][0]) @ poses["right"][0], pose(position=[0, -0.12, 0]), atol=1e-12)
    urdf = read_urdf(tmp_path / "gantry.urdf")
    for link, X_WL in poses.items():
        np.testing.assert_allclose(X_WL[0], hand_rolled_pose(urdf, values, link), atol=1e-12)


def test_joints_off_the_arm_rest_at_home(tmp_path):
    home = {"finger": 0.5, "turn": 0.1}
    model = RobotModel.load(robot(gantry(tmp_path), "hand", home=home))
    np.testing.assert_array_equal(model.home, [0.0, 0.1])
    values = model.joint_values(model.home)
    assert (values["finger"], values["other"]) == (0.5, -0.5)


def test_an_arm_needs_a_joint_that_moves_its_tool_and_limits_of_each():
    urdf, frame = REAL_ARMS["ur5"]
    fitting = robot(ROBOTS / urdf, frame)
    with pytest.raises(InputError, match="no joint moves the tool frame `base_link`"):
        RobotModel.load(replace(fitting, tool_frame="base_link"))
    limits = {name: limit for name, limit in fitting.limits.items() if name != "elbow_joint"}
    with pytest.raises(InputError, match="no limits are given for joint `elbow_joint`"):
        RobotModel.load(replace(fitting, limits=limits))


def test_the_jacobian_of_an_arm_of_one_joint_has_one_column(tmp_path):
    urdf = written_urdf(
        tmp_path / "one.urdf",
        joint("a", "base", "l1", "revolute", "0 0 0", "0 0 1"),
        joint("b", "l1", "tip", "fixed", "2 0 0", "0 0 1"),
    )
    model = RobotModel.load(robot(urdf, "tip"))
    np.testing.assert_allclose(model.jacobian(np.zeros(1)), [[0], [2], [0], [0], [0], [1]], atol=1e-12)
