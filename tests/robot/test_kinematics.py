"""Links stand and move as Pinocchio says: for robots of any shape, and real ones; and laws of the robot model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Place
from sqrp_cli.geometry import Array, inverse, pose, rpy_to_matrix
from sqrp_cli.robot.kinematics import JointTree, RobotModel
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot import Robot, Tool
from sqrp_cli.robot.urdf import JointType, Mimic, UrdfJoint, UrdfLink, UrdfModel
from tests.task.robots import (
    REAL_ARMS,
    ROBOTS,
    SUCTION_CUP,
    jacobian,
    joint,
    mounted,
    real_arm,
    robot,
    written_urdf,
)

X_LT = pose(rpy_to_matrix([0.1, 0.2, 0.3]), [0.01, 0.02, 0.03])

PLACE = Place(Path("random.urdf"))
KINDS: tuple[JointType, ...] = ("fixed", "revolute", "continuous", "prismatic")


def placed(rng: np.random.Generator) -> Array:
    return pose(rpy_to_matrix(rng.uniform(-4, 4, 3)), rng.uniform(-2, 2, 3))


def random_urdf(rng: np.random.Generator, prefix: str, count: int) -> UrdfModel:
    """A tree of links in which every joint is anywhere on any link before it."""
    names = [f"{prefix}{index}" for index in range(count + 1)]
    joints: dict[str, UrdfJoint] = {}
    for index in range(count):
        leaders = [joint.name for joint in joints.values() if joint.movable and joint.mimic is None]
        kind, name, axis = KINDS[rng.integers(4)], f"{prefix}j{index}", rng.normal(size=3)
        follows = kind != "fixed" and leaders and rng.random() < 0.3
        joints[name] = UrdfJoint(
            name=name, type=kind, parent=names[rng.integers(index + 1)], child=names[index + 1], X_PJ=placed(rng),
            axis=axis / np.linalg.norm(axis), lower=-3.0, upper=3.0, place=PLACE,
            mimic=Mimic(leaders[rng.integers(len(leaders))], *rng.uniform(-2, 2, 2)) if follows else None,
        )  # fmt: skip
    links = {name: UrdfLink(name, (), (), None, PLACE) for name in names}
    return UrdfModel("random", PLACE.file, links, joints, names[0])


def random_robot(rng: np.random.Generator) -> Robot:
    """A robot with a tool on any of its links."""
    plain = robot(ROBOTS / REAL_ARMS["ur5"][0], REAL_ARMS["ur5"][1])
    urdf, tool = random_urdf(rng, "r", int(rng.integers(1, 9))), random_urdf(rng, "t", int(rng.integers(4)))
    mounted = Tool(tool, list(urdf.links)[rng.integers(len(urdf.links))], placed(rng), None)
    return replace(plain, urdf=urdf, tool=mounted, X_WB=placed(rng), parts=())


def in_pinocchio(robot: Robot) -> tuple[pin.Model, dict[str, int]]:
    """Robot and tool joint by joint, and the number of each link's frame."""
    model, frames = pin.Model(), dict[str, int]()
    tool = robot.tool
    trees = [(robot.urdf, (0, robot.X_WB)), *([(tool.urdf, None)] if tool else [])]
    seats: dict[str, tuple[int, Array]] = {}
    for urdf, root in trees:
        seats[urdf.root] = root or (seats[tool.link][0], seats[tool.link][1] @ tool.X_LT)
        for one in urdf.joints.values():
            carrier, X_JL = seats[one.parent][0], seats[one.parent][1] @ one.X_PJ
            if one.movable:
                slides = one.type == "prismatic"
                kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
                carrier, X_JL = model.addJoint(carrier, kind(one.axis), pin.SE3(X_JL), one.name), np.eye(4)
            seats[one.child] = carrier, X_JL
    for link, (carrier, X_JL) in seats.items():
        frames[link] = model.addFrame(pin.Frame(link, carrier, pin.SE3(X_JL), pin.FrameType.BODY))
    return model, frames


