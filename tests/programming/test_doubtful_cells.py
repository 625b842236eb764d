"""Warnings that need the robot's geometry: cameras inside something solid, speeds that the tool never reaches."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.checks.cell_warnings import cell_warnings, fastest_tool
from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell

CELL = Path(__file__).parents[1] / "cases" / "cell"
TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"
CODES = {"camera-inside-robot", "camera-inside-object", "unreachable-speed"}


def found(folder: Path) -> list[Problem]:
    return [problem for problem in cell_warnings(Cell.load(load_workspace(folder))) if problem.code in CODES]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CELL, tmp_path / "cell"))


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


TOP = "position: [0.5, 0, 1.5], look_at: [0.5, 0, 0]"
HAND = "frame: wrist\n    pose: {position: [0, 0.05, 0]"


def test_no_shipped_camera_is_inside_a_link() -> None:
    assert found(TABLETOP) == []
    assert found(CELL) == []


@pytest.mark.parametrize(
    ("old", "new", "camera", "solid"),
    [
        (TOP, "position: [0, 0, 0.1], look_at: [0.5, 0, 0]", "top", "link `base`"),  # a box, which stands at z = 0.1
        (TOP, "position: [0.01, 0, 0.22], look_at: [0.5, 0, 0]", "top", None),  # above the base and the upper arm
        (HAND, "frame: lower\n    pose: {position: [0.01, 0, 0]", "hand", "link `lower`"),  # the mesh that carries it
        (HAND, "frame: lower\n    pose: {position: [0.1, 0, 0]", "hand", None),
    ],
)
def test_a_camera_inside_a_link_is_reported_with_the_link(
    old: str, new: str, camera: str, solid: str | None, cell: Path
) -> None:
    replace(cell / "workspace.yaml", old, new)
    problems = found(cell)
    assert [problem.code for problem in problems] == ["camera-inside-robot"] * (solid is not None)
    for problem in problems:
        assert f"camera `{camera}` is inside {solid} at the start" in problem.message
        assert problem.severity == "warning"
        assert problem.place is not None
        assert problem.place.line is not None


def test_a_speed_that_the_joints_allow_nowhere_is_reported_where_it_stands(tmp_path: Path) -> None:
    shutil.copytree(TABLETOP.parents[1] / "skills", tmp_path / "skills")
    shutil.copytree(TABLETOP.parent, tmp_path / "workspaces")
    replace(
        tmp_path / "skills/pickup/skill.yaml", "straight_move: grasp, speed: 5 cm/s", "straight_move: grasp, speed: 3"
    )
    (problem,) = found(tmp_path / "workspaces" / "tabletop")
    assert problem.code == "unreachable-speed"
    assert "`a2` asks for a speed of 3 m/s" in problem.message
    assert problem.place is not None
    assert (problem.place.file.name, problem.place.line) == ("skill.yaml", 18)


def test_no_posture_moves_the_tool_faster_than_the_bound() -> None:
    model = Cell.load(load_workspace(TABLETOP)).model
    random = np.random.default_rng(0)
    postures = random.uniform(model.lower, model.upper, (2000, len(model.arm)))
    _, jacobians = model.tool_poses_and_jacobians(postures)
    signs = np.sign(random.uniform(-1, 1, (2000, len(model.arm), 1)))
    speeds = np.linalg.norm((jacobians[:, :3] @ (signs * model.velocity[:, None]))[..., 0], axis=1)
    assert 0.3 * fastest_tool(model) < speeds.max() < fastest_tool(model)
