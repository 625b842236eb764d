"""A link that the robot's file calls `world`, as those of UR, xArm and Z1 do, is not the cell's world."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.run.robot_body import RobotBody
from tests.cells import edit, refused

Damage = Callable[[dict[str, Any]], Path]

CAMERAS = Path(__file__).parents[1] / "cases" / "cameras"
HAND = "    frame: wrist\n    pose: {position: [0, 0.05, 0], quaternion: [0, 0, 0, 1]}\n"
MOVED = {"base: {position: [0, 0, 0.1]}": "base: {position: [0.2, 0, 0.1], rpy: [0, 0, 90 deg]}"}


def calibrated(folder: Path, frame: str) -> str:
    """An entry of a camera beside the robot, by a calibration that names the robot's base."""
    text = (CAMERAS / "easy_handeye2_on_base.calib").read_text(encoding="utf-8")
    (folder / "hand.yaml").write_text(text.replace("robot_base_frame: base", f"robot_base_frame: {frame}"), "utf-8")
    return f"    hand_eye: {folder / 'hand.yaml'}\n"


@pytest.fixture
def two_worlds(damaged: Damage) -> Callable[..., Path]:
    """The cell with a robot whose base is called `world`."""

    def make(**replace: str) -> Path:
        cell = damaged({"file": "workspace.yaml", "replace": replace})
        for name in ("arm.urdf", "arm.srdf"):
            text = (cell / name).read_text(encoding="utf-8")
            (cell / name).write_text(text.replace('"base"', '"world"'), encoding="utf-8")
        return cell

    return make


def told(workspace: Workspace) -> list[str]:
    return [warning.message for warning in workspace.warnings if warning.code == "ambiguous-word"]


def test_a_calibration_that_names_the_world_of_the_robot_means_its_link(two_worlds, tmp_path):
    workspace = load_workspace(two_worlds(**MOVED, **{HAND: calibrated(tmp_path, "world")}))
    camera = workspace.cameras["hand"]
    assert camera.frame == "robot/world"
    X_WL = RobotBody.load(workspace.robot).link_poses({})
    assert "world" not in X_WL
    np.testing.assert_allclose((X_WL[camera.frame] @ camera.X_FC)[:3, 3], [0.2, 0.5, 1.5], atol=1e-12)
    assert told(workspace) == []


def test_a_calibration_that_names_a_world_which_the_robot_lacks_is_asked_which_is_meant(damaged, tmp_path):
    cell = damaged({"file": "workspace.yaml", "replace": {HAND: calibrated(tmp_path, "world")}})
    problem = refused(load_workspace, cell)
    assert problem.code == "ambiguous-word"
    assert (problem.place.file.name, problem.place.line) == ("hand.yaml", 4)
    assert "the cell's world, or the frame in which the robot's driver gives its poses" in problem.message
    assert all(f"`frame: {frame}`" in problem.mend for frame in ("world", "base"))


@pytest.mark.parametrize("frame", ["world", "base"])
def test_the_workspace_says_which_world_a_calibration_means(damaged, tmp_path, frame):
    entry = f"{calibrated(tmp_path, 'world')}    frame: {frame}\n"
    workspace = load_workspace(damaged({"file": "workspace.yaml", "replace": {HAND: entry}}))
    assert workspace.cameras["hand"].frame == frame


@pytest.mark.parametrize(
    ("base", "warned"), [(MOVED, True), ({"position: [0, 0, 0.1]}": "position: [0, 0, 0]}"}, False)]
)
def test_which_world_was_meant_is_said_where_the_two_differ(two_worlds, base, warned):
    cell = two_worlds(**base, **{"  top:\n": "  top:\n    frame: world\n"})
    edit(cell / "pickup" / "skill.yaml", "frame: object@start, fits: object", "frame: world, fits: object")
    workspace = load_workspace(cell)
    assert workspace.cameras["top"].frame == "world"
    meant = "`frame: world` means the cell's world; the robot has a link `world` too, which is elsewhere"
    expected = [f"camera `top`: {meant}", f"skill `pickup`: box `place` of `on_table`: {meant}"]
    assert told(workspace) == (expected if warned else [])


def test_a_link_called_tool_is_reported_from_the_tool_frame(damaged):
    cell = damaged({"file": "workspace.yaml", "replace": {"tool_frame: tip": "tool_frame: tip  #"}})
    for name in ("arm.urdf", "workspace.yaml"):
        text = (cell / name).read_text(encoding="utf-8")
        (cell / name).write_text(text.replace('"wrist"', '"tool"').replace("wrist", "tool"), encoding="utf-8")
    (cell / "arm.srdf").write_text((cell / "arm.srdf").read_text("utf-8").replace("wrist", "tool"), encoding="utf-8")
    (message,) = told(load_workspace(cell))
    assert message.startswith("skill `pickup`: box `at_cup` of `hold`: `frame: tool` means the tool frame, `tip`;")


def test_what_is_solid_on_the_link_moves_with_the_base_and_boxes_in_the_world_do_not(two_worlds):
    workspace = load_workspace(two_worlds(**MOVED))
    (part,) = (part for part in workspace.robot.parts if part.parent.endswith("world"))
    assert (part.name, part.parent) == ("robot/world", "robot/world")
    cell = Cell.load(workspace)
    np.testing.assert_allclose(cell.model.link_poses(cell.model.home[None])[part.parent][0][:3, 3], [0.2, 0, 0.1])


@pytest.mark.parametrize("name", ["world", "robot/world"])
def test_the_tool_sits_on_the_link_under_either_name(two_worlds, name):
    cell = two_worlds(**{"link: wrist, pose": f"link: {name}, pose"})
    assert refused(load_workspace, cell).code == "unmoved-tool-frame"
