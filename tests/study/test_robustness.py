from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import inverse
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.observer import Observer
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.robustness import DRAWS, Calibration, perturbed, under_calibration_errors, without_each_camera
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

SAMPLING = FixedCount(12)


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


@pytest.fixture(scope="module")
def found(cell: Cell) -> Analysis:
    candidate = read_task("pickup g4", cell.workspace).candidates[0]
    result = analyse(cell, candidate, cell.initial_world, SAMPLING, full=True)
    assert isinstance(result, Analysis)
    return result


def test_a_failed_camera_leaves_the_qualities_of_a_cell_without_it(cell: Cell, found: Analysis) -> None:
    told = without_each_camera(cell, found)
    for index, camera in enumerate(cell.observer.cameras):
        others = cell.observer.cameras[:index] + cell.observer.cameras[index + 1 :]
        smaller = dataclasses.replace(cell, observer=Observer(others, cell.observer.solids))
        again = analyse(smaller, found.planned.candidate, cell.initial_world, SAMPLING, full=False)
        assert isinstance(again, Analysis)
        assert told[camera.name] == again.timeline.qualities
    now = found.timeline.qualities
    assert all(left.q_avg <= now.q_avg and left.q_eoi <= now.q_eoi for left in told.values())
    assert any(left.q_eoi < now.q_eoi for left in told.values()), "some cameras are needed"


def test_draws_are_seeded_and_an_exact_calibration_changes_nothing(cell: Cell, found: Analysis) -> None:
    one, again, other, exact = (
        under_calibration_errors(cell, found, SAMPLING, Calibration(spread, spread, seed))
        for spread, seed in ((0.02, 1), (0.02, 1), (0.02, 2), (0.0, 0))
    )
    assert one == again != other
    assert exact == (found.timeline.qualities,) * DRAWS


def test_the_errors_have_the_stated_spread(cell: Cell) -> None:
    calibration = Calibration(position=0.005, rotation=0.01, seed=3)
    moved, turned = [], []
    for draw in range(200):
        cameras = perturbed(cell.observer, calibration, draw).cameras
        for before, after in zip(cell.observer.cameras, cameras, strict=True):
            X_CE = inverse(before.X_FC) @ after.X_FC
            moved.append(X_CE[:3, 3])
            turned.append(np.array([X_CE[2, 1], X_CE[0, 2], X_CE[1, 0]]))
    assert np.std(moved, axis=0) == pytest.approx(0.005, rel=0.1)
    assert np.std(turned, axis=0) == pytest.approx(0.01, rel=0.1)
    assert np.abs(np.mean(moved, axis=0)).max() < 0.001
