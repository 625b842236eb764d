"""Links stand and move as Pinocchio says: for robots of any shape, and real ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Place
from sqrp_cli.geometry import Array, pose, rpy_to_matrix
from sqrp_cli.robot.joint_tree import JointTree
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot import Robot, Tool
from sqrp_cli.robot.urdf import JointType, Mimic, UrdfJoint, UrdfLink, UrdfModel
from tests.task.robots import REAL_ARMS, ROBOTS, robot

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
        kind = KINDS[rng.integers(4)]
        follows = kind != "fixed" and leaders and rng.random() < 0.3
        axis = rng.normal(size=3)
        joints[f"{prefix}j{index}"] = UrdfJoint(
            name=f"{prefix}j{index}",
            type=kind,
            parent=names[rng.integers(index + 1)],
            child=names[index + 1],
            X_PJ=placed(rng),
            axis=axis / np.linalg.norm(axis),
            lower=-3.0,
            upper=3.0,
            velocity=None,
            effort=None,
            mimic=Mimic(leaders[rng.integers(len(leaders))], *rng.uniform(-2, 2, 2)) if follows else None,
            place=PLACE,
        )
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
        for joint in urdf.joints.values():
            carrier, X_JL = seats[joint.parent][0], seats[joint.parent][1] @ joint.X_PJ
            if joint.movable:
                slides = joint.type == "prismatic"
                kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
                carrier, X_JL = model.addJoint(carrier, kind(joint.axis), pin.SE3(X_JL), joint.name), np.eye(4)
            seats[joint.child] = carrier, X_JL
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
    for link, mount in tree.mounts.items():
        chain = tree.chain(link)
        for row, q in enumerate(positions):
            X_WL = mount.X_JL if mount.joint < 0 else X_WJ[row, mount.joint] @ mount.X_JL
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
def test_random_robots_stand_where_pinocchio_says(seed: int) -> None:
    assert_equal_at(random_robot(np.random.default_rng(seed)), seed)


def test_every_installed_robot_stands_where_pinocchio_reads_it() -> None:
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
        for joint, value in zip(tree.joints, positions[0], strict=True):
            read = theirs.joints[theirs.getJointId(joint.name)]
            q[read.idx_q : read.idx_q + read.nq] = [value] if read.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(theirs, data, q)
        X_WJ = tree.poses(positions)[0]
        for link, mount in tree.mounts.items():
            X_WL = mount.X_JL if mount.joint < 0 else X_WJ[mount.joint] @ mount.X_JL
            frame = theirs.getFrameId(link.removeprefix("robot/"), pin.FrameType.BODY)
            np.testing.assert_allclose(X_WL, data.oMf[frame].homogeneous, atol=1e-9, err_msg=f"{path.name} {link}")
        count += 1
    assert count >= 60


@pytest.mark.parametrize("name", REAL_ARMS)
def test_real_arms_stand_where_pinocchio_says(name: str) -> None:
    urdf, tool_frame = REAL_ARMS[name]
    assert_equal_at(robot(ROBOTS / urdf, tool_frame), 0)
