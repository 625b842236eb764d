"""Streams of images that real cameras send: each comes when it comes, with the time of its exposure.

A failed stream is a reason to stop: one without a fresh image for too long, one whose images are old, one that repeats
an image, or images that nobody gets round to look at.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.pauses import Pauses
from sqrp_cli.runtime.perception.detections import BelievedState, Detection
from sqrp_cli.runtime.perception.detector_pool import DetectorPool
from sqrp_cli.runtime.perception.image_stream import OVERDUE_PERIODS, Expose, Streams, lost_if_crashed, lost_streams
from sqrp_cli.runtime.record.report import MonitoringLost

LOOKING = 0.005
"""Time between two looks for images that have come [s]."""

MOST_WAITING = 3
"""Most images of a camera that wait to be looked at; what comes then is left out."""

SLACK, LOOKING_SLACK = 0.08, 0.3
"""How much later than in simulation an image may come, and be looked at, in real time [s]."""


FIRST = 3.0
"""How much longer the first image may take, for which the robot waits [s]."""


class _Received(NamedTuple):
    """An image to look at, with what was believed when it was taken."""

    image: CameraImage
    believed: BelievedState


@dataclass
class _ReceivedStream:
    """A camera and its images, times of exposure on the cell's clock [s]."""

    camera: Camera
    came: float = 0.0
    """When the last one came [s]."""
    newest: float = 0.0
    """Exposure of the newest one that came."""
    seen: float = 0.0
    """Exposure of the newest one that was looked at."""
    begun: bool = False
    """Whether any image was looked at since `resume`."""
    waiting: deque[_Received] = field(default_factory=deque)
    """Those that nobody looks at yet."""
    looked_at: int = 0
    """How many are being looked at."""

    @property
    def patience(self) -> float:
        """How old its newest image may get [s]."""
        usual = self.camera.lag + OVERDUE_PERIODS / self.camera.rate
        return usual if self.begun else usual + FIRST

    @property
    def overdue(self) -> float:
        """Longest time without any image [s]."""
        return OVERDUE_PERIODS / self.camera.rate + (0.0 if self.begun else FIRST)

    @property
    def next_exposure(self) -> float:
        """When it should have taken the one after the newest that was looked at [s]."""
        return self.seen + 1.0 / self.camera.rate


class ReceivedStreams(Streams):
    """The images of real cameras."""

    def __init__(
        self, cameras: Mapping[str, Camera], detectors: DetectorPool, clock: Callable[[], float], mend: str = ""
    ) -> None:
        """clock: of the cell [s]. mend: what may help, for the reasons of failures."""
        super().__init__(cameras, detectors)
        self._clock, self._mend = clock, mend
        self._streams = {name: _ReceivedStream(camera) for name, camera in cameras.items()}
        self._looked = 0.0
        self._pauses = Pauses()

    @property
    def next_exposure(self) -> float:
        """When to look again for images that have come [s]."""
        return self._looked + LOOKING

    @property
    def next_arrival(self) -> float:
        """When to look again for what images show [s]."""
        return self.next_exposure

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
            stream.begun = False
            stream.waiting.clear()
        return now

    def present(self, t: float) -> float:
        """As `Streams` says."""
        return max(t, self._clock())

    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """As `Streams` says: the images that have come."""
        self._looked = t
        self._pauses.look(t)
        found = []
        for name, image in take(list(self._streams)).items():
            stream = self._streams[name]
            stream.came = t
            if image.t <= stream.newest:
                continue
            stream.newest = image.t
            if len(stream.waiting) >= MOST_WAITING:
                continue
            stream.waiting.append(_Received(image, believed(image.t)))
            found.append(image)
        self.images += len(found)
        return sorted(found, key=lambda image: (image.t, image.camera))

    def collect(self, t: float) -> list[Detection]:  # noqa: ARG002 - what is there by now
        """As `Streams` says."""
        found = []
        with lost_if_crashed():
            for name, stream in self._streams.items():
                while stream.looked_at and self._detectors.is_ready(name):
                    found.append(self._detectors.collect(name))
                    stream.looked_at -= 1
                    stream.begun |= found[-1].t > stream.seen
                    stream.seen = max(stream.seen, found[-1].t)
            self._look_at_more()
        return self._collected(found)

    def _look_at_more(self) -> None:
        """Give processes that have nothing to do the oldest images that wait."""
        waiting = [stream for stream in self._streams.values() if stream.waiting]
        for stream in sorted(waiting, key=lambda one: one.waiting[0].image.t):
            if self._detectors.is_free(stream.camera.name):
                look = stream.waiting.popleft()
                self._detectors.submit(look.image, look.believed)
                stream.looked_at += 1

    def failure(self, t: float) -> MonitoringLost | None:
        """As `Streams` says. The worst reason counts: no images, then old ones, then nobody who looks at them."""
        streams, waited = self._streams.values(), self._pauses.waited
        old = [
            one
            for one in streams
            if waited(one.newest) > one.patience + SLACK or waited(one.came) > one.overdue + SLACK
        ]
        lost = {one.camera.name: t - one.newest for one in old if waited(one.came) > 1.0 / one.camera.rate}
        late = {one.camera.name: t - one.newest for one in old}
        slow = {one.camera.name: t - one.seen for one in streams if t > one.seen + one.patience + LOOKING_SLACK}
        return lost_streams(lost, late, slow, mend=self._mend)
