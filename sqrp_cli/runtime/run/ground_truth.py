"""What really is so in the cell: for injecting faults and for judging what was detected, never for perception."""

from __future__ import annotations

from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.nominal_step import Situation, holds
from sqrp_cli.runtime.robot_body import OPEN_SHARE, RobotBody


class GroundTruth:
    """Values of atoms by the state of the simulation."""

    def __init__(self, cell: SimulatedCell, robot: RobotBody) -> None:
        self._cell, self._robot = cell, robot

    def atoms(self, attempt: Attempt) -> dict[str, bool]:
        """The value that each atom which an attempt asks about now has."""
        truth = self._cell.truth()
        is_open = self._robot.closure(truth.joints) <= OPEN_SHARE
        situation = Situation(self._robot.link_poses(truth.joints), truth.X_WO, attempt.starts, truth.held, is_open)
        return {
            atom: holds(atom, target, situation, when_open=attempt.when_open[atom])
            for atom, target in attempt.step.targets.items()
        }
