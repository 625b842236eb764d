"""Image streams: images taken at each camera's rate, late by its latency, looked at in other processes.

A failed stream is a reason to stop: one without a fresh image for too long, one that repeats an image, or one with a
dead process.
"""

from __future__ import annotations

import heapq
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.perception.detections import BelievedState, Detection, DetectionTargets
from sqrp_cli.runtime.perception.detector_pool import DetectorPool, PerceptionError
from sqrp_cli.runtime.record.events import listed
from sqrp_cli.runtime.record.report import MonitoringLost

OVERDUE_PERIODS = 1.2
"""A stream has failed if its newest image is older than its latency and this many frame periods: one is missing."""

Expose = Callable[[Sequence[str]], Mapping[str, CameraImage]]
"""Takes an image with each of some cameras, now."""


@dataclass
class _Stream:
    camera: Camera
    exposures: int = 0
    newest: float = 0.0
    lost: bool = False
    frozen: CameraImage | None = None
    freezes: bool = False
    delay: float = 0.0
    last: CameraImage | None = None

    @property
    def next_exposure(self) -> float:
        return self.exposures / self.camera.rate

    @property
    def fails_at(self) -> float:
        """When it fails if no image comes [s]."""
        return self.newest + self.camera.lag + OVERDUE_PERIODS / self.camera.rate


class Streams:
    """The images of all cameras of a cell, on the cell's clock [s]: what is the same of simulated and real ones."""

    def __init__(self, cameras: Mapping[str, Camera], detectors: DetectorPool) -> None:
        """detectors: the processes that look at the images."""
        self.cameras = cameras
        self._detectors = detectors
        self.seconds = 0.0
        self.images = 0

    @property
    def period(self) -> float:
        """Time between two images of the slowest camera [s]."""
        return max(1.0 / camera.rate for camera in self.cameras.values())

    @property
    def latency(self) -> float:
        """From an exposure to the image being available, for the slowest camera [s]."""
        return max(camera.lag for camera in self.cameras.values())

    @property
    def settled(self) -> float:
        """Before when no image is under way that nobody knows of [s]."""
        return float("inf")

    @property
    @abstractmethod
    def next_exposure(self) -> float:
        """When the next image is taken [s]."""

    @property
    @abstractmethod
    def next_arrival(self) -> float:
        """When the next image is available [s]; infinite if none is known to be under way."""

    @property
    @abstractmethod
    def next_check(self) -> float:
        """When a stream fails next if no image comes [s]."""

    @abstractmethod
    def has_arrival_from(self, end: float) -> bool:
        """Whether an image that was taken by a time is still under way."""

    @abstractmethod
    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """Take the images that are due at time t; returns them. believed: at a time [s].

        Raises MonitoringLost if a process that looks at them has ended.
        """

    @abstractmethod
    def collect(self, t: float) -> list[Detection]:
        """What the images show that have arrived by time t, in the order of their exposure.

        Raises MonitoringLost if a process that looks at them has ended, or an image is the very one before it.
        """

    @abstractmethod
    def failure(self, t: float) -> MonitoringLost | None:
        """The streams that have failed by time t, and how; None while all is well."""

    def watch(self, sought: DetectionTargets) -> None:
        """Look for these targets in all images that come from now on.

        Raises MonitoringLost if a process that looks at them has ended.
        """
        with lost_if_crashed():
            self._detectors.watch(sought)

    def resume(self, t: float) -> float:
        """Go on after nobody has looked at images since time t [s]; returns from when on they count, which is now."""
        return t

    def present(self, t: float) -> float:
        """The time now, if the last event was at time t [s]; in a real cell some has passed since."""
        return t

    def _collected(self, detections: list[Detection]) -> list[Detection]:
        """Detections in the order of their exposure. Raises MonitoringLost for an image that is the one before it."""
        self.seconds += sum(detection.seconds for detection in detections)
        detections.sort(key=lambda detection: (detection.t, detection.camera))
        frozen = [detection.camera for detection in detections if detection.frozen]
        if frozen:
            how = "is frozen: it delivers" if len(frozen) == 1 else "are frozen: each delivers"
            raise MonitoringLost(f"{listed(frozen)} {how} the same image again", "frozen", frozen)
        return detections


