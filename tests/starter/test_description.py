"""What is found around a URDF: arguments and packages of a xacro, its SRDF, and what a configuration of MoveIt says."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cli.commands import workspaces
from sqrp_cli.cli.main import run
from sqrp_cli.errors import InputError
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.starter.description import OwnRobot, describe_robot, find_moveit
from sqrp_cli.starter.layout import Layout
from sqrp_cli.starter.make import OWN_ARM, SHIPPED, make_starter
from tests.cells import FILES, read_cases, refused

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def write(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def xacro(tmp_path: Path) -> Path:
    """The file of a robot of two packages, one in a repository with another name."""
    inner = (SHIPPED / OWN_ARM).read_text().partition("<robot")[2].partition(">")[2].rpartition("</robot>")[0]
    top = f"""<robot name="$(arg name)" {XMLNS}><xacro:arg name="kind" default="none"/>
      <xacro:include filename="$(find arm_parts)/urdf/parts.xacro"/>
      <xacro:if value="${{'$(arg kind)' == 'short'}}"><xacro:arm/></xacro:if></robot>"""
    files = {
        "arm_support/package.xml": "<package><name>arm_support</name></package>",
        "arm_support/urdf/arm.urdf.xacro": top,
        "Parts_ROS2/package.xml": "<package><name>arm_parts</name></package>",
        "Parts_ROS2/urdf/parts.xacro": f"<robot {XMLNS}><xacro:macro name='arm'>{inner}</xacro:macro></robot>",
    }
    return write(tmp_path / "src", files) / "arm_support" / "urdf" / "arm.urdf.xacro"


def test_arguments_and_packages_are_written_into_the_workspace_and_their_changes_understood(xacro, tmp_path):
    made = make_starter(tmp_path / "cell", OwnRobot(str(xacro), {"kind": "short"}))
    text = (made.folder / "workspace.yaml").read_text()
    assert 'urdf: {xacro: ../src/arm_support/urdf/arm.urdf.xacro, args: {kind: "short"}}' in text
    assert "package_roots: [../src/Parts_ROS2]" in text
    before = load_workspace(made.folder)
    assert before.robot.urdf.name == "arm"
    assert "xacro" not in (before.robot.urdf.expanded or "xacro")
    parts = tmp_path / "src" / "Parts_ROS2" / "urdf" / "parts.xacro"
    parts.write_text(parts.read_text().replace("<link", "<!-- a comment --><link", 1))
    assert load_workspace(made.folder).digest == before.digest
    parts.write_text(parts.read_text().replace('velocity="', 'velocity="1', 1))
    assert load_workspace(made.folder).digest != before.digest


def test_packages_elsewhere_are_found_in_stated_roots(xacro: Path, tmp_path: Path) -> None:
    elsewhere, far = tmp_path / "a" / "b" / "elsewhere", tmp_path / "x" / "y" / "z"
    for folder in (elsewhere, far):
        folder.mkdir(parents=True)
    (tmp_path / "src" / "Parts_ROS2").rename(elsewhere / "Parts_ROS2")
    (tmp_path / "src").rename(far / "src")
    urdf = str(far / xacro.relative_to(tmp_path))
    with pytest.raises(InputError, match="package `arm_parts` not found"):
        describe_robot(OwnRobot(urdf, {"kind": "short"}), tmp_path)
    found = describe_robot(OwnRobot(urdf, {"kind": "short"}, (elsewhere,)), tmp_path)
    assert found.package_roots == ("a/b/elsewhere",)


def test_folder_and_arguments_come_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(workspaces, "made", lambda ask: asked.append((ask.folder, ask.arguments)) or 1 / 0)
    assert run(["init", "kind:=short", "cell", "a:=b:=c", "--urdf", "arm.xacro"]) == 70
    assert asked == [(Path("cell"), {"kind": "short", "a": "b:=c"})]


URDF = '<robot name="ur5"><link name="base"/><link name="tip"/><joint name="j" type="fixed"><parent link="base"/>'
URDF += '<child link="tip"/></joint></robot>'


@pytest.mark.parametrize(("named", "beside", "taken"), [
    ("ur5_robot", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5"),
    ("ur5_gripper", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5_gripper"),
    ("ur5_limited", ["ur3_gripper", "ur5_lim", "ur5_gripper"], "ur5_lim"),
])  # fmt: skip
def test_of_several_srdfs_the_one_is_taken_that_is_named_like_the_arm(tmp_path, named, beside, taken):
    files = {f"urdf/{named}.urdf": URDF, **{f"srdf/{name}.srdf": '<robot name="ur5"/>' for name in beside}}
    write(tmp_path, files)
    found = describe_robot(OwnRobot(urdf=str(tmp_path / "urdf" / f"{named}.urdf")), tmp_path)
    assert Path(found.srdf_text or "").stem == taken


# A configuration of MoveIt, laid out as its setup assistant lays it out

ARM = read_urdf(SHIPPED / OWN_ARM)
JOINTS = [joint.name for joint in ARM.movable_joints]
TIP, CONFIG = "flange", "my_arm_moveit_config"
LIMITS = (FILES / "my_limits.yaml").read_text()
SRDF = (FILES / "my_arm.srdf.xacro").read_text()


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """A position from which work can begin: that of a first workspace of this arm."""
    made = make_starter(tmp_path_factory.mktemp("own") / "cell", None)
    return dict(load_workspace(made.folder).robot.home)


@pytest.fixture(scope="module")
def src(tmp_path_factory: pytest.TempPathFactory, home: dict[str, float]) -> Path:
    """The packages `my_arm_description` and `my_arm_moveit_config` in a folder of sources."""
    noted = {
        "urdf": {"package": "my_arm_description", "relative_path": "urdf/my_arm.urdf"},
        "srdf": {"relative_path": "config/my_arm.srdf.xacro"},
    }
    solver = {"kinematics_solver": "kdl_kinematics_plugin/KDLKinematicsPlugin", "kinematics_solver_timeout": 0.005}
    positions = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in home.items())
    files = {
        "Vendor_Arm_ROS2/package.xml": "<package><name>my_arm_description</name></package>",
        "Vendor_Arm_ROS2/urdf/my_arm.urdf": (SHIPPED / OWN_ARM).read_text(),
        f"{CONFIG}/package.xml": f"<package><name>{CONFIG}</name></package>",
        f"{CONFIG}/.setup_assistant": yaml.safe_dump({"moveit_setup_assistant_config": noted}),
        f"{CONFIG}/config/joint_limits.yaml": LIMITS,
        f"{CONFIG}/config/kinematics.yaml": yaml.safe_dump({"manipulator": solver}),
        f"{CONFIG}/config/my_arm.srdf.xacro": SRDF.replace("HOME", positions),
    }
    return write(tmp_path_factory.mktemp("ws") / "src", files)


@pytest.fixture
def own(src: Path, tmp_path: Path) -> Path:
    """A copy of these packages that a test may change."""
    return Path(shutil.copytree(src, tmp_path / "src"))


@pytest.fixture(scope="module")
def starter(src: Path) -> Layout:
    return make_starter(src.parent / "cell", OwnRobot(moveit=src / CONFIG))


@pytest.fixture(scope="module")
def workspace(starter: Layout) -> Workspace:
    return load_workspace(starter.folder)


def test_nothing_but_the_objects_is_left_to_type(starter: Layout, workspace: Workspace, home: dict[str, float]) -> None:
    robot = yaml.safe_load((starter.folder / "workspace.yaml").read_text())["robot"]
    assert robot["urdf"] == "../src/Vendor_Arm_ROS2/urdf/my_arm.urdf"
    assert robot["srdf"] == f"../src/{CONFIG}/config/my_arm.srdf.xacro"
    assert robot["limits"]["moveit"] == f"../src/{CONFIG}/config/joint_limits.yaml"
    assert robot["home"] == "home"
    assert workspace.robot.home == home
    assert robot["tool"]["link"] == TIP
    assert starter.task is not None
    (warning,) = [one for one in workspace.warnings if "camera_of_another_variant" in one.message]
    assert warning.code == "unknown-link"


def test_with_objects_of_ones_own_and_nothing_else_the_task_can_be_done(starter: Layout) -> None:
    file = Path(shutil.copytree(starter.folder, starter.folder.parent / "own")) / "workspace.yaml"
    before, after = file.read_text().split("\nobjects:")
    table, cube = (next(one for one in after.splitlines() if word in one) for word in ("  table:", "color: green"))
    bolt = f"  bolt:{cube.split(':', 1)[1].replace('type: cube', 'type: bolt')}"
    own = ["objects:", table, bolt, "state: [obj_on_table(bolt), hand_empty]", "tasks: [{task: pickup bolt}]", ""]
    file.write_text("\n".join([before, *own]))
    checked = open_cell(file.parent).check("pickup bolt")
    assert [candidate.feasible for candidate in checked.candidates] == [True]


def test_the_configuration_beside_a_urdf_is_found_by_itself_and_not_chosen_among_two(own: Path, tmp_path: Path) -> None:
    robot = OwnRobot(str(own / "Vendor_Arm_ROS2" / "urdf" / "my_arm.urdf"))
    found = describe_robot(robot, tmp_path)
    assert found.limits is not None
    assert (found.tip, found.warnings) == (TIP, ())
    shutil.copytree(own / CONFIG, own / "my_arm_pick_moveit_config")
    found = describe_robot(robot, tmp_path)
    (warning,) = found.warnings
    assert (found.limits, warning.code) == (None, "several-configs")
    assert "--moveit" in (warning.mend or "")


def test_the_solver_may_name_the_tip(own: Path, tmp_path: Path) -> None:
    link = ARM.movable_joints[4].child
    (own / CONFIG / "config" / "kinematics.yaml").write_text(
        f"/**:\n  ros__parameters:\n    robot_description_kinematics:\n      manipulator: {{tip_link: {link}}}\n"
    )
    assert describe_robot(OwnRobot(moveit=own / CONFIG), tmp_path).tip == link


@pytest.mark.parametrize("named", [CONFIG, f"{CONFIG}/config"])
def test_the_package_and_its_folder_of_files_mean_the_same(src: Path, named: str) -> None:
    assert find_moveit(src / named).srdfs[0] == src / CONFIG / "config" / "my_arm.srdf.xacro"


@pytest.mark.parametrize(("named", "says", "mend"), [
    ("my_arm_moveit_confg", f"did you mean `{CONFIG}`", "setup assistant"),
    ("Vendor_Arm_ROS2", "neither an SRDF nor joint_limits.yaml", "setup assistant"),
])  # fmt: skip
def test_a_folder_that_is_no_configuration_is_named(
    src: Path, tmp_path: Path, named: str, says: str, mend: str
) -> None:
    problem = refused(describe_robot, OwnRobot(moveit=src / named), tmp_path)
    assert says in problem.message
    assert mend in (problem.mend or "")


def test_a_urdf_that_is_not_there_is_asked_for(src: Path, tmp_path: Path) -> None:
    alone = Path(shutil.copytree(src / CONFIG, tmp_path / "alone" / CONFIG))
    problem = refused(describe_robot, OwnRobot(moveit=alone), tmp_path)
    assert problem.code == "missing-package"
    assert "--package-root" in (problem.mend or "")
    robot = OwnRobot(package_roots=(src / "Vendor_Arm_ROS2",), moveit=alone)
    assert describe_robot(robot, tmp_path).urdf.name == ARM.name


@pytest.mark.parametrize("case", read_cases("moveit.yaml"), ids=lambda case: case["case"])
def test_what_is_taken_from_a_configuration_and_what_is_refused(
    case: dict[str, Any], own: Path, tmp_path: Path
) -> None:
    for name, text in case.get("write", {}).items():
        file = own / name.replace("CONFIG", CONFIG)
        if text is None:
            file.unlink()
            continue
        for old, new in text.items() if isinstance(text, dict) else ():
            assert old in file.read_text()
            file.write_text(file.read_text().replace(old, new))
        if isinstance(text, str):
            write(own, {str(file): text.replace("CONFIG", CONFIG)})
    robot = OwnRobot(moveit=own / case.get("named", CONFIG))
    if "takes" not in case:
        problem = refused(describe_robot, robot, tmp_path)
        place = problem.place and [problem.place.file.name, problem.place.line]
        assert (problem.code, place) == (case["refused"], case.get("at", place))
        assert case.get("says", "") in problem.message
        assert case.get("not", "?") not in problem.message
        return
    found = describe_robot(robot, tmp_path)
    for text, wanted in zip((found.urdf_text, found.srdf_text, found.limits_file), case["takes"], strict=True):
        assert (text is None) == (wanted is None)
        assert wanted is None or wanted in str(text)
    assert [one.message for one in found.warnings] == [case[key] for key in ("says",) if key in case]
