"""Cells filled at random are valid, of the size asked for, and the same for a seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task
from tests.random_cell import Crowd, random_cell


@pytest.mark.parametrize("crowd", [Crowd(1, 9, 6), pytest.param(Crowd(3, 300, 30), marks=pytest.mark.trial)], ids=str)
def test_a_cell_is_valid_and_has_what_was_asked_for_and_each_camera_sees_a_cube(crowd: Crowd, tmp_path: Path) -> None:
    workspace = load_workspace(random_cell(tmp_path / "cell", crowd))
    again = random_cell(tmp_path / "again", crowd) / "workspace.yaml"
    assert again.read_bytes() == (tmp_path / "cell" / "workspace.yaml").read_bytes()
    cubes = np.array([item.X_WO[:3, 3] for item in workspace.objects.values() if item.type == "cube"])
    assert (len(cubes), len(workspace.cameras)) == (crowd.objects, crowd.cameras)
    assert len(workspace.tasks) == min(3, crowd.objects)
    assert not [one for one in lint(workspace) if one.severity == "error" or one.code == "floating-object"]
    cell = Cell.load(workspace)
    candidates = read_task(workspace.tasks[0].task, workspace).candidates[:5]
    motions = [feasible_motion(cell, candidate, workspace.stated_world) for candidate in candidates]
    assert not [m for m in motions if isinstance(m, Infeasible) and "before anything moves" in m.reasons[0]]
    places = np.array([thing.X_WO[:2, 3] for thing in workspace.objects.values() if thing.name != "table"])
    gaps = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert gaps.min() > 0.1
    for camera in workspace.cameras.values():
        rays = (cubes - camera.X_FC[:3, 3]) @ camera.X_FC[:3, :3]
        pixels = (rays @ camera.matrix.T)[:, :2] / rays[:, 2:]
        inside = (pixels > 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1) & (rays[:, 2] > 0)
        assert inside.any(), camera.name
