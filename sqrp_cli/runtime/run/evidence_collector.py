"""The observer of a run: has images taken and looked at, and knows what they show of each atom."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.cell.interface import RunnableCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.perception.detections import BelievedState, Detection
from sqrp_cli.runtime.perception.evidence_buffer import Evidence, EvidenceBuffer, Exposure, FusedTruth
from sqrp_cli.runtime.perception.image_stream import Streams
from sqrp_cli.runtime.record.events import EventPublisher, EvidenceSeen, ShownAtom
from sqrp_cli.runtime.record.film import ImageRecorder


class Moment(NamedTuple):
    """What a run knows of a time."""

    tau: float | None
    """Of the step's motion [s], None before it."""
    truths: Mapping[str, bool]
    """The true values of all atoms; in a real cell, the planned ones."""
    holding: bool
    """Whether the tool was commanded to hold."""


class EvidenceCollector:
    """What all cameras together show of the attempt that is watched."""

    def __init__(
        self, cell: RunnableCell, streams: Streams, publisher: EventPublisher, recorder: ImageRecorder | None = None
    ) -> None:
        """recorder: takes every image with what was seen in it, if images are to be kept."""
        self._cell, self.streams = cell, streams
        self._publisher, self._recorder = publisher, recorder
        self._buffer = EvidenceBuffer(streams.cameras)
        self._attempt: Attempt | None = None
        self._number = 0
        self.conflicts = 0
        """How often cameras contradicted each other about an atom."""
        self.forget(0.0)

    @property
    def values(self) -> dict[str, Truth]:
        """What is known of each atom: the newest that any images show, none older than the last complete evidence."""
        return dict(self._values)

    @property
    def caught_up(self) -> bool:
        """Whether the images of all cameras of some exposure since `forget` are there."""
        return bool(self._complete)

    @property
    def places(self) -> dict[str, Array]:
        """Where objects were located since `forget`, (3,) each [m]: the median over the images."""
        return {name: np.median(found, axis=0) for name, found in self._places.items()}

    def watch(self, attempt: Attempt, number: int, t: float) -> None:
        """Look for the atoms of an attempt at the step with that number, in images from time t [s] on."""
        self._attempt, self._number = attempt, number
        self.streams.watch(attempt.sought)
        self.forget(t)

    def forget(self, t: float) -> None:
        """Go by images that are taken from time t [s] on, and by nothing that was known before."""
        self._buffer.forget(t)
        self._values: dict[str, Truth] = {}
        self._complete: dict[str, Truth] = {}
        self._published: dict[float, Mapping[str, FusedTruth]] = {}
        self._places: dict[str, list[Array]] = {}

    def expose(self, t: float, moment_at: Callable[[float], Moment]) -> None:
        """Take the images that are due at time t [s]. moment_at: what the run knows of a time [s].

        Raises MonitoringLost if a process that looks at them has ended.
        """
        attempt = self._watched()
        moment_at = cache(moment_at)

        def believed(at: float) -> BelievedState:
            moment = moment_at(at)
            return BelievedState(dict(self._cell.measured_joints(at)), moment.holding, attempt.beliefs(moment.tau))

        with self._publisher.timed("images"):
            images = self.streams.expose(t, self._cell.frames, believed)
        for at, together in groupby(images, lambda image: image.t):
            moment, taken = moment_at(at), list(together)
            self._buffer.take(Exposure(at, moment.tau, moment.truths, dict.fromkeys(image.camera for image in taken)))
            for image in taken:
                if self._recorder is not None:
                    planned = moment.tau if attempt.undisturbed else None
                    self._recorder.add(image, self._number, planned, self._publisher.doing)

    def collect(self, t: float) -> list[Detection]:
        """The images that have arrived by time t [s], looked at. Raises MonitoringLost if some are not."""
        if self.streams.next_arrival > t + 1e-9:
            return []
        with self._publisher.timed("waiting for perception"):
            return self.streams.collect(t)

    def take_notice(self, detections: Sequence[Detection], now: float) -> list[Evidence]:
        """Learn from what images show; returns the evidence of each exposure that was not complete before."""
        attempt = self._watched()
        for detection in detections:
            self._note(detection, attempt)
        found = self._buffer.fused(attempt.step.targets, self.streams.settled) if detections else []
        for evidence in found:
            self._publish(evidence, attempt, now)
            if evidence.complete:
                self.conflicts += sum(fused.conflict for fused in evidence.atoms.values())
                self._complete = evidence.values
        self._values = dict(self._complete)
        for evidence in found:
            if not evidence.complete:
                self._values.update({atom: value for atom, value in evidence.values.items() if value != Truth.UNKNOWN})
        return found

    def _note(self, detection: Detection, attempt: Attempt) -> None:
        if self._recorder is not None:
            self._recorder.seen(detection.camera, detection.t, detection.outlines())
        exposure = self._buffer.add(detection)
        if exposure is None:
            return
        for name, place in detection.places.items():
            self._places.setdefault(name, []).append(place)
        if exposure.tau is not None and attempt.counts(exposure.tau):
            attempt.check.add(detection, exposure.tau, attempt.monitor.monitored(exposure.tau), exposure.truths)

    def _publish(self, evidence: Evidence, attempt: Attempt, now: float) -> None:
        """Publish evidence by images of its own time, if it is news."""
        exposure = evidence.exposure
        if exposure.has_arrivals and self._published.get(exposure.t) != evidence.atoms:
            self._publisher.publish(_evidence_seen(evidence, attempt, now))
            self._published[exposure.t] = evidence.atoms
        if evidence.complete:
            self._published.pop(exposure.t, None)

    def _watched(self) -> Attempt:
        assert self._attempt is not None  # noqa: S101 - an attempt is set before images are taken
        return self._attempt


def _evidence_seen(evidence: Evidence, attempt: Attempt, now: float) -> EvidenceSeen:
    exposure, tau = evidence.exposure, evidence.exposure.tau
    required = attempt.monitor.monitored(max(tau or 0.0, 0.0))
    literals = {
        atom: ShownAtom(
            value=fused.truth,
            true=exposure.truths.get(atom),
            predicted=tau is not None and attempt.nominal.is_covered(atom, tau),
            asked=atom in required,
            cameras=dict(sorted(fused.votes.items())),
        )
        for atom, fused in evidence.atoms.items()
    }
    step_time = None if tau is None else round(tau, 6)
    return EvidenceSeen(t=now, exposed=round(exposure.t, 6), step_time=step_time, literals=literals)