def assert_equal_at(robot: Robot, seed: int) -> None:
    """Poses of all links, and how they move, by the matrices of the tree and by Pinocchio."""
    tree, (model, frames) = JointTree.of(robot), in_pinocchio(robot)
    data = model.createData()
    positions = np.random.default_rng(seed).uniform(-7, 7, (2, len(tree.joints)))
    X_WJ = tree.poses(positions)
    axes = (X_WJ[:, :, :3, :3] @ tree.axes[:, :, None])[..., 0]
    for link, (carrier, X_JL) in tree.mounts.items():
        chain = tree.chain(link)
        for row, q in enumerate(positions):
            X_WL = X_JL if carrier < 0 else X_WJ[row, carrier] @ X_JL
            J = pin.computeFrameJacobian(model, data, q, frames[link], pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)
            pin.framesForwardKinematics(model, data, q)
            np.testing.assert_allclose(data.oMf[frames[link]].homogeneous, X_WL, atol=1e-11)
            turning = tree.turns[chain, None]
            moved = np.cross(axes[row, chain], X_WL[:3, 3] - X_WJ[row, chain, :3, 3])
            linear, angular = np.where(turning, moved, axes[row, chain]), np.where(turning, axes[row, chain], 0.0)
            expected = np.concatenate([linear, angular], axis=1).T
            np.testing.assert_allclose(J[:, chain], expected, atol=1e-11)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_random_robots_stand_where_pinocchio_says(seed):
    assert_equal_at(random_robot(np.random.default_rng(seed)), seed)


def test_every_installed_robot_stands_where_pinocchio_reads_it():
    plain = robot(ROBOTS / REAL_ARMS["ur5"][0], REAL_ARMS["ur5"][1])
    rng, count = np.random.default_rng(0), 0
    for path in sorted(ROBOTS.rglob("*.urdf")):
        try:
            urdf = read_urdf(path)
        except InputError:
            continue
        tree, theirs = JointTree.of(replace(plain, urdf=urdf)), pin.buildModelFromUrdf(str(path))
        data = theirs.createData()
        positions = rng.uniform(-3, 3, (1, len(tree.joints)))
        q = pin.neutral(theirs)
        for moved, value in zip(tree.joints, positions[0], strict=True):
            read = theirs.joints[theirs.getJointId(moved.name)]
            q[read.idx_q : read.idx_q + read.nq] = [value] if read.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(theirs, data, q)
        X_WJ = tree.poses(positions)[0]
        for link, (carrier, X_JL) in tree.mounts.items():
            X_WL = X_JL if carrier < 0 else X_WJ[carrier] @ X_JL
            frame = theirs.getFrameId(link.removeprefix("robot/"), pin.FrameType.BODY)
            np.testing.assert_allclose(X_WL, data.oMf[frame].homogeneous, atol=1e-9, err_msg=f"{path.name} {link}")
        count += 1
    assert count >= 60


def assert_links_at(model: RobotModel, described: Robot, q: Array) -> None:
    """Every link of the model at arm positions (m, n), its followers and resting joints as it says, by Pinocchio."""
    theirs, frames = in_pinocchio(described)
    data, X_WL = theirs.createData(), model.link_poses(q)
    assert set(X_WL) == set(described.urdf.links) == set(model.links)
    np.testing.assert_allclose(model.tool_poses(q), X_WL[model.tool_frame], atol=1e-12)
    for row in range(len(q)):
        values = model.joint_values(q[row])
        pin.framesForwardKinematics(theirs, data, np.array([values[name] for name in [*theirs.names][1:]]))
        for link, frame in frames.items():
            np.testing.assert_allclose(X_WL[link][row], data.oMf[frame].homogeneous, atol=1e-11)


@pytest.mark.parametrize("name", REAL_ARMS)
def test_real_arms_stand_where_pinocchio_says(name):
    described, model = robot(ROBOTS / REAL_ARMS[name][0], REAL_ARMS[name][1]), real_arm(name)
    assert_equal_at(described, 0)
    assert_links_at(model, described, np.random.default_rng(0).uniform(-2.0, 2.0, (3, len(model.arm))))


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
        np.testing.assert_allclose(jacobian(model, q), finite_differences(model, q), atol=1e-8)


