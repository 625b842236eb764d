"""A configuration of MoveIt, laid out as its setup assistant lays it out, needs nothing to be typed again."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.starter.description import OwnRobot, describe_robot, find_moveit
from sqrp_cli.starter.layout import Layout
from sqrp_cli.starter.make import OWN_ARM, SHIPPED, make_starter
from tests.cells import FILES

ARM = read_urdf(SHIPPED / OWN_ARM)
JOINTS = [joint.name for joint in ARM.movable_joints]
TIP = "flange"

LIMITS = (FILES / "my_limits.yaml").read_text()
SRDF = (FILES / "my_arm.srdf.xacro").read_text()


def config(src: Path, home: dict[str, float]) -> Path:
    """The packages `my_arm_description` and `my_arm_moveit_config` in a folder of sources."""
    described, folder = src / "Vendor_Arm_ROS2", src / "my_arm_moveit_config"
    for directory in (described / "urdf", folder / "config"):
        directory.mkdir(parents=True)
    (described / "package.xml").write_text("<package><name>my_arm_description</name></package>")
    shutil.copyfile(SHIPPED / OWN_ARM, described / "urdf" / "my_arm.urdf")
    (folder / "package.xml").write_text("<package><name>my_arm_moveit_config</name></package>")
    noted = {
        "urdf": {"package": "my_arm_description", "relative_path": "urdf/my_arm.urdf"},
        "srdf": {"relative_path": "config/my_arm.srdf.xacro"},
    }
    (folder / ".setup_assistant").write_text(yaml.safe_dump({"moveit_setup_assistant_config": noted}))
    (folder / "config" / "joint_limits.yaml").write_text(LIMITS)
    solver = {"kinematics_solver": "kdl_kinematics_plugin/KDLKinematicsPlugin", "kinematics_solver_timeout": 0.005}
    (folder / "config" / "kinematics.yaml").write_text(yaml.safe_dump({"manipulator": solver}))
    positions = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in home.items())
    (folder / "config" / "my_arm.srdf.xacro").write_text(SRDF.replace("HOME", positions))
    return folder


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """A position from which work can begin: that of a first workspace of this arm."""
    made = make_starter(tmp_path_factory.mktemp("own") / "cell", None)
    return dict(load_workspace(made.folder).robot.home)


@pytest.fixture(scope="module")
def src(tmp_path_factory: pytest.TempPathFactory, home: dict[str, float]) -> Path:
    folder = tmp_path_factory.mktemp("ws") / "src"
    config(folder, home)
    return folder


@pytest.fixture(scope="module")
def starter(src: Path) -> Layout:
    return make_starter(src.parent / "cell", OwnRobot(moveit=src / "my_arm_moveit_config"))


@pytest.fixture(scope="module")
def workspace(starter: Layout) -> Workspace:
    return load_workspace(starter.folder)


def test_nothing_but_the_objects_is_left_to_type(starter: Layout) -> None:
    robot = yaml.safe_load((starter.folder / "workspace.yaml").read_text())["robot"]
    assert robot["urdf"] == "../src/Vendor_Arm_ROS2/urdf/my_arm.urdf"
    assert robot["srdf"] == "../src/my_arm_moveit_config/config/my_arm.srdf.xacro"
    assert robot["limits"]["moveit"] == "../src/my_arm_moveit_config/config/joint_limits.yaml"
    assert robot["home"] == "home"
    assert robot["tool"]["link"] == TIP
    assert starter.task is not None


def test_with_objects_of_ones_own_and_nothing_else_the_task_can_be_done(starter: Layout) -> None:
    file = Path(shutil.copytree(starter.folder, starter.folder.parent / "own")) / "workspace.yaml"
    before, after = file.read_text().split("\nobjects:")
    table, cube = (next(one for one in after.splitlines() if word in one) for word in ("  table:", "color: green"))
    bolt = f"  bolt:{cube.split(':', 1)[1].replace('type: cube', 'type: bolt')}"
    own = ["objects:", table, bolt, "state: [obj_on_table(bolt), hand_empty]", "tasks: [{task: pickup bolt}]", ""]
    file.write_text("\n".join([before, *own]))
    checked = open_cell(file.parent).check("pickup bolt")
    assert [candidate.feasible for candidate in checked.candidates] == [True]


def test_limits_are_taken_over_exactly(workspace: Workspace) -> None:
    for name, stated in yaml.safe_load(LIMITS)["joint_limits"].items():
        limits = workspace.robot.limits[name]
        assert limits.velocity == 0.5 * stated["max_velocity"]
        assert limits.acceleration == (0.8 * stated["max_acceleration"] if name != JOINTS[5] else 2)
        assert limits.jerk == stated["max_jerk"]


def test_the_named_state_is_the_home(workspace: Workspace, home: dict[str, float]) -> None:
    assert workspace.robot.home == home


def test_what_the_srdf_says_of_another_variant_is_one_warning(workspace: Workspace) -> None:
    (warning,) = [warning for warning in workspace.warnings if "camera_of_another_variant" in warning.message]
    assert warning.code == "unknown-link"


def test_the_configuration_beside_a_urdf_is_found_by_itself(src: Path, tmp_path: Path) -> None:
    found = describe_robot(OwnRobot(str(src / "Vendor_Arm_ROS2" / "urdf" / "my_arm.urdf")), tmp_path)
    assert found.limits is not None
    assert (found.tip, found.warnings) == (TIP, ())


def test_two_configurations_of_one_robot_are_not_chosen_between(src: Path, tmp_path: Path) -> None:
    shutil.copytree(src, tmp_path / "src")
    shutil.copytree(src / "my_arm_moveit_config", tmp_path / "src" / "my_arm_pick_moveit_config")
    urdf = tmp_path / "src" / "Vendor_Arm_ROS2" / "urdf" / "my_arm.urdf"
    found = describe_robot(OwnRobot(str(urdf)), tmp_path)
    (warning,) = found.warnings
    assert (found.limits, warning.code) == (None, "several-configs")
    assert "--moveit" in (warning.mend or "")


def test_the_solver_may_name_the_tip(src: Path, tmp_path: Path) -> None:
    shutil.copytree(src, tmp_path / "src")
    link = ARM.movable_joints[4].child
    (tmp_path / "src" / "my_arm_moveit_config" / "config" / "kinematics.yaml").write_text(
        f"/**:\n  ros__parameters:\n    robot_description_kinematics:\n      manipulator: {{tip_link: {link}}}\n"
    )
    assert describe_robot(OwnRobot(moveit=tmp_path / "src" / "my_arm_moveit_config"), tmp_path).tip == link


@pytest.mark.parametrize("named", ["my_arm_moveit_config", "my_arm_moveit_config/config"])
def test_the_package_and_its_folder_of_files_mean_the_same(src: Path, named: str) -> None:
    assert find_moveit(src / named).srdf == src / "my_arm_moveit_config" / "config" / "my_arm.srdf.xacro"


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("my_arm_moveit_confg", "did you mean `my_arm_moveit_config`"),
        ("Vendor_Arm_ROS2", "neither an SRDF nor joint_limits.yaml"),
    ],
)
def test_a_folder_that_is_no_configuration_is_named(src: Path, tmp_path: Path, named: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        describe_robot(OwnRobot(moveit=src / named), tmp_path)
    assert "setup assistant" in (caught.value.problems[0].mend or "")


def test_a_urdf_that_is_not_there_is_asked_for(src: Path, tmp_path: Path) -> None:
    shutil.copytree(src / "my_arm_moveit_config", tmp_path / "alone" / "my_arm_moveit_config")
    with pytest.raises(InputError) as caught:
        describe_robot(OwnRobot(moveit=tmp_path / "alone" / "my_arm_moveit_config"), tmp_path)
    (problem,) = caught.value.problems
    assert problem.code == "missing-package"
    assert "--package-root" in (problem.mend or "")
    roots = (src / "Vendor_Arm_ROS2",)
    robot = OwnRobot(package_roots=roots, moveit=tmp_path / "alone" / "my_arm_moveit_config")
    assert describe_robot(robot, tmp_path).urdf.name == ARM.name


@pytest.mark.parametrize(
    ("file", "text"), [(".setup_assistant", "moveit_setup_assistant_config: 5\n"), ("config/kinematics.yaml", "5\n")]
)
def test_a_configuration_that_says_something_else_is_refused_with_its_file(
    src: Path, tmp_path: Path, file: str, text: str
) -> None:
    shutil.copytree(src, tmp_path / "src")
    folder = tmp_path / "src" / "my_arm_moveit_config"
    (folder / file).write_text(text)
    with pytest.raises(InputError) as caught:
        describe_robot(OwnRobot(moveit=folder), tmp_path)
    (problem,) = caught.value.problems
    assert problem.place is not None
    assert (problem.place.file, problem.place.line) == (folder / file, 1)
