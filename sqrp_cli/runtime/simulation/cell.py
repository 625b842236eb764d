"""A cell in MuJoCo that can be moved, looked at through its cameras and made to fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.workspace import Workspace, World
from sqrp_cli.runtime.frame import Frame


class Reference(Protocol):
    """The motion that the arm is to follow.

    joints: names of the joints that it moves: those of the arm, and the fingers of a gripper where it has some.
    Joints that it does not name keep their position; joints that mimic another one follow it.
    """

    @property
    def joints(self) -> Sequence[str]:
        """Names of the joints, n of them."""

    def state(self, t: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at time t [s] of the cell's clock, shape (n,) each [rad or m, s]."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What really is so at one moment: for injecting faults and for judging what was detected, never for perception.

    X_WO: pose of every object in the world, shape (4, 4). held: the object in the tool, by weld or contact.
    joints: position of every movable joint of robot and tool [rad or m].
    """

    t: float
    X_WO: Mapping[str, Array]
    held: str | None
    joints: Mapping[str, float]


class SimulatedCell:
    """A cell in simulated time; a context manager, as it holds processes that draw.

    The same workspace, world, seed and calls give the same bytes again.
    """

    @classmethod
    def build(cls, workspace: Workspace, world: World, seed: int) -> SimulatedCell:
        """The cell at rest in a world, at t = 0; an object of unknown pose is not in it. seed: of the image noise.

        Raises InputError without the extra `sim`, without OpenGL (with the command that installs it), and for a mesh
        that cannot be used.
        """
        raise NotImplementedError

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        raise NotImplementedError

    def advance(self, t: float, reference: Reference) -> None:
        """Let time pass until t [s] while the controller follows the reference as far as torque limits allow."""
        raise NotImplementedError

    def grasp(self) -> None:
        """Switch suction on, or close the fingers with a force: what is there is held, if anything is.

        Suction takes the object whose surface is within 3 mm of the cup, at once; fingers hold by friction, once they
        have closed (some 0.2 s).
        """
        raise NotImplementedError

    def release(self) -> None:
        """Switch suction off, or let the fingers follow the reference again."""
        raise NotImplementedError

    def slip(self) -> None:
        """Lose the hold: the cup leaks, or the fingers loosen. What was held falls. Nothing happens if nothing is."""
        raise NotImplementedError

    def miss_next_grasp(self) -> None:
        """Let the next `grasp` do nothing."""
        raise NotImplementedError

    def frames(self, cameras: Sequence[str]) -> Mapping[str, Frame]:
        """An image of each camera as things now are, by name."""
        raise NotImplementedError

    def measured_joints(self) -> Mapping[str, float]:
        """Position of every movable joint of robot and tool as its encoder says [rad or m]."""
        raise NotImplementedError

    def truth(self) -> Truth:
        """What really is so now."""
        raise NotImplementedError

    def tracking_error(self) -> float:
        """Distance of the tool frame from where the reference wanted it [m], root mean square over all steps so far."""
        raise NotImplementedError

    def close(self) -> None:
        """End the processes that draw."""

    def __enter__(self) -> SimulatedCell:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
