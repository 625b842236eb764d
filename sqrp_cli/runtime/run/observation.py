"""Looks through all cameras during a run: has images taken and looked at, and knows what they show of each atom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.perception.detections import Posture, Sighting
from sqrp_cli.runtime.perception.detector_pool import PerceptionError, PerceptionPool
from sqrp_cli.runtime.perception.evidence_buffer import Album, Exposure, Look, Moment
from sqrp_cli.runtime.perception.fusion import Finding, fuse
from sqrp_cli.runtime.perception.image_stream import Eyes
from sqrp_cli.runtime.record.events import EvidenceSeen, ShownAtom
from sqrp_cli.runtime.record.film import Gallery
from sqrp_cli.runtime.record.publisher import Narrator, listed
from sqrp_cli.runtime.record.report import Unwatched


class Lookout:
    """What all cameras together tell of the attempt that is watched.

    conflicts: how often cameras contradicted each other about an atom.
    """

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        cell: SimulatedCell,
        eyes: Eyes,
        pool: PerceptionPool,
        narrator: Narrator,
        gallery: Gallery | None,
    ) -> None:
        """gallery: takes every image with what was seen in it, if images are to be kept."""
        self._cameras, self._cell, self._eyes, self._pool = cameras, cell, eyes, pool
        self._narrator, self._gallery = narrator, gallery
        self._album = Album(cameras)
        self._attempt: Attempt | None = None
        self._number = 0
        self.conflicts = 0
        self.forget(0.0)

    @property
    def period(self) -> float:
        """Time between two images of the slowest camera [s]."""
        return max(1.0 / camera.rate for camera in self._cameras.values())

    @property
    def latency(self) -> float:
        """From an exposure to the image being available, for the slowest camera [s]."""
        return max(camera.latency for camera in self._cameras.values())

    @property
    def values(self) -> dict[str, Truth]:
        """What is known of each atom: the newest that any images tell, none older than the last complete moment."""
        return dict(self._values)

    @property
    def caught_up(self) -> bool:
        """Whether the images of all cameras of some moment since `forget` are there."""
        return bool(self._complete)

    @property
    def places(self) -> dict[str, Array]:
        """Where objects were located since `forget`, (3,) each [m]: the median over the images."""
        return {name: np.median(found, axis=0) for name, found in self._places.items()}

    def watch(self, attempt: Attempt, number: int, t: float) -> None:
        """Look for what an attempt at the step with that number asks about, in images from time t [s] on."""
        self._attempt, self._number = attempt, number
        self._pool.watch(attempt.watchlist)
        self.forget(t)

    def forget(self, t: float) -> None:
        """Go by images that are taken from time t [s] on, and by nothing that was known before."""
        self._album.forget(t)
        self._values: dict[str, Truth] = {}
        self._complete: dict[str, Truth] = {}
        self._told: dict[float, Mapping[str, Finding]] = {}
        self._places: dict[str, list[Array]] = {}

    def expose(self, t: float, tau: float | None, truths: Mapping[str, bool], *, holding: bool) -> None:
        """Take the images that are due at time t [s]. Raises Unwatched if a process that looks at them has ended."""
        assert self._attempt is not None  # noqa: S101 - nobody looks without being told for what
        posture = Posture(dict(self._cell.measured_joints()), holding, self._attempt.beliefs(tau))
        try:
            with self._narrator.timed("images"):
                frames = self._eyes.expose(t, self._cell.frames, posture)
        except PerceptionError as error:
            raise Unwatched(str(error), "perception-crash", error.cameras) from error
        if frames:
            self._album.take(Exposure(frames[0].t, tau, truths), [frame.camera for frame in frames])
        for frame in frames:
            if self._gallery is not None:
                planned = tau if self._attempt.undisturbed else None
                self._gallery.add(frame, self._number, planned, self._narrator.doing)

    def collect(self, t: float) -> list[Sighting]:
        """The images that have arrived by time t [s], looked at. Raises Unwatched if some are not."""
        if self._eyes.next_arrival > t + 1e-9:
            return []
        try:
            with self._narrator.timed("waiting for perception"):
                arrived = self._eyes.collect(t)
        except PerceptionError as error:
            raise Unwatched(str(error), "perception-crash", error.cameras) from error
        frozen = [sighting.camera for sighting in arrived if sighting.frozen]
        if frozen:
            how = "is frozen: it delivers" if len(frozen) == 1 else "are frozen: each delivers"
            raise Unwatched(f"{listed(frozen)} {how} the same image again", "frozen", frozen)
        return arrived

    def take_notice(self, sightings: Sequence[Sighting], now: float) -> list[Look]:
        """Learn from what images show; returns what is then known of each moment that was not complete before."""
        for sighting in sightings:
            self._note(sighting)
        moments = self._album.moments() if sightings else []
        looks = [self._look(moment, now) for moment in moments]
        for look in looks:
            if look.complete:
                self._complete = dict(look.values)
        self._values = dict(self._complete)
        for look in looks:
            if not look.complete:
                self._values.update({atom: value for atom, value in look.values.items() if value != Truth.UNKNOWN})
        return looks

    def _note(self, sighting: Sighting) -> None:
        attempt = self._attempt
        assert attempt is not None  # noqa: S101 - as above
        if self._gallery is not None:
            self._gallery.seen(sighting.camera, sighting.t, sighting.outlines())
        exposure = self._album.add(sighting)
        if exposure is None:
            return
        for name, place in sighting.places.items():
            self._places.setdefault(name, []).append(place)
        if exposure.tau is not None and attempt.counts(exposure.tau):
            attempt.check.add(sighting, exposure.tau, attempt.judge.monitored(exposure.tau), exposure.truths)

    def _look(self, moment: Moment, now: float) -> Look:
        """Fuse what counts at a moment, and tell it if it is news."""
        attempt = self._attempt
        assert attempt is not None  # noqa: S101 - as above
        exposure = moment.exposure
        findings = {atom: fuse(atom, target, moment.sightings) for atom, target in attempt.step.targets.items()}
        if moment.told and self._told.get(exposure.t) != findings:
            self._tell(exposure, findings, attempt, now)
            self._told[exposure.t] = findings
        if moment.complete:
            self.conflicts += sum(finding.conflict for finding in findings.values())
            self._told.pop(exposure.t, None)
        values = {atom: finding.truth for atom, finding in findings.items()}
        return Look(exposure.t, exposure.tau, values, moment.complete)

    def _tell(self, exposure: Exposure, findings: Mapping[str, Finding], attempt: Attempt, now: float) -> None:
        tau = exposure.tau
        asked = attempt.judge.monitored(max(tau or 0.0, 0.0))
        literals = {
            atom: ShownAtom(
                value=finding.truth,
                true=exposure.truths.get(atom),
                predicted=tau is not None and attempt.expectation.is_covered(atom, tau),
                asked=atom in asked,
                cameras=dict(sorted(finding.votes.items())),
            )
            for atom, finding in findings.items()
        }
        step_time = None if tau is None else round(tau, 6)
        exposed = round(exposure.t, 6)
        self._narrator.publish(EvidenceSeen(t=now, exposed=exposed, step_time=step_time, literals=literals))
