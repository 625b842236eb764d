"""One attempt at a step: its motion, its expected course, and its progress."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Step
from sqrp_cli.runtime.monitor.nominal_step import NominalStep, values_when_open
from sqrp_cli.runtime.monitor.prediction_check import PredictionCheck
from sqrp_cli.runtime.monitor.step_monitor import Alarm, StepMonitor
from sqrp_cli.runtime.perception.detections import DetectionTargets
from sqrp_cli.runtime.perception.evidence_buffer import Evidence


@dataclass(eq=False)
class Attempt:
    """One attempt at a step."""

    step: Step
    nominal: NominalStep
    monitor: StepMonitor
    check: PredictionCheck
    undisturbed: bool
    """Whether all goes as the program planned, so that its images count in the check of predictions."""
    start: float | None = None
    """When its motion began on the cell's clock [s], None before it."""
    failed: bool = False
    """Whether a fault was seen, so that objects are believed to be where they were before."""
    last_shown: dict[str, float] = field(default_factory=dict)
    """When the last image was taken that showed an atom's value [s]."""

    @property
    def end(self) -> float:
        """When its motion is over on the cell's clock [s]; infinite before it."""
        return float("inf") if self.start is None else self.start + self.step.time

    @property
    def starts(self) -> Mapping[str, Array]:
        """Pose of each object when the step began, (4, 4)."""
        return self.step.before.X_WO

    @cached_property
    def when_open(self) -> Mapping[str, bool]:
        """The value of each atom while the fingers of a gripper are open."""
        return values_when_open(self.step)

    @property
    def sought(self) -> DetectionTargets:
        """What to look for."""
        return DetectionTargets(dict(self.step.targets), self.starts, self.when_open)

    def beliefs(self, tau: float | None) -> Mapping[str, Array]:
        """Where objects are believed to be at a time of the step [s], (4, 4) each."""
        return self.nominal.object_poses(0.0 if self.failed else tau or 0.0)

    def counts(self, tau: float | None) -> bool:
        """Whether an image taken at a time of the step [s] counts in the check of predictions."""
        return self.undisturbed and tau is not None and 0.0 <= tau <= self.step.time

    @property
    def unseen(self) -> Mapping[str, float | None]:
        """Atoms required at the end of the motion that no image showed from then on, with when one last did [s]."""
        required, last = self.monitor.monitored(self.step.time), self.last_shown
        return {atom: last.get(atom) for atom in required if last.get(atom, 0.0) < self.end - 1e-9}

    def note(self, evidence: Evidence) -> None:
        """Remember what complete evidence showed."""
        self.last_shown.update({atom: evidence.t for atom, value in evidence.values.items() if value != Truth.UNKNOWN})

    def alarms(self, arrived: Iterable[Evidence]) -> Iterator[Alarm]:
        """What calls for a response in the motion, first by what is known completely, then by what is there of more.

        arrived: in order of time, complete evidence first.
        """
        ahead = []
        for evidence in arrived:
            tau = evidence.exposure.tau
            if tau is None or not 0.0 <= tau <= self.step.time or evidence.t > self.end + 1e-9:
                continue
            if not evidence.complete:
                ahead.append((tau, evidence.values))
                continue
            self.note(evidence)
            if (alarm := self.monitor.observe(tau, evidence.values)) is not None:
                yield alarm
        while ahead and (alarm := self.monitor.anticipate(ahead)) is not None:
            yield alarm
