"""The paper's findings come out of the pipeline; each test is named after one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.sensing.observer import Observer
from tests.reproduction.findings import REAL, SIMULATED, Finding, failing
from tests.reproduction.layout_search import displaced
from tests.reproduction.screws import Screws, pick_screws, screws_cell
from tests.reproduction.simulation import Simulation, simulate, tabletop

DRAWS = 20


@pytest.fixture(scope="module")
def simulated() -> Simulation:
    return simulate(tabletop())


@pytest.fixture(scope="module")
def real() -> Screws:
    return pick_screws(screws_cell())


@pytest.mark.parametrize("finding", SIMULATED, ids=lambda finding: finding.text)
def test_in_simulation(finding: Finding[Simulation], simulated: Simulation) -> None:
    assert finding.holds(simulated), f"no longer so: {finding.text}"


@pytest.mark.parametrize("finding", REAL, ids=lambda finding: finding.text)
def test_in_the_real_world(finding: Finding[Screws], real: Screws) -> None:
    assert finding.holds(real), f"no longer so: {finding.text}"


def moved(cell: Cell, draw: int) -> Cell:
    """The cell with every camera moved by 2 mm and turned by 0.2 degrees at random."""
    random = np.random.default_rng(draw)
    cameras = tuple(displaced(camera, random) for camera in cell.observer.cameras)
    return replace(cell, observer=Observer(cameras, cell.observer.solids))


def test_the_findings_in_simulation_survive_inexact_cameras() -> None:
    cell = tabletop()
    lost = [failing(SIMULATED, simulate(moved(cell, draw))) for draw in range(DRAWS)]
    assert sum(not texts for texts in lost) >= 18, lost


def test_the_findings_in_the_real_world_survive_inexact_cameras() -> None:
    cell = screws_cell()
    lost = [failing(REAL, pick_screws(moved(cell, draw))) for draw in range(DRAWS)]
    assert sum(not texts for texts in lost) >= 18, lost
