"""Loading a workspace as a whole."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace_file import read_again, read_workspace_document, replace_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import InputError
from sqrp_cli.logic.literal import Atom
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.run.record.bag_recorder import robot_description
from sqrp_cli.shapes import Box, Sphere
from sqrp_cli.skill.settings import Reference
from sqrp_cli.skill.skill import JointMove, RetryEntry
from tests.cells import ROOT, edit, refusal, refused

Damage = Callable[[dict[str, Any]], Path]
SHIPPED = sorted((Path(__file__).parents[2] / "workspaces").glob("*/workspace.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=[path.parent.name for path in SHIPPED])
def test_shipped_workspaces_load_without_errors(path):
    workspace = load_workspace(path.parent)
    assert workspace.name == path.parent.name
    assert [finding for finding in lint(workspace) if finding.severity == "error"] == []


def test_a_folder_and_its_file_are_the_same_workspace_however_they_are_reached(cell):
    assert load_workspace(cell).digest == load_workspace(cell / "workspace.yaml").digest
    assert load_workspace(cell / ".." / cell.name).path == load_workspace(cell.resolve()).path


@pytest.mark.parametrize("given", ["mycell", "mycell/workspace.yaml", "../here/mycell"])
def test_mistakes_are_placed_at_the_path_as_it_was_given(given, cell, monkeypatch):
    here = cell.parent / "here"
    shutil.copytree(cell, here / "mycell")
    monkeypatch.chdir(here)
    file = here / "mycell" / "workspace.yaml"
    file.write_text(file.read_text() + "\ncamera: {}\n")
    with pytest.raises(InputError) as caught:
        load_workspace(Path(given))
    assert str(caught.value).startswith(f"{given.removesuffix('/workspace.yaml')}/workspace.yaml:")


def test_a_workspace_that_is_given_from_here_keeps_absolute_paths_of_its_files(cell, monkeypatch):
    there = load_workspace(cell)
    monkeypatch.chdir(cell)
    here = load_workspace(Path())
    assert (here.path, here.name, here.digest) == (there.path, there.name, there.digest)
    assert {file.path for file in here.files.values()} == {file.path for file in there.files.values()}
    assert {place.file for place in here.places.values()} == {Path("workspace.yaml")}
    assert str(here.whole_file) == "workspace.yaml"


def test_a_whole_path_can_be_read_from_a_working_folder_that_was_deleted(cell, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert load_workspace(cell.resolve()).name == cell.name


@pytest.mark.parametrize(("text", "says"), [
        ("sqrp_program: 1\nworkspace: mycell/workspace.yaml\nsteps: []\n",
         "this is a program; its workspace is {folder}/mycell/workspace.yaml"),
        ((ROOT / "skills" / "pickup" / "skill.yaml").read_text(),
         "this is a skill; name the workspace that uses it"),
])  # fmt: skip
@pytest.mark.parametrize("name", ["skill.yaml", "other.yaml"])
def test_a_program_or_skill_where_a_workspace_is_expected_is_one_message(tmp_path, name, text, says):
    (tmp_path / name).write_text(text)
    found = refused(load_workspace, tmp_path / name)
    assert str(found) == f"{tmp_path / name}: {says.format(folder=tmp_path)}"
    assert found.mend == (f"sqrp program {tmp_path / name}" if "program" in says else None)


def test_values_are_in_si_units(cell):
    workspace = load_workspace(cell)
    robot = workspace.robot
    assert robot.home == pytest.approx({"shoulder": math.radians(10), "elbow": math.radians(-20), "slide": 0.05})
    assert robot.limits["shoulder"].velocity == pytest.approx(math.pi / 2)
    assert (robot.limits["slide"].velocity, robot.limits["slide"].acceleration) == (0.5, 3.0)
    assert workspace.detectors["color"].min_visible == 0.5
    assert workspace.padding == 0.005
    assert robot.X_WB[:3, 3].tolist() == [0, 0, 0.1]
    assert robot.tool.X_LT[2, 3] == 0.005


def test_missing_limits_are_assumed_as_stated(cell):
    workspace = load_workspace(cell)
    assert workspace.robot.limits["elbow"].velocity == 1.0
    assert workspace.robot.limits["elbow"].jerk == 50.0
    assert [warning.code for warning in workspace.warnings] == ["assumed-limit"]
    assert "elbow" in workspace.warnings[0].message


def test_a_velocity_of_0_is_said_to_be_assumed_otherwise(damaged):
    workspace = load_workspace(damaged({"file": "arm.urdf", "replace": {'velocity="0.5"': 'velocity="0"'}}))
    (warning,) = workspace.warnings
    assert "limits are not stated (or are 0) and assumed, in rad or m and s: velocity (1 for " in warning.message


def test_a_tool_may_be_boxes_with_a_frame_that_grasps(damaged):
    boxes = "tool: {boxes: [{size: [6 cm, 6 cm, 4 cm]}], frame: {position: [0, 0, 2 cm]}, link: wrist}"
    urdf = "tool: {urdf: cup.urdf, link: wrist, pose: {position: [0, 0, 5 mm]}}\n  tool_frame: tip"
    robot = load_workspace(damaged({"file": "workspace.yaml", "replace": {urdf: boxes}})).robot
    assert robot.tool.file is None
    assert robot.tool_frame == "tool_tip"
    assert robot.tool.urdf.links["tool_body"].collision[0].shape == Box((0.06, 0.06, 0.04))
    assert robot.tool.urdf.joints["tool_tip_joint"].X_PJ[2, 3] == 0.02
    assert [(part.parent, part.shape) for part in robot.parts][-1] == ("tool_body", Box((0.06, 0.06, 0.04)))


@pytest.mark.parametrize(("of", "root", "frame"), [
    ("urdf: cup.urdf, ", "cup", "tool_tip"), ("", "tool_body", "tool_tip"),
    ("prefix: my_, ", "my_tool_body", "my_tool_tip"),
])  # fmt: skip
def test_where_it_grasps_may_be_a_pose_in_the_urdf_of_a_tool_or_on_a_hand_of_the_robot(damaged, of, root, frame):
    """In the link of the robot: 5 mm to the tool's root, and 30 mm from there to the frame."""
    stated = f"tool: {{{of}link: wrist, pose: {{position: [0, 0, 5 mm]}}, frame: {{position: [0, 0, 3 cm]}}}}"
    urdf = "tool: {urdf: cup.urdf, link: wrist, pose: {position: [0, 0, 5 mm]}}\n  tool_frame: tip"
    robot = load_workspace(damaged({"file": "workspace.yaml", "replace": {urdf: stated}})).robot
    assert (robot.tool.urdf.root, robot.tool_frame) == (root, frame)
    assert ("cup" in [part.parent for part in robot.parts]) == (root == "cup")
    poses = RobotModel.load(robot).home_links
    assert (np.linalg.inv(poses["wrist"]) @ poses[frame])[:3, 3] == pytest.approx([0.0, 0.0, 0.035])


