"""Cell, cameras and perception on one clock: time passes from one event to the next, for all together."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.perception.evidence_buffer import Evidence
from sqrp_cli.runtime.record.events import ContactFelt, EventPublisher, Stopping
from sqrp_cli.runtime.record.report import TRUTH_SPACING
from sqrp_cli.runtime.run.commanded_robot import CommandedRobot
from sqrp_cli.runtime.run.evidence_collector import EvidenceCollector, Moment
from sqrp_cli.runtime.run.fault_tracker import FaultTracker
from sqrp_cli.runtime.run.ground_truth import Truths

FEELING = 0.004
"""Time between looks at the force of a guarded move [s]."""

SAME_INSTANT = 0.0015
"""Times that are closer are one [s]: the simulation steps by 2 ms, and takes images at the nearest step."""


@dataclass(frozen=True)
class Due:
    """Something to do at a time [s] of the cell's clock."""

    t: float
    kind: Literal["tool", "primitive", "fault"]
    """A command to the tool, the beginning of a primitive, or a fault to inject."""
    do: Callable[[], None]


class Lockstep:
    """Everything of a run that time passes for."""

    def __init__(
        self,
        robot: CommandedRobot,
        collector: EvidenceCollector,
        faults: FaultTracker,
        truth: Truths,
        publisher: EventPublisher,
    ) -> None:
        self.robot, self.collector, self.faults, self.publisher = robot, collector, faults, publisher
        self._truth = truth
        self._due: list[Due] = []
        self.now = 0.0
        """The time on the cell's clock [s]."""
        self.attempt: Attempt | None = None
        """What the robot is at."""
        self.stop_told: float | None = None
        """When it was last commanded to stop [s]; None before."""
        self.standing_since: float | None = None
        """When it stood after that [s]; None before."""

    def schedule(self, due: Due) -> None:
        """Do something at its time, after what is due at the same time already."""
        insort(self._due, due, key=lambda one: one.t)

    def cancel(self, *kinds: str) -> None:
        """Do nothing of some kinds any more."""
        self._due = [due for due in self._due if due.kind not in kinds]

    def tau(self, t: float | None = None) -> float | None:
        """The time of the step's motion at time t or now [s], None before it."""
        if self.attempt is None or self.attempt.start is None:
            return None
        return self.robot.motion.step_time(self.now if t is None else t)

    def _moment(self, t: float) -> Moment:
        """What is known of the time of an image [s]; the clock of a simulation steps from time to time."""
        assert self.attempt is not None  # noqa: S101 - images are looked at in attempts alone
        at = self.now if abs(t - self.now) < SAME_INSTANT else t
        tau = self.tau(at)
        return Moment(tau, self._truth.atoms(self.attempt, tau), self.robot.held_at(at))

    def catch_up(self) -> None:
        """In a real cell time has passed while nobody looked, such as for planning: go on from now."""
        self.now = self.collector.streams.resume(self.now)

    @property
    def present(self) -> float:
        """When what is commanded now begins [s]."""
        return self.collector.streams.present(self.now)

    def pass_time(self, end: float = float("inf")) -> list[Evidence]:
        """Let time pass until the next event, at most until `end` [s].

        Returns the evidence of the images that have arrived. Raises MonitoringLost where cameras or the processes
        behind them fail.
        """
        self.now = self._next(end)
        with self.publisher.timed("physics"):
            self.now = self.robot.advance(self.now)
        self._feel()
        if self.faults.is_pending and self.attempt is not None:
            self.faults.look(self.now, self.tau(), self.attempt, self._truth.atoms(self.attempt, self.tau()))
        arrived = self.collector.collect(self.now)
        while self._due and self._due[0].t <= self.now + 1e-9:
            self._due.pop(0).do()
        if self.collector.streams.next_exposure <= self.now + 1e-9 and self.attempt is not None:
            self.collector.expose(self.now, self._moment)
        if (failure := self.robot.cell.trouble() or self.collector.streams.failure(self.now)) is not None:
            raise failure
        return self.collector.take_notice(arrived, self.now)

    def _feel(self) -> None:
        """End a guarded move that meets what it looks for."""
        limit = self.robot.motion.force_limit(self.now)
        if limit is not None and (force := self.robot.cell.tool_force()) >= limit:
            self.robot.motion.halt_primitive(self.now)
            self.publisher.publish(ContactFelt(t=self.now, force=round(force, 1)))

    def stop(self, reason: str) -> None:
        """Bring the arm to rest along its path, looking on."""
        self._command_stop(reason)
        stands = self.robot.motion.stop(self.now)
        while self.now < stands - 1e-9:
            self.pass_time(stands)
        self.standing_since = self.now

    def halt(self, reason: str) -> None:
        """Bring the arm to rest along its path as fast as it may, whatever becomes of cameras and perception."""
        self._command_stop(reason)
        self.now = max(self.now, self.robot.motion.stop(self.now, protective=True))
        self.now = self.robot.advance(self.now)
        self.standing_since = self.now

    def _command_stop(self, reason: str) -> None:
        self.cancel("tool", "primitive")
        self.now = self.stop_told = self.present
        self.publisher.doing = "stops"
        self.publisher.publish(Stopping(t=self.now, reason=reason))

    def _next(self, end: float) -> float:
        """When the next event is [s]."""
        streams = self.collector.streams
        t = min(streams.next_exposure, streams.next_arrival, streams.next_check)
        if self._due:
            t = min(t, self._due[0].t)
        if self.now < end - 1e-9:
            t = min(t, end)
        if self.faults.is_pending:
            t = min(t, self.now + TRUTH_SPACING)
        if self.robot.motion.force_limit(self.now) is not None:
            t = min(t, self.now + FEELING)
        return max(t, self.now)