def test_a_tool_moves_with_the_link_that_carries_it():
    urdf, frame = REAL_ARMS["ur5"]
    tooled = RobotModel.load(robot(ROBOTS / urdf, "suction_tip", mounted(SUCTION_CUP, frame, X_LT)))
    plain = real_arm("ur5")
    q = np.random.default_rng(5).uniform(-2.0, 2.0, 6)
    along_z = pose(position=[0.0, 0.0, 0.02 + 0.06 + 0.02])
    np.testing.assert_allclose(tooled.tool_pose(q), plain.tool_pose(q) @ X_LT @ along_z, atol=1e-12)
    assert tooled.tool_links == {"suction_mount", "suction_tube", "suction_cup", "suction_tip"}
    solid = {one.parent for one in tooled.parts} - {one.parent for one in plain.parts}
    assert (tooled.arm, solid) == (plain.arm, tooled.tool_links - {"suction_tip"})
    np.testing.assert_allclose(jacobian(tooled, q), finite_differences(tooled, q), atol=1e-8)


def test_neighbours_and_rigidly_connected_links_are_adjacent():
    urdf, frame = REAL_ARMS["ur5"]
    pairs = RobotModel.load(robot(ROBOTS / urdf, "suction_tip", mounted(SUCTION_CUP, frame, np.eye(4)))).adjacent_pairs
    near = {("suction_cup", one) for one in ("suction_tube", "wrist_3_link", "wrist_2_link")}
    assert {("forearm_link", "upper_arm_link"), *near} <= pairs
    assert not {("forearm_link", "shoulder_link"), ("suction_cup", "wrist_1_link")} & pairs
    assert all(first < second for first, second in pairs)


def gantry(folder):
    """A rail along y that lifts a turning arm; its two fingers follow each other, and one joint follows the rail."""
    return written_urdf(
        folder / "gantry.urdf",
        joint("rail", "base", "cart", "prismatic", "0 0 1", "0 1 0"),
        joint("geared", "cart", "wheel", "revolute", "0 0 0", "0 0 1",
              '<mimic joint="rail" multiplier="2" offset="0.5"/>'),
        joint("turn", "wheel", "arm", "continuous", "0 0 0.3", "0 0 1"),
        joint("mount", "arm", "hand", "fixed", "1 0 0", "0 0 1"),
        joint("finger", "hand", "left", "prismatic", "0 0.1 0", "0 1 0",
              '<limit lower="0.02" upper="1" velocity="1"/>'),
        joint("other", "hand", "right", "prismatic", "0 -0.1 0", "0 1 0", '<mimic joint="finger" multiplier="-1"/>'),
    )  # fmt: skip


def test_sliding_following_and_resting_joints_move_as_the_urdf_says(tmp_path):
    described = robot(gantry(tmp_path), "hand")
    model = RobotModel.load(described)
    assert_links_at(model, described, np.array([[0.4, 0.7], [-1.0, 2.0]]))
    assert (model.arm, model.turns.tolist(), model.joints_move_alone) == (("rail", "turn"), [False, True], False)
    assert np.isinf(model.upper[1])
    q = np.array([0.4, 0.7])
    values = {"rail": 0.4, "geared": 1.3, "turn": 0.7, "finger": 0.02, "other": -0.02}
    assert model.joint_values(q) == pytest.approx(values)
    angle = 1.3 + 0.7
    expected = pose(rpy_to_matrix([0, 0, angle]), [np.cos(angle), 0.4 + np.sin(angle), 1.3])
    np.testing.assert_allclose(model.tool_pose(q), expected, atol=1e-12)
    np.testing.assert_allclose(jacobian(model, q), finite_differences(model, q), atol=1e-8)
    poses = model.link_poses(q[None])
    np.testing.assert_allclose(inverse(poses["hand"][0]) @ poses["right"][0], pose(position=[0, -0.12, 0]), atol=1e-12)


def test_joints_off_the_arm_rest_at_home(tmp_path):
    home = {"finger": 0.5, "turn": 0.1}
    model = RobotModel.load(robot(gantry(tmp_path), "hand", home=home))
    np.testing.assert_array_equal(model.home, [0.0, 0.1])
    values = model.joint_values(model.home)
    assert (values["finger"], values["other"]) == (0.5, -0.5)
