"""The tool as the robot commands it; whether it really holds something, only images tell."""

from __future__ import annotations

from sqrp_cli.knowledge.robot.robot import Fingers
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.run.arm_motion import Playback


class Tool:
    """holding: whether it was told to hold."""

    def __init__(self, cell: SimulatedCell, playback: Playback, fingers: Fingers | None, *, holding: bool) -> None:
        """fingers: of a gripper, whose joints the playback moves."""
        self._cell, self._playback, self.fingers = cell, playback, fingers
        self.holding = holding

    def grasp(self) -> None:
        """Hold what is there."""
        self._cell.grasp()
        self.holding = True

    def release(self) -> None:
        """Begin to let go: fingers follow their motion again, suction is off."""
        self._cell.release()

    def released(self) -> None:
        """Count as empty from now on."""
        self.holding = False

    def let_go(self) -> None:
        """Let go at once, whatever the motion wants of the fingers."""
        self.release()
        self.released()
        if self.fingers is not None:
            self._playback.place(self.fingers.open)

    def keep(self, t: float) -> None:
        """Leave the fingers as they are wanted at time t [s], whatever the rest of the motion does with them."""
        if self.fingers is not None:
            self._playback.keep(self.fingers.open.keys(), t)