class ImageStreams(Streams):
    """The images of simulated cameras: taken when they are due, and late as each camera is."""

    def __init__(self, cameras: Mapping[str, Camera], detectors: DetectorPool) -> None:
        """As `Streams`."""
        super().__init__(cameras, detectors)
        self._streams = {name: _Stream(camera) for name, camera in cameras.items()}
        self._arrivals: list[tuple[float, float, str]] = []

    @property
    def next_exposure(self) -> float:
        """As `Streams` says."""
        return min(stream.next_exposure for stream in self._streams.values())

    @property
    def next_arrival(self) -> float:
        """As `Streams` says."""
        return self._arrivals[0][0] if self._arrivals else float("inf")

    def has_arrival_from(self, end: float) -> bool:
        """As `Streams` says."""
        return any(exposed <= end + 1e-9 for _, exposed, _ in self._arrivals)

    def crash(self, camera: str) -> None:
        """The process that looks at the images ends."""
        self._detectors.crash(camera)

    def lose(self, camera: str) -> None:
        """No image comes any more."""
        self._streams[camera].lost = True

    def freeze(self, camera: str) -> None:
        """The last image comes again and again, with new times."""
        self._streams[camera].freezes = True

    def delay(self, camera: str, delay: float) -> None:
        """Images come later by a delay [s]."""
        self._streams[camera].delay = delay

    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """As `Streams` says: images as they will arrive."""
        due = [stream for stream in self._streams.values() if stream.next_exposure <= t + 1e-9]
        for stream in due:
            stream.exposures += 1
        then, frames = believed(t), take([stream.camera.name for stream in due if not stream.lost])
        sent = []
        for stream in due:
            if stream.lost:
                continue
            frame = frames[stream.camera.name]
            if stream.freezes:
                stream.frozen = stream.frozen or stream.last or frame
                frame = CameraImage(frame.camera, frame.t, stream.frozen.image)
            stream.last = frame
            with lost_if_crashed():
                self._detectors.submit(frame, then)
            arrival = t + stream.camera.lag + stream.delay
            heapq.heappush(self._arrivals, (arrival, frame.t, frame.camera))
            sent.append(frame)
        self.images += len(sent)
        return sent

    def collect(self, t: float) -> list[Detection]:
        """As `Streams` says."""
        detections = []
        while self._arrivals and self._arrivals[0][0] <= t + 1e-9:
            _, exposed, camera = heapq.heappop(self._arrivals)
            with lost_if_crashed():
                detection = self._detectors.collect(camera)
            self._streams[camera].newest = exposed
            detections.append(detection)
        return self._collected(detections)

    def failure(self, t: float) -> MonitoringLost | None:
        """As `Streams` says.

        If some are lost and others late at the same time, the reason names the lost ones.
        """
        failed = {name: t - one.newest for name, one in self._streams.items() if t > one.fails_at + 1e-9}
        under_way = {camera for _, _, camera in self._arrivals}
        lost = {name: age for name, age in failed.items() if name not in under_way}
        return lost_streams(lost, failed)

    @property
    def next_check(self) -> float:
        """As `Streams` says."""
        return min(stream.fails_at for stream in self._streams.values()) + 1e-6


_REASONS = (
    ("camera-loss", "{names} {are} lost: no image for {ages}"),
    ("latency", "the images of {names} come too late: the newest {are} {ages} old"),
    ("perception-late", "this computer looks too slowly at images of {names}: it knows what they showed {ages} ago"),
)
"""How streams fail, the worst first."""


def lost_streams(*failed: Mapping[str, float], mend: str = "") -> MonitoringLost | None:
    """The worst failure; None where there is none.

    failed: in the order of `_REASONS`, the cameras that fail so, with how old what is known of each is [s]. mend: what
    may help, whatever fails.
    """
    for (fault, reason), found in zip(_REASONS, failed, strict=False):
        if found:
            ages = listed(sorted({f"{age:.2f} s" for age in found.values()}))
            text = reason.format(names=listed(list(found)), are="is" if len(found) == 1 else "are", ages=ages)
            return MonitoringLost(text + (f" ({mend})" if mend else ""), fault, list(found))
    return None


@contextmanager
def lost_if_crashed() -> Iterator[None]:
    """A process that looks at images and has ended is a reason to stop: raises MonitoringLost."""
    try:
        yield
    except PerceptionError as error:
        raise MonitoringLost(str(error), "perception-crash", error.cameras) from error