def test_robot_and_tool_with_links_and_joints_of_the_same_names_are_joined_by_a_prefix(cell):
    """The tool's links have the names of the robot's, and its finger moves by a joint of the name of one of it."""
    renamed = (cell / "cup.urdf").read_text().replace('"cup"', '"base"').replace('"cup_tip"', '"elbow"')
    finger = (
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="wrist"/><axis xyz="1 0 0"/>'
        '<limit lower="0" upper="0.01" velocity="0.1" effort="1"/></joint><link name="wrist"/></robot>'
    )
    (cell / "cup.urdf").write_text(renamed.replace("</robot>", finger))
    problem = refusal(cell)
    assert "both have a link `base`, and 2 more names in common" in problem.message
    assert "`prefix: tool_`" in problem.mend

    edit(cell, "link: wrist, pose", "prefix: tool_, link: wrist, pose", "tool_frame: tip", "tool_frame: tool_tip")
    robot = load_workspace(cell).robot
    assert robot.tool.urdf.root == "tool_base"
    assert robot.tool_frame == "tool_tip"
    assert [part.parent for part in robot.parts] == ["base", "upper", "lower", "tool_base"]
    assert robot.limits.keys() == {"shoulder", "elbow", "slide", "tool_slide"}

    described = Xml.fromstring(robot_description(robot))  # noqa: S314 - our own
    links = [link.get("name") for link in described.iter("link")]
    joints = {joint.get("name"): joint.find("child").get("link") for joint in described.iter("joint")}  # type: ignore[union-attr]
    assert sorted(links) == sorted(["base", "upper", "lower", "wrist", "tool_base", "tool_tip", "tool_wrist"])
    assert sorted({"base", *joints.values()}) == sorted(links)
    assert joints["tool_slide"] == "tool_wrist"

    assert RobotModel.load(robot).tree.mounts.keys() >= {"wrist", "tool_wrist"}


def test_home_may_be_a_named_state_of_the_srdf(damaged):
    home = "home: {shoulder: 10 deg, elbow: -20 deg, slide: 5 cm}"
    robot = load_workspace(damaged({"file": "workspace.yaml", "replace": {home: "home: folded"}})).robot
    assert robot.home == {"shoulder": 0.0, "elbow": 1.5, "slide": 0.1}
    assert robot.disabled_pairs == {("base", "upper")}


