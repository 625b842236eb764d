"""The evidence of an attempt: images in order of exposure, even if they arrive late, and their fusion.

An image counts from its exposure until the next exposure of its camera, at most for some frame periods. While an image
is under way, the one before it no longer counts, and the cameras with arrived images decide alone. Evidence of a time
is complete when no image taken by then is under way.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import field

from sqrp_cli.camera.camera import Camera
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.records import dataclass
from sqrp_cli.run.perception.detections import Detection

FRESH_PERIODS = 1.5
"""What an image shows counts for this many frame periods of its camera."""


@dataclass(frozen=True)
class FusedTruth:
    """The value of an atom from all cameras together."""

    truth: Truth
    """UNKNOWN where too few cameras can judge it, or as many contradict."""
    votes: Mapping[str, Truth]
    """Of each camera that can judge it."""
    conflict: bool
    """Whether images that were taken at the same time contradict each other."""


def fuse(atom: str, target: ProgramTarget, detections: Iterable[Detection]) -> FusedTruth:
    """The majority value of an atom, if it has as many cameras as the target requires."""
    judged = [(detection, vote) for detection in detections if (vote := detection.truth(atom)) != Truth.UNKNOWN]
    votes = {detection.camera: vote for detection, vote in judged}
    conflict = len({(detection.t, vote) for detection, vote in judged}) > len({detection.t for detection, _ in judged})
    yes, no = (sum(vote == value for vote in votes.values()) for value in (Truth.TRUE, Truth.FALSE))
    if max(yes, no) < target.cameras or yes == no:
        return FusedTruth(Truth.UNKNOWN, votes, conflict)
    return FusedTruth(Truth.TRUE if yes > no else Truth.FALSE, votes, conflict)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Images that were taken at one time."""

    t: float
    """On the cell's clock [s]."""
    tau: float | None
    """Of the step's motion [s], None before it."""
    truths: Mapping[str, bool]
    """Ground truth of all atoms, for checking only."""
    detections: dict[str, Detection | None] = field(default_factory=dict)
    """What the image of each camera shows, None for those that are under way."""

    @property
    def has_arrivals(self) -> bool:
        """Whether any of its images has arrived."""
        return any(detection is not None for detection in self.detections.values())


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the time of an exposure by all images that count then."""

    exposure: Exposure
    atoms: Mapping[str, FusedTruth]
    complete: bool
    """Whether no image that was taken by then is under way any more, so that nothing that is known will change."""

    @property
    def t(self) -> float:
        """On the cell's clock [s]."""
        return self.exposure.t

    @property
    def values(self) -> dict[str, Truth]:
        """Of atoms."""
        return {atom: fused.truth for atom, fused in self.atoms.items()}


class EvidenceBuffer:
    """The images that cameras took since a time; empty at first."""

    def __init__(self, cameras: Mapping[str, Camera]) -> None:
        self._lifetimes = {name: FRESH_PERIODS / camera.rate for name, camera in cameras.items()}
        self._exposures: list[Exposure] = []
        self._completed = -float("inf")

    def forget(self, t: float) -> None:
        """Drop all images that have arrived, and those under way that were taken before time t [s]."""
        self._exposures = [
            Exposure(one.t, one.tau, one.truths, {name: None for name, d in one.detections.items() if d is None})
            for one in self._exposures
            if one.t >= t - 1e-9
        ]

    def take(self, exposure: Exposure) -> None:
        """Images are under way; with others of the very same time they are one exposure."""
        index = bisect_left(self._exposures, exposure.t, key=lambda one: one.t)
        if index < len(self._exposures) and self._exposures[index].t == exposure.t:
            self._exposures[index].detections.update(exposure.detections)
        else:
            self._exposures.insert(index, exposure)

    def add(self, detection: Detection) -> Exposure | None:
        """An image has arrived. Returns the exposure that it belongs to, None if that was dropped."""
        for exposure in reversed(self._exposures):
            if exposure.t == detection.t and detection.camera in exposure.detections:
                exposure.detections[detection.camera] = detection
                return exposure
        return None

    def fused(self, targets: Mapping[str, ProgramTarget], settled: float = float("inf")) -> list[Evidence]:
        """The evidence of each exposure that was not complete before, up to the last of which an image has arrived.

        targets: by atom. settled: before when no image is under way that nobody knows of [s].
        """
        count = max((index + 1 for index, one in enumerate(self._exposures) if one.has_arrivals), default=0)
        found, complete, last = [], True, dict[str, Detection | None]()
        for exposure in self._exposures[:count]:
            last.update(exposure.detections)
            complete = complete and exposure.t < settled and None not in exposure.detections.values()
            if exposure.t > self._completed:
                arrived = [detection for detection in last.values() if detection is not None]
                counting = [one for one in arrived if exposure.t - one.t < self._lifetimes[one.camera]]
                atoms = {atom: fuse(atom, target, counting) for atom, target in targets.items()}
                found.append(Evidence(exposure, atoms, complete))
        self._completed = max((evidence.t for evidence in found if evidence.complete), default=self._completed)
        oldest = self._completed - max(self._lifetimes.values())
        self._exposures = [exposure for exposure in self._exposures if exposure.t > oldest]
        return found
