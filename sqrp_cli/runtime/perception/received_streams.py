"""Streams of images that real cameras send: each comes when it comes, with the time of its exposure.

A failed stream is a reason to stop: one without a fresh image for too long, one whose images are old, one that repeats
an image, or images that nobody gets round to look at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.perception.detections import BelievedState, Detection
from sqrp_cli.runtime.perception.detector_pool import DetectorPool
from sqrp_cli.runtime.perception.image_stream import OVERDUE_PERIODS, Expose, Streams, lost_if_crashed
from sqrp_cli.runtime.record.events import listed
from sqrp_cli.runtime.record.report import PROCESSING, MonitoringLost

LOOKING = 0.005
"""Time between two looks for images that have come [s]."""

MOST_WAITING = 3
"""Most images of a camera that wait to be looked at; what comes then is left out."""

SLACK = 2 * PROCESSING
"""How much later than in simulation an image may be: it is carried and looked at in real time [s]."""


@dataclass
class _Stream:
    """A camera and its images, times of exposure on the cell's clock [s]."""

    camera: Camera
    came: float = 0.0
    """When the last one came [s]."""
    newest: float = 0.0
    """Exposure of the newest one that came."""
    seen: float = 0.0
    """Exposure of the newest one that was looked at."""
    waiting: int = 0
    """How many wait to be looked at."""

    @property
    def patience(self) -> float:
        """How old its newest image may get [s]."""
        return self.camera.latency + OVERDUE_PERIODS / self.camera.rate + SLACK

    @property
    def next_exposure(self) -> float:
        """When it should have taken the one after the newest that was looked at [s]."""
        return self.seen + 1.0 / self.camera.rate


class ReceivedStreams(Streams):
    """The images of real cameras."""

    def __init__(self, cameras: Mapping[str, Camera], detectors: DetectorPool, clock: Callable[[], float]) -> None:
        """clock: of the cell [s]."""
        super().__init__(cameras, detectors)
        self._clock = clock
        self._streams = {name: _Stream(camera) for name, camera in cameras.items()}
        self._looked = 0.0

    @property
    def next_exposure(self) -> float:
        """When to look again for images that have come [s]."""
        return self._looked + LOOKING

    @property
    def next_arrival(self) -> float:
        """As `Streams` says: nobody knows."""
        return float("inf")

    @property
    def next_check(self) -> float:
        """As `Streams` says: each look is a check."""
        return float("inf")

    @property
    def settled(self) -> float:
        """Before when no image is under way, as far as cameras keep their rates [s]."""
        return min(stream.next_exposure for stream in self._streams.values())

    def has_arrival_from(self, end: float) -> bool:
        """As `Streams` says."""
        return self.settled <= end

    def resume(self, t: float) -> float:
        """As `Streams` says."""
        now = max(t, self._clock())
        for stream in self._streams.values():
            stream.came, stream.newest, stream.seen = now, max(stream.newest, now), max(stream.seen, now)
        return now

    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """As `Streams` says: the images that have come."""
        self._looked = t
        found = []
        for name, image in take(list(self._streams)).items():
            stream = self._streams[name]
            stream.came = t
            if image.t <= stream.newest or stream.waiting >= MOST_WAITING:
                continue
            stream.newest = image.t
            stream.waiting += 1
            with lost_if_crashed():
                self._detectors.submit(image, believed(image.t))
            found.append(image)
        self.images += len(found)
        return sorted(found, key=lambda image: (image.t, image.camera))

    def collect(self, t: float) -> list[Detection]:  # noqa: ARG002 - what is there by now
        """As `Streams` says."""
        found = []
        with lost_if_crashed():
            for name, stream in self._streams.items():
                while stream.waiting and self._detectors.is_ready(name):
                    found.append(self._detectors.collect(name))
                    stream.waiting -= 1
                    stream.seen = max(stream.seen, found[-1].t)
        return self._collected(found)

    def failure(self, t: float) -> MonitoringLost | None:
        """As `Streams` says. The worst reason counts: no images, then old ones, then nobody who looks at them."""
        failed = [stream for stream in self._streams.values() if t > stream.seen + stream.patience]
        if not failed:
            return None
        lost = [one for one in failed if t > one.came + OVERDUE_PERIODS / one.camera.rate]
        late = [one for one in failed if t > one.newest + one.patience]
        worst = lost or late or failed
        cameras, verb = [one.camera.name for one in worst], "is" if len(worst) == 1 else "are"
        ages = listed(sorted({f"{t - (one.newest if worst is not failed else one.seen):.2f} s" for one in worst}))
        if worst is lost:
            return MonitoringLost(f"{listed(cameras)} {verb} lost: no image for {ages}", "camera-loss", cameras)
        if worst is late:
            reason = f"the images of {listed(cameras)} come too late: the newest {verb} {ages} old"
            return MonitoringLost(reason, "latency", cameras)
        reason = f"perception is too slow for {listed(cameras)}: the newest image that was looked at {verb} {ages} old"
        return MonitoringLost(reason, "perception-late", cameras)
