"""What a simulated arm is told to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from sqrp_cli.geometry import Array


class Reference(Protocol):
    """The motion that the arm is to follow.

    joints: names of the joints that it moves: those of the arm, and the fingers of a gripper where it has some.
    Joints that it does not name keep their position; joints that mimic another one follow it.
    """

    @property
    def joints(self) -> Sequence[str]:
        """Names of the joints, n of them."""

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at times t [s] of the cell's clock, (m,); shape (m, n) each.

        Units: rad or m, and s.
        """
