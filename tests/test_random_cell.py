"""Cells filled at random are valid, of the size asked for, and the same for a seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task
from tests.random_cell import Crowd, random_cell


def made(folder: Path, crowd: Crowd) -> Workspace:
    random_cell(folder, crowd)
    return load_workspace(folder)


@pytest.mark.parametrize(
    "crowd", [Crowd(1, 9, 4), Crowd(2, 1, 1), pytest.param(Crowd(3, 300, 30), marks=pytest.mark.trial)], ids=str
)
def test_a_cell_is_valid_and_has_what_was_asked_for(crowd: Crowd, tmp_path: Path) -> None:
    workspace = made(tmp_path / "cell", crowd)
    cubes = [thing for thing in workspace.objects.values() if thing.type == "cube"]
    assert (len(cubes), len(workspace.cameras)) == (crowd.objects, crowd.cameras)
    assert len(workspace.tasks) == min(3, crowd.objects)
    assert not [problem for problem in lint(workspace) if problem.severity == "error"]
    cell = Cell.load(workspace)
    candidates = read_task(workspace.tasks[0].task, workspace).candidates[:5]
    motions = [feasible_motion(cell, candidate, workspace.stated_world) for candidate in candidates]
    assert not [m for m in motions if isinstance(m, Infeasible) and "before anything moves" in m.reasons[0]]
    places = np.array([thing.X_WO[:2, 3] for thing in workspace.objects.values() if thing.name != "table"])
    gaps = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert gaps.min() > 0.1


def test_the_seed_decides(tmp_path: Path) -> None:
    texts = []
    for index, seed in enumerate((5, 5, 6)):
        made(tmp_path / str(index), Crowd(seed, 6, 3))
        texts.append((tmp_path / str(index) / "workspace.yaml").read_text(encoding="utf-8"))
    assert texts[0] == texts[1] != texts[2]


def test_the_table_grows_with_the_ring_on_which_things_stand(tmp_path: Path) -> None:
    findings = lint(made(tmp_path / "cell", Crowd(0, 400, 1)))
    assert "floating-object" not in [finding.code for finding in findings]


@pytest.mark.parametrize("seed", range(5))
def test_each_camera_has_a_cube_in_its_image(seed: int, tmp_path: Path) -> None:
    workspace = made(tmp_path / "cell", Crowd(seed, 1, 6))
    cubes = np.array([item.X_WO[:3, 3] for item in workspace.objects.values() if item.type == "cube"])
    for camera in workspace.cameras.values():
        rays = (cubes - camera.X_FC[:3, 3]) @ camera.X_FC[:3, :3]
        pixels = (rays @ camera.matrix.T)[:, :2] / rays[:, 2:]
        inside = (pixels > 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1) & (rays[:, 2] > 0)
        assert inside.any(), camera.name
