"""The robot as a run commands it: arm and tool. Only images show whether the tool really holds an object."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from sqrp_cli.knowledge.robot.robot import Fingers, Robot
from sqrp_cli.program.record import Program
from sqrp_cli.runtime.cell.interface import ArmReference
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.run.arm_motion import ArmMotion


class PassingTime(Protocol):
    """A cell in which time passes."""

    def advance(self, t: float, reference: ArmReference) -> None:
        """Let time pass until t [s] while the arm follows the reference."""


class CommandedRobot:
    """Arm and tool of a cell."""

    def __init__(
        self,
        cell: SimulatedCell,
        motion: ArmMotion,
        fingers: Fingers | None,
        passing_time: PassingTime | None = None,
        *,
        holding: bool,
    ) -> None:
        """fingers: of a gripper; the motion moves their joints. passing_time: lets time pass instead of the cell."""
        self.cell, self.motion, self.fingers = cell, motion, fingers
        self._time = passing_time or cell
        self.holding = holding
        """Whether the tool was commanded to hold."""

    @classmethod
    def at_the_start(
        cls, program: Program, robot: Robot, cell: SimulatedCell, passing_time: PassingTime | None
    ) -> CommandedRobot:
        """The robot standing where a program begins."""
        before, joints = program.steps[0].before, program.joints
        q = np.array([before.joints[name] for name in joints])
        motion = ArmMotion(joints, [robot.limits[n] for n in joints], [robot.stop_limits[n] for n in joints], q)
        return cls(cell, motion, robot.fingers, passing_time, holding=before.held is not None)

    def advance(self, t: float) -> None:
        """Let time pass until t [s] while the arm follows its motion."""
        self._time.advance(t, self.motion)

    def grasp(self) -> None:
        """Hold what is there."""
        self.cell.grasp()
        self.holding = True

    def release(self) -> None:
        """Begin to let go: fingers follow their motion again, suction is off."""
        self.cell.release()

    def released(self) -> None:
        """Count as empty from now on."""
        self.holding = False

    def let_go(self) -> None:
        """Let go at once, whatever the motion wants of the fingers."""
        self.release()
        self.released()
        if self.fingers is not None:
            self.motion.place(self.fingers.open)

    def keep_fingers(self, t: float) -> None:
        """Leave the fingers as they are wanted at time t [s], whatever the rest of the motion does with them."""
        if self.fingers is not None:
            self.motion.keep(self.fingers.open.keys(), t)
