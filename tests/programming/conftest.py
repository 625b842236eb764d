"""The UR5 of the tabletop workspace, for tests that move it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"


@pytest.fixture(scope="session")
def tabletop() -> Workspace:
    return load_workspace(TABLETOP)


@pytest.fixture(scope="session")
def ur5(tabletop: Workspace) -> RobotModel:
    return RobotModel.load(tabletop.robot)
