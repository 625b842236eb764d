"""Robots and grippers by name: what packages have can be read, and what they do not have is said."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.starter.arm_guess import guess_arm
from sqrp_cli.starter.by_name import GRIPPERS, ROBOTS, find_named
from sqrp_cli.starter.description import OwnRobot, describe_robot
from sqrp_cli.starter.hand import driven_joints
from sqrp_cli.starter.make import make_starter
from tests.cells import refused

AXES = {"panda": 7, "so101": 5, "px100": 4, "baxter": 7, "tiago": 8}


def test_every_robot_of_an_installed_package_has_an_arm(tmp_path: Path) -> None:
    further = ("robosuite/", "robotblockset/", "gymnasium_robotics/")  # packages that the tests do not need
    for name in (name for name, path in ROBOTS.items() if not path.startswith(further)):
        urdf, arguments = find_named(name, "robot")
        read = describe_robot(OwnRobot(urdf, arguments), tmp_path)
        arm = guess_arm(read.urdf, read.tip)
        assert len(arm.joints) == AXES.get(name, len(arm.joints)) >= 4, name
        assert any(link.geometry("collision") for link in read.urdf.links.values()), name


def test_every_gripper_of_an_installed_package_has_fingers(tmp_path: Path) -> None:
    for name in GRIPPERS:
        arm = find_named("UR5e", "robot")[0]
        gripper = describe_robot(OwnRobot(arm, gripper=find_named(name, "gripper")[0]), tmp_path).gripper
        assert gripper is not None
        assert len(driven_joints(gripper.movable_joints, gripper.links)) in (1, 2), name


@pytest.mark.parametrize(("name", "message", "mend"), [
    ("padna", r"no robot is called `padna`; did you mean `panda`\? installed are .*\bso101\b.*\bur5e\b",
     "--urdf FILE"),
    ("gen3", r"`gen3` is in a package that is not installed, kortex_description; installed are .*\bpanda\b",
     "install the ROS package kortex_description, and source its workspace"),
])  # fmt: skip
def test_a_name_that_is_unknown_or_not_installed_says_what_there_is(name: str, message: str, mend: str) -> None:
    problem = refused(find_named, name, "robot")
    assert re.search(message, problem.message)
    assert re.search(mend, problem.mend or "")


def test_the_name_of_a_robot_is_no_file(tmp_path: Path) -> None:
    assert refused(describe_robot, OwnRobot("ur5e"), tmp_path).mend == "name the robot, not a file: `--robot ur5e`"


def test_a_gripper_that_is_not_understood_is_refused_and_no_cup_stands_for_it(tmp_path: Path) -> None:
    hand = "package://example-robot-data/robots/allegro_hand_description/urdf/allegro_left_hand.urdf"
    problem = refused(make_starter, tmp_path / "cell", OwnRobot(find_named("ur5e", "robot")[0], gripper=hand))
    assert "`allegro_hand_left` has no fingers that SQRP understands" in problem.message
    assert list(tmp_path.iterdir()) == []


def test_a_second_hand_is_refused(tmp_path: Path) -> None:
    arm, gripper = find_named("panda", "robot")[0], find_named("robotiq_2f_85", "gripper")[0]
    with pytest.raises(InputError, match="has a hand, which `panda_finger_joint1` moves"):
        make_starter(tmp_path / "cell", OwnRobot(arm, gripper=gripper))