def test_objects_keep_their_parts_types_and_places(cell):
    workspace = load_workspace(cell)
    tray, lost = workspace.objects["tray"], workspace.objects["lost"]
    assert [part.name for part in tray.parts] == ["tray/floor", "tray/1", "tray/2"]
    assert tray.types == ("tray", "movable")
    assert workspace.objects["table"].types == ("table", "fixture")
    assert lost.X_WO is None
    assert "lost" not in workspace.stated_world.X_WO
    assert workspace.objects["blue"].X_WO is not None
    assert np.allclose(workspace.objects["blue"].X_WO[:2, :2], np.array([[1, -1], [1, 1]]) / math.sqrt(2))
    assert workspace.state == {Atom("hand_empty"), Atom("on_table", ("red",)), Atom("on_table", ("blue",))}


def test_a_skill_keeps_parameters_settings_and_responses(cell):
    skill = load_workspace(cell).skills["pickup"]
    values = {parameter.name: parameter.values for parameter in skill.motion_parameters}
    assert values["yaw"] == (0.0, pytest.approx(math.pi / 2))
    assert values["lift"] == pytest.approx((0.05, 0.10, 0.15))
    first, second, *_, last = skill.primitives
    assert (type(first), type(last), first.speed, last.speed) == (JointMove, JointMove, Reference("speed"), 1.0)
    assert (second.speed, second.acceleration, second.jerk) == (0.05, 0.5, 5.0)
    assert [requirement.stated.settle for requirement in skill.requirements] == [0.5, 0.2, 0.5]
    slip = skill.requirements[-1]
    assert (slip.name, slip.stated.response) == ("slip", RetryEntry(retry=2, when="on_table"))
    assert str(slip.retry_when) == "on_table"


@pytest.mark.parametrize(("asked", "entries", "meant"), [
        ("nosuch", ["env.sh", "such.txt", "such/readme.md"], None), ("nosuch", ["such/workspace.yaml"], "such"),
        ("tabeltop", ["tabletop.sh", "tabletop.yaml"], "tabletop.yaml"),
        ("tabeltop.yaml", ["tray.yaml", "bin.yaml"], None),
        ("tabletop", ["cells/tabletop/workspace.yaml", "tableto/workspace.yaml"], "cells/tabletop"),
        ("left.yaml", ["cells/left.yaml"], "cells/left.yaml"),
        ("cels/left", ["cells/readme.md", "cell/left/workspace.yaml"], "cell"),
])  # fmt: skip
def test_only_what_can_be_a_workspace_of_a_near_name_is_suggested(tmp_path, asked, entries, meant):
    for entry in entries:
        (tmp_path / entry).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / entry).touch()
    hint = f"; did you mean `{tmp_path / meant}`?" if meant else ""
    assert refused(load_workspace, tmp_path / asked).message == f"no such file or folder{hint}"


def test_a_folder_of_workspaces_says_which_it_has(tmp_path, cell):
    (tmp_path / "nothing").mkdir()
    said = {"": "it has the workspaces `cell`", "cel": f"did you mean `{cell}`", "nothing": "the folder is empty"}
    assert all(words in refused(load_workspace, tmp_path / name).message for name, words in said.items())


def test_a_workspace_that_has_changed_since_it_was_read_is_not_written_over(cell):
    file = cell / "workspace.yaml"
    workspace, document = load_workspace(file), read_workspace_document(file)
    changed = file.read_bytes() + b"# another one's\n"
    file.write_bytes(changed)
    with pytest.raises(InputError, match="changed meanwhile"):
        replace_workspace(document, document.content)
    with pytest.raises(InputError, match="changed meanwhile"):
        read_again(file, workspace.files["workspace"].digest)
    assert file.read_bytes() == changed
    replace_workspace(read_workspace_document(file), document.content)
    assert file.read_bytes() == document.content


@pytest.mark.parametrize("reference", ["nothing.stl", "model://parts/nothing.stl"])
def test_a_mesh_without_triangles_is_left_out_and_its_link_has_its_other_geometry(cell, reference, monkeypatch):
    models = cell.parent / "models"
    for folder in (cell, models / "parts"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "nothing.stl").write_bytes(bytes(84))
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(models))
    collision = f'<collision><geometry><mesh filename="{reference}"/></geometry></collision>'
    visual = '<visual><geometry><sphere radius="0.02"/></geometry></visual>'
    edit(cell / "arm.urdf", '<link name="wrist"/>', f'<link name="wrist">{collision}{visual}</link>')
    workspace = load_workspace(cell)
    assert [part.shape for part in workspace.robot.parts if part.parent == "wrist"] == [Sphere(0.02)]
    (warning,) = [warning for warning in workspace.warnings if warning.code == "no-size"]
    assert "of `wrist`" in warning.message
    monkeypatch.delenv("GAZEBO_MODEL_PATH")
    assert "://" not in reference or "package `parts` not found" in str(refusal(cell))
