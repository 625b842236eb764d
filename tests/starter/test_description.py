"""What is found around a URDF, and of a xacro: arguments and packages are written into a new workspace."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cli.commands import workspaces
from sqrp_cli.cli.main import run
from sqrp_cli.errors import InputError
from sqrp_cli.starter.description import OwnRobot, describe_robot
from sqrp_cli.starter.make import OWN_ARM, SHIPPED, make_starter

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


@pytest.fixture
def src(tmp_path: Path) -> Path:
    """A robot of two packages, one in a repository with another name."""
    src = tmp_path / "src"
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
    for name, text in files.items():
        (src / name).parent.mkdir(parents=True, exist_ok=True)
        (src / name).write_text(text)
    return src


def test_arguments_and_packages_are_written_into_the_workspace(src: Path, tmp_path: Path) -> None:
    urdf = src / "arm_support" / "urdf" / "arm.urdf.xacro"
    made = make_starter(tmp_path / "cell", OwnRobot(str(urdf), {"kind": "short"}))
    text = (made.folder / "workspace.yaml").read_text()
    assert 'urdf: {xacro: ../src/arm_support/urdf/arm.urdf.xacro, args: {kind: "short"}}' in text
    assert "package_roots: [../src/Parts_ROS2]" in text
    robot = load_workspace(made.folder).robot
    assert robot.urdf.name == "arm"
    assert robot.urdf.expanded is not None
    assert "xacro" not in robot.urdf.expanded


def test_packages_elsewhere_are_found_in_stated_roots(src: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "a" / "b" / "elsewhere"
    elsewhere.mkdir(parents=True)
    (src / "Parts_ROS2").rename(elsewhere / "Parts_ROS2")
    urdf = str(src / "arm_support" / "urdf" / "arm.urdf.xacro")
    far = tmp_path / "x" / "y" / "z"
    far.mkdir(parents=True)
    src.rename(far / "src")
    urdf = urdf.replace(str(src), str(far / "src"))
    with pytest.raises(InputError, match="package `arm_parts` not found"):
        describe_robot(OwnRobot(urdf, {"kind": "short"}), tmp_path)
    found = describe_robot(OwnRobot(urdf, {"kind": "short"}, (elsewhere,)), tmp_path)
    assert found.package_roots == ("a/b/elsewhere",)


def test_a_changed_xacro_changes_what_was_understood_and_a_comment_does_not(src: Path, tmp_path: Path) -> None:
    made = make_starter(tmp_path / "cell", OwnRobot(str(src / "arm_support/urdf/arm.urdf.xacro"), {"kind": "short"}))
    parts = src / "Parts_ROS2" / "urdf" / "parts.xacro"
    before = load_workspace(made.folder).digest
    parts.write_text(parts.read_text().replace("<link", "<!-- a comment --><link", 1))
    assert load_workspace(made.folder).digest == before
    parts.write_text(parts.read_text().replace('velocity="', 'velocity="1', 1))
    assert load_workspace(made.folder).digest != before


def test_folder_and_arguments_come_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(workspaces, "made", lambda ask: asked.append((ask.folder, ask.arguments)) or 1 / 0)
    assert run(["init", "kind:=short", "cell", "a:=b:=c", "--urdf", "arm.xacro"]) == 70
    assert asked == [(Path("cell"), {"kind": "short", "a": "b:=c"})]


URDF = '<robot name="ur5"><link name="base"/><link name="tip"/><joint name="j" type="fixed"><parent link="base"/>'
URDF += '<child link="tip"/></joint></robot>'


@pytest.mark.parametrize(
    ("named", "beside", "taken"),
    [
        ("ur5_robot", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5"),
        ("ur5_gripper", ["ur3_gripper", "ur5", "ur5_gripper"], "ur5_gripper"),
        ("ur5_limited", ["ur3_gripper", "ur5_lim", "ur5_gripper"], "ur5_lim"),
    ],
)
def test_of_several_srdfs_the_one_is_taken_that_is_named_like_the_arm(
    tmp_path: Path, named: str, beside: list[str], taken: str
) -> None:
    (tmp_path / "urdf").mkdir()
    (tmp_path / "srdf").mkdir()
    (tmp_path / "urdf" / f"{named}.urdf").write_text(URDF)
    for name in beside:
        (tmp_path / "srdf" / f"{name}.srdf").write_text('<robot name="ur5"/>')
    found = describe_robot(OwnRobot(urdf=str(tmp_path / "urdf" / f"{named}.urdf")), tmp_path)
    assert Path(found.srdf_text or "").stem == taken
