"""Injects faults, and tracks each: when it happened, was seen, was acted on and mended."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from sqrp_cli.logic.literal import Literal
from sqrp_cli.program.record import Step
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.prediction_check import predicted_delay
from sqrp_cli.runtime.monitor.step_monitor import Alarm
from sqrp_cli.runtime.perception.image_stream import ImageStreams, Streams
from sqrp_cli.runtime.record.events import EventPublisher, FaultHappened, FaultInjected, FaultSeen
from sqrp_cli.runtime.record.report import FaultRecord, MonitoringLost
from sqrp_cli.runtime.run.injected_fault import InjectedFault

PHYSICAL = ("slip", "miss-pick")
"""Faults of the step; the others are faults of cameras."""


MakeHappen = Callable[[InjectedFault], None]
"""Lets a fault happen."""


def in_simulation(cell: SimulatedCell, streams: ImageStreams) -> MakeHappen:
    """Lets faults happen to a simulated cell and the images of its cameras."""

    def make_happen(fault: InjectedFault) -> None:
        camera = fault.camera or ""
        match fault.kind:
            case "slip":
                cell.slip()
            case "miss-pick":
                cell.miss_next_grasp()
            case "camera-loss":
                streams.lose(camera)
            case "frozen":
                streams.freeze(camera)
            case "latency":
                streams.delay(camera, fault.delay)
            case "perception-crash":
                streams.crash(camera)

    return make_happen


class FaultTracker:
    """The faults of a run."""

    def __init__(self, make_happen: MakeHappen, streams: Streams, publisher: EventPublisher) -> None:
        """make_happen: lets a fault happen to the cell."""
        self._make_happen, self._streams, self._publisher = make_happen, streams, publisher
        self.records: list[FaultRecord] = []
        """Of all, in the order in which they were injected or seen."""
        self._open: list[FaultRecord] = []
        self._of_cameras: list[FaultRecord] = []

    def inject(self, fault: InjectedFault, t: float, attempt: Attempt) -> None:
        """Inject a fault."""
        self._make_happen(fault)
        record = FaultRecord(_name(fault, attempt), injected=t, camera=fault.camera, kind=fault.kind)
        self.records.append(record)
        if fault.kind in PHYSICAL:
            self._open.append(record)
            attempt.undisturbed &= fault.kind == "miss-pick"  # which changes nothing until the grasp
        else:
            self._of_cameras.append(record)
        self._publisher.publish(FaultInjected(t=t, fault=fault.text))

    @property
    def is_open(self) -> bool:
        """Whether a fault of the step has been injected or seen, and not been made good."""
        return bool(self._open)

    @property
    def is_pending(self) -> bool:
        """Whether a fault was injected that has not come true yet."""
        return any(record.injected is not None and record.happened is None for record in self._open)

    def look(self, t: float, tau: float | None, attempt: Attempt, truths: Mapping[str, bool]) -> None:
        """Note if the formula of a fault is true at time tau [s] of the step; truths: of all atoms now."""
        if tau is None:
            return
        for name, operators in attempt.monitor.faults():
            for start, end, literals in operators:
                if start <= tau <= end and all(truths[str(lit.atom)] == lit.positive for lit in literals):
                    self._came_true(t, self._predicted(attempt.step, name, literals, tau))
                    return

    def _predicted(self, step: Step, fault: str, literals: Sequence[Literal], tau: float) -> float | None:
        """How long after time tau [s] of a step a fault is noticed at the latest, as the step predicts it."""
        if (sight := step.sights.get(fault)) is not None:
            return sight.latest(tau)
        responses = {name: camera.response for name, camera in self._streams.cameras.items()}
        return predicted_delay(step, [str(literal.atom) for literal in literals], responses, tau)

    def _came_true(self, t: float, delay: float | None) -> None:
        for record in self._open:
            if record.happened is None:
                record.happened, record.predicted_delay = t, delay
                self._publisher.publish(FaultHappened(t=t, fault=record.name))

    def seen(self, alarm: Alarm, t: float) -> None:
        """The images showed a fault: the injected ones that are not seen yet, or one that was not injected."""
        unseen = [record for record in self._open if record.detected is None]
        if not unseen:
            unseen = [FaultRecord(alarm.name)]
            self.records += unseen
            self._open += unseen
        for record in unseen:
            record.name, record.detected = alarm.name, t
        self._publisher.publish(FaultSeen(t=t, name=alarm.name, text=alarm.text, response=alarm.response.action))

    def suspected(self, t: float) -> None:
        """The images showed that something is wrong, but not what."""
        for record in self._open:
            record.detected = t if record.detected is None else record.detected

    def moved_on(self, seconds: float) -> None:
        """The robot moved on for a time [s], to where the condition of a retry can be seen."""
        for record in self._seen():
            record.moved_on = round(seconds, 6)

    def acted(self, t: float) -> None:
        """The robot responds to the seen fault."""
        for record in self._seen():
            record.acted = t

    def recovered(self, t: float) -> None:
        """The step is finally done."""
        for record in self._seen():
            record.recovered = t
        self._open.clear()

    def stopped(self, t: float, failure: MonitoringLost | None) -> None:
        """The robot stops for good; failure: of the cameras that watch, if that is why."""
        for record in self._seen():
            record.acted = t if record.acted is None else record.acted
        for record in self._of_cameras:
            if failure is not None and record.name == failure.fault and record.camera in failure.cameras:
                record.detected = record.acted = t

    def _seen(self) -> list[FaultRecord]:
        return [record for record in self._open if record.detected is not None]


def _name(fault: InjectedFault, attempt: Attempt) -> str:
    """The skill's own name for what is injected, if it has one."""
    names = [entry.fault for entry in attempt.step.formulas if entry.fault is not None]
    return names[0] if fault.kind in PHYSICAL and len(names) == 1 else fault.kind
