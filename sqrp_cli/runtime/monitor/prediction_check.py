"""Compares what the program predicted that cameras see with what their images showed."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Step
from sqrp_cli.runtime.monitor.nominal_step import NominalStep
from sqrp_cli.runtime.perception.detections import Detection
from sqrp_cli.runtime.record.report import Confusion, Disagreement, Prediction


class PredictionCheck:
    """Counts for one step, image by image. An atom counts as detected if the image alone gives its true value."""

    def __init__(self, index: int, nominal: NominalStep, cameras: Collection[str]) -> None:
        """index: of the step. cameras: names of all."""
        self._index, self._nominal = index, nominal
        atoms = nominal.step.targets
        self.counts: Prediction = {atom: {name: Confusion() for name in cameras} for atom in atoms}
        self.usual: Prediction = {atom: {name: Confusion() for name in cameras} for atom in atoms}
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
        for atom in atoms:
            target = step.targets[atom]
            seeing = sorted(
                responses[name] for name, spans in target.seen.items() if any(a <= t <= b for a, b in spans)
            )
            if len(seeing) < target.cameras:
                break
            slowest = max(slowest, seeing[target.cameras - 1])
        else:
            return t - x + slowest
    return None
