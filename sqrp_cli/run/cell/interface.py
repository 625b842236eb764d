"""The interface of any cell, simulated or real: what it is told, and what it tells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass
from sqrp_cli.run.arm_motion import ArmMotion, JointStates
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.record.report import Stopped


class ArmReference(Protocol):
    """The motion that the arm is to follow.

    Joints that it does not name keep their position; joints that mimic another one follow it.
    """

    @property
    def joints(self) -> Sequence[str]:
        """Names of the n joints that it moves: those of the arm, and the fingers of a gripper where it has some."""

    def states(self, t: Array) -> JointStates:
        """The joints at times t [s] of the cell's clock, (m,); shape (m, n) each."""


class RunnableCell(Protocol):
    """What a run commands and observes, on a clock of its own in seconds.

    Perception gets its images alone.
    """

    def advance(self, t: float, reference: ArmMotion) -> float:
        """Let time pass until t [s] while the arm follows the reference; returns the time then, which may be later."""

    def grasp(self) -> None:
        """Have the tool hold what is there."""

    def release(self) -> None:
        """Have the tool let go."""

    def tool_force(self) -> float:
        """How hard the tool, or what it holds, pushes against anything else [N]."""

    def frames(self, cameras: Sequence[str]) -> Mapping[str, CameraImage]:
        """An image of some cameras that was not given before, in the order of their names.

        A simulation takes it now; of a real camera it is the oldest that has come, and may be missing.
        """

    def measured_joints(self, t: float | None = None) -> Mapping[str, float]:
        """Position of every movable joint as its encoder says [rad or m], at a time [s] or now.

        A simulation is asked about now alone.
        """

    def trouble(self) -> Stopped | None:
        """Why nobody may go on with the motion; None while all is well."""

    def tracking_error(self) -> float | None:
        """Distance of the tool from where it should have been [m], root mean square; None if nobody measures it."""

    def truth(self) -> CellState | None:
        """The present ground truth of a simulation; None where nobody knows it."""


@dataclass(frozen=True, eq=False)
class CellState:
    """The ground truth of one moment: for injecting faults and for judging detections, never for perception."""

    t: float
    """On the cell's clock [s]."""
    X_WO: Mapping[str, Array]
    """Pose of every object in the world, shape (4, 4)."""
    held: str | None
    """The object in the tool, by weld or contact."""
    joints: Mapping[str, float]
    """Position of every movable joint of robot and tool [rad or m]."""
