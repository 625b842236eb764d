"""The interface of any cell: the motion to follow, and its state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from sqrp_cli.geometry import Array


class JointStates(NamedTuple):
    """Where joints are, and how they move."""

    positions: Array
    """[rad or m]."""
    velocities: Array
    """[rad/s or m/s]."""
    accelerations: Array
    """[rad/s^2 or m/s^2]."""


class ArmReference(Protocol):
    """The motion that the arm is to follow.

    Joints that it does not name keep their position; joints that mimic another one follow it.
    """

    @property
    def joints(self) -> Sequence[str]:
        """Names of the n joints that it moves: those of the arm, and the fingers of a gripper where it has some."""

    def states(self, t: Array) -> JointStates:
        """The joints at times t [s] of the cell's clock, (m,); shape (m, n) each."""


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
