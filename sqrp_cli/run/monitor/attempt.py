"""One attempt at a step: its motion, its expected course and progress, and whether cameras see it as predicted."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import field
from functools import cached_property

from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.nominal_step import NominalStep, values_when_open
from sqrp_cli.run.monitor.step_monitor import Alarm, StepMonitor
from sqrp_cli.run.perception.detections import Detection, DetectionTargets
from sqrp_cli.run.perception.evidence_buffer import Evidence
from sqrp_cli.run.record.report import Confusion, Disagreement


class PredictionCheck:
    """Counts for one step, image by image, whether cameras see what the program predicted.

    An atom counts as detected if the image alone gives its true value.
    """

    def __init__(self, index: int, nominal: NominalStep, cameras: Collection[str]) -> None:
        """index: of the step. cameras: names of all."""
        self._index, self._nominal = index, nominal
        self.counts, self.usual = (
            {atom: {name: Confusion() for name in cameras} for atom in nominal.step.targets} for _ in range(2)
        )
        """By atom and camera, of all images and of those that were not predicted to show the atom."""
        self.disagreements: list[Disagreement] = []

    def add(self, detection: Detection, t: float, atoms: Collection[str], truths: Mapping[str, bool]) -> None:
        """Count an image taken at time t [s] of the step, for the atoms that count then, with their true values."""
        for atom in atoms:
            predicted = detection.camera in self._nominal.covering(atom, t)
            usual = not predicted and self._nominal.usually_shows(atom, detection.camera, t, value=truths[atom])
            seen = detection.truth(atom)
            detected = seen == (Truth.TRUE if truths[atom] else Truth.FALSE)
            self.counts[atom][detection.camera].add(predicted, detected)
            if not predicted:
                self.usual[atom][detection.camera].add(usual, detected)
            if predicted != detected:
                self.disagreements.append(
                    Disagreement(
                        step=self._index,
                        t=round(t, 6),
                        atom=atom,
                        camera=detection.camera,
                        predicted=predicted,
                        seen=seen.word,
                        true=truths[atom],
                        share=round(detection.share(atom), 3),
                        because=detection.miss_reason(atom).value if predicted else "",
                        usual=usual,
                    )
                )


def predicted_delay(step: Step, atoms: Collection[str], responses: Mapping[str, float], x: float) -> float | None:
    """Time from a fault at time x [s] of a step until it is seen; None if it never is.

    atoms: that decide the fault; responses: of each camera [s]. First all atoms must be covered at once, then comes one
    frame period and the latency of the k-th fastest camera of the slowest atom.
    """
    edges = sorted({x, *(start for atom in atoms for s in step.targets[atom].seen.values() for start, _ in s)})
    for t in (edge for edge in edges if edge >= x):
        slowest = 0.0
        for target in (step.targets[atom] for atom in atoms):
            covering = [name for name, spans in target.seen.items() if any(a <= t <= b for a, b in spans)]
            if len(covering) < target.cameras:
                break
            slowest = max(slowest, sorted(responses[name] for name in covering)[target.cameras - 1])
        else:
            return t - x + slowest
    return None


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

    @cached_property
    def when_open(self) -> Mapping[str, bool]:
        """The value of each atom while the fingers of a gripper are open."""
        return values_when_open(self.step)

    @property
    def sought(self) -> DetectionTargets:
        """What to look for."""
        return DetectionTargets(dict(self.step.targets), self.step.before.X_WO, self.when_open)

    def beliefs(self, tau: float | None) -> Mapping[str, Array]:
        """Where objects are believed to be at a time of the step [s], (4, 4) each."""
        return self.nominal.object_poses(0.0 if self.failed else tau or 0.0)

    def counts(self, tau: float) -> bool:
        """Whether an image taken at a time of the step [s] counts in the check of predictions."""
        return self.undisturbed and 0.0 <= tau <= self.step.time

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
