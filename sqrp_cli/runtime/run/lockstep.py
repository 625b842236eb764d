"""Cell, cameras and perception on one clock: time passes from one event to the next, and nobody runs ahead."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from sqrp_cli.runtime.cell.interface import ArmReference
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.perception.evidence_buffer import Look
from sqrp_cli.runtime.perception.image_stream import Eyes
from sqrp_cli.runtime.record.events import Stopping
from sqrp_cli.runtime.record.publisher import Narrator
from sqrp_cli.runtime.run.arm_motion import Playback
from sqrp_cli.runtime.run.fault_ledger import TRUTH_SPACING, FaultLedger
from sqrp_cli.runtime.run.ground_truth import GroundTruth
from sqrp_cli.runtime.run.observation import Lookout
from sqrp_cli.runtime.run.tool import Tool


class Clockwork(Protocol):
    """A cell in which time passes."""

    def advance(self, t: float, reference: ArmReference) -> None:
        """Let time pass until t [s] while the arm follows the reference."""


@dataclass(frozen=True)
class Due:
    """Something to do at a time [s] of the cell's clock.

    kind: a command to the tool, the beginning of a primitive, or a fault to inject.
    """

    t: float
    kind: Literal["tool", "primitive", "fault"]
    do: Callable[[], None]


class Lockstep:
    """now: the time [s]. attempt: what the robot is at.

    stop_told, standing_since: when it was last told to stop, and stood [s]; None before.
    """

    def __init__(
        self,
        cell: Clockwork,
        playback: Playback,
        tool: Tool,
        eyes: Eyes,
        lookout: Lookout,
        truth: GroundTruth,
        ledger: FaultLedger,
        narrator: Narrator,
    ) -> None:
        self._cell, self._playback, self._tool, self._eyes = cell, playback, tool, eyes
        self._lookout, self._truth, self._ledger, self._narrator = lookout, truth, ledger, narrator
        self._due: list[Due] = []
        self.now = 0.0
        self.stop_told: float | None = None
        self.standing_since: float | None = None
        self.attempt: Attempt | None = None

    def schedule(self, due: Due) -> None:
        """Do something at its time, after what is due at the same time already."""
        insort(self._due, due, key=lambda one: one.t)

    def cancel(self, *kinds: str) -> None:
        """Do nothing of some kinds any more."""
        self._due = [due for due in self._due if due.kind not in kinds]

    def tau(self) -> float | None:
        """The time of the step's motion [s], None before it."""
        if self.attempt is None or self.attempt.start is None:
            return None
        return self._playback.step_time(self.now)

    def pass_time(self, end: float = float("inf")) -> list[Look]:
        """Let time pass until the next event, at most until `end` [s].

        Returns what is known by the images that have arrived. Raises Unwatched where cameras or the processes behind
        them fail.
        """
        self.now = self._next(end)
        with self._narrator.timed("physics"):
            self._cell.advance(self.now, self._playback)
        if self._ledger.is_pending and self.attempt is not None:
            self._ledger.look(self.now, self.tau(), self.attempt, self._truth.atoms(self.attempt))
        arrived = self._lookout.collect(self.now)
        while self._due and self._due[0].t <= self.now + 1e-9:
            self._due.pop(0).do()
        if self._eyes.next_exposure <= self.now + 1e-9 and self.attempt is not None:
            truths = self._truth.atoms(self.attempt)
            self._lookout.expose(self.now, self.tau(), truths, holding=self._tool.holding)
        if (failure := self._eyes.failure(self.now)) is not None:
            raise failure
        return self._lookout.take_notice(arrived, self.now)

    def stop(self, reason: str) -> None:
        """Bring the arm to rest along its path, looking on."""
        self._tell_stop(reason)
        stands = self._playback.stop(self.now)
        while self.now < stands - 1e-9:
            self.pass_time(stands)
        self.standing_since = self.now

    def halt(self, reason: str) -> None:
        """Bring the arm to rest along its path as fast as it may, whatever becomes of cameras and perception."""
        self._tell_stop(reason)
        self.now = max(self.now, self._playback.stop(self.now, protective=True))
        self._cell.advance(self.now, self._playback)
        self.standing_since = self.now

    def _tell_stop(self, reason: str) -> None:
        self.cancel("tool", "primitive")
        self.stop_told = self.now
        self._narrator.doing = "stops"
        self._narrator.publish(Stopping(t=self.now, reason=reason))

    def _next(self, end: float) -> float:
        """When the next event is [s]."""
        t = min(self._eyes.next_exposure, self._eyes.next_arrival, self._eyes.next_check)
        if self._due:
            t = min(t, self._due[0].t)
        if self.now < end - 1e-9:
            t = min(t, end)
        if self._ledger.is_pending:
            t = min(t, self.now + TRUTH_SPACING)
        return max(t, self.now)
