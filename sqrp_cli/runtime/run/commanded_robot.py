"""The robot as a run commands it: arm and tool. Only images show whether the tool really holds an object."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np

from sqrp_cli.knowledge.robot.robot import Fingers, Robot
from sqrp_cli.program.record import Program
from sqrp_cli.runtime.cell.interface import RunnableCell, StoppableReference
from sqrp_cli.runtime.run.arm_motion import ArmMotion

MOST_COMMANDS = 20
"""Most commands to the tool that are remembered."""


class PassingTime(Protocol):
    """A cell in which time passes."""

    def advance(self, t: float, reference: StoppableReference) -> float:
        """Let time pass until t [s] while the arm follows the reference; returns the time then [s]."""


class CommandedRobot:
    """Arm and tool of a cell."""

    def __init__(
        self,
        cell: RunnableCell,
        motion: ArmMotion,
        fingers: Fingers | None,
        passing_time: PassingTime | None = None,
        *,
        holding: bool,
    ) -> None:
        """fingers: of a gripper; the motion moves their joints. passing_time: lets time pass instead of the cell."""
        self.cell, self.motion, self.fingers = cell, motion, fingers
        self._time = passing_time or cell
        self._now = 0.0
        self._commands = deque([(-float("inf"), holding)], MOST_COMMANDS)

    @classmethod
    def at_the_start(
        cls, program: Program, robot: Robot, cell: RunnableCell, passing_time: PassingTime | None
    ) -> CommandedRobot:
        """The robot standing where a program begins."""
        before, joints = program.steps[0].before, program.joints
        q = np.array([before.joints[name] for name in joints])
        motion = ArmMotion(joints, [robot.limits[n] for n in joints], [robot.stop_limits[n] for n in joints], q)
        return cls(cell, motion, robot.fingers, passing_time, holding=before.held is not None)

    def advance(self, t: float) -> float:
        """Let time pass until t [s] while the arm follows its motion; returns the time then [s]."""
        self._now = self._time.advance(t, self.motion)
        return self._now

    @property
    def holding(self) -> bool:
        """Whether the tool was commanded to hold."""
        return self._commands[-1][1]

    @holding.setter
    def holding(self, holding: bool) -> None:
        self._commands.append((self._now, holding))

    def held_at(self, t: float) -> bool:
        """Whether the tool was commanded to hold at a time that is not long ago [s]."""
        return next((held for since, held in reversed(self._commands) if since <= t + 1e-9), self._commands[0][1])

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
