"""Streams of images, looked at in other processes: taken at each camera's rate and late by its latency, or received.

A failed stream is a reason to stop: one without a fresh image for too long, one whose images are old, one that repeats
an image, one with a dead process, or images that nobody gets round to look at.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Literal, TypeAlias

from sqrp_cli.camera.camera import Camera
from sqrp_cli.records import dataclass
from sqrp_cli.ros.messages import Pauses
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.perception.detections import BelievedState, Detection
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.record.events import listed
from sqrp_cli.run.record.report import Stopped

OVERDUE_PERIODS = 1.2
"""A stream has failed if its newest image is older than its latency and this many frame periods: one is missing."""
LOOKING = 0.005  # Time between two looks for images that have come [s]
MOST_WAITING = 3  # Most images of a camera that wait to be looked at; what comes then is left out
SLACK, LOOKING_SLACK = 0.08, 0.3
"""How much later than in simulation an image may come, and be looked at, in real time [s]."""
FIRST = 3.0  # How much longer the first image may take, for which the robot waits [s]
_REASONS = (
    ("camera-loss", "{names} {are} lost: no image for {ages}"),
    ("latency", "the images of {names} come too late: the newest {are} {ages} old"),
    ("perception-late", "this computer looks too slowly at images of {names}: it knows what they showed {ages} ago"),
)
"""How streams fail, the worst first."""
Expose = Callable[[Sequence[str]], Mapping[str, CameraImage]]  # Takes an image with each of some cameras, now


class _CameraStreams:
    """The images of all cameras of a cell, on the cell's clock [s]: what is the same of simulated and real ones.

    Its methods raise Stopped where a process that looks at images has ended.
    """

    def __init__(self, cameras: Mapping[str, Camera], detectors: DetectorPool, mend: str = "") -> None:
        """detectors: the processes that look at the images. mend: what may help, for the reasons of failures."""
        self.cameras, self.detectors, self._mend = cameras, detectors, mend
        self._streams = {name: _Stream(camera, OVERDUE_PERIODS / camera.rate) for name, camera in cameras.items()}
        self._arrivals: list[tuple[float, float, str]] = []  # of simulated images: when they come, from when, and whose
        self.seconds, self.images = 0.0, 0
        self.period = max(1.0 / camera.rate for camera in cameras.values())
        """Time between two images of the slowest camera [s]."""
        self.latency = max(camera.lag for camera in cameras.values())
        """From an exposure to the image being available, for the slowest camera [s]."""

    @property
    def settled(self) -> float:
        """Before when no image is under way that nobody knows of [s]."""
        return float("inf")

    def has_arrival_from(self, end: float) -> bool:
        """Whether an image that was taken by a time [s] is still under way."""
        return self.settled <= end or any(exposed <= end + 1e-9 for _, exposed, _ in self._arrivals)

    def present(self, t: float, *, resume: bool = False) -> float:  # noqa: ARG002 - no time passes in simulation
        """The time now, if the last event was at time t [s]; resume: images count from now on, as nobody has looked."""
        return t

    def _collected(self, detections: list[Detection]) -> list[Detection]:
        """Detections in the order of their exposure. Raises Stopped for an image that is the one before it."""
        self.seconds += sum(detection.seconds for detection in detections)
        detections.sort(key=lambda detection: (detection.t, detection.camera))
        frozen = [detection.camera for detection in detections if detection.frozen]
        if frozen:
            how = "is frozen: it delivers" if len(frozen) == 1 else "are frozen: each delivers"
            raise Stopped(f"{listed(frozen)} {how} the same image again", "frozen", frozen)
        return detections

    def _worst(self, *failed: Mapping[str, float]) -> Stopped | None:
        """The worst failure; None where there is none.

        failed: in the order of `_REASONS`, the cameras that fail so, with how old what is known of each is [s].
        """
        for (fault, reason), found in zip(_REASONS, failed, strict=False):
            if found:
                ages = listed(sorted({f"{age:.2f} s" for age in found.values()}))
                text = reason.format(names=listed(list(found)), are="is" if len(found) == 1 else "are", ages=ages)
                return Stopped(text + (f" ({self._mend})" if self._mend else ""), fault, list(found))
        return None


@dataclass
class _Stream:
    """A camera and its images; times of exposure on the cell's clock [s]."""

    camera: Camera
    overdue: float  # How long after its latency an image is missed [s]
    newest: float = 0.0  # Exposure of the newest image that came
    exposures: int = 0  # Of a simulated camera, how many images it took, with those that were lost
    lost: bool = False
    freezes: bool = False
    delay: float = 0.0
    last: CameraImage | None = None
    came: float = 0.0  # Of a real camera, when the last image came [s]
    seen: float = 0.0  # Exposure of the newest image that was looked at
    begun: bool = False  # Whether any image was looked at since nobody did for a while
    waiting: deque[tuple[CameraImage, BelievedState]] = field(default_factory=deque)
    """Images that nobody looks at yet, with what was believed when they were taken."""
    looked_at: int = 0  # How many are being looked at


class ImageStreams(_CameraStreams):
    """The images of simulated cameras: taken when they are due, and late as each camera is."""

    @property
    def next_event(self) -> float:
        """When an image is taken or arrives next, or a stream fails if none does [s]."""
        coming = [one.exposures / one.camera.rate for one in self._streams.values()]
        coming += [one.newest + one.camera.lag + one.overdue + 1e-6 for one in self._streams.values()]
        return min([*coming, self._arrivals[0][0]] if self._arrivals else coming)

    def fail(
        self, how: Literal["camera-loss", "frozen", "latency", "perception-crash"], camera: str, delay: float = 0.0
    ) -> None:
        """From now on no image of a camera comes, the last comes again and again with new times, or they are late.

        Or the process that looks at them ends. delay: by how much they are late then [s].
        """
        stream = self._streams[camera]
        stream.lost |= how == "camera-loss"
        stream.freezes |= how == "frozen"
        stream.delay = delay if how == "latency" else stream.delay
        if how == "perception-crash":
            self.detectors.crash(camera)

    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """Take the images that are due at time t [s]; returns them, as they will arrive. believed: at a time [s]."""
        due = [stream for stream in self._streams.values() if stream.exposures / stream.camera.rate <= t + 1e-9]
        if not due:
            return []
        for stream in due:
            stream.exposures += 1
        sending = [stream for stream in due if not stream.lost]
        then, frames, sent = believed(t), take([stream.camera.name for stream in sending]), []
        for stream in sending:
            frame = frames[stream.camera.name]
            if stream.freezes and stream.last is not None:
                frame = CameraImage(frame.camera, frame.t, stream.last.image)
            stream.last = frame
            self.detectors.submit(frame, then)
            heapq.heappush(self._arrivals, (t + stream.camera.lag + stream.delay, frame.t, frame.camera))
            sent.append(frame)
        self.images += len(sent)
        return sent

    def collect(self, t: float) -> list[Detection]:
        """What the images show that have arrived by time t [s], in the order of their exposure.

        Raises Stopped where an image is the very one before it.
        """
        detections = []
        while self._arrivals and self._arrivals[0][0] <= t + 1e-9:
            _, exposed, camera = heapq.heappop(self._arrivals)
            detections.append(self.detectors.collect(camera))
            self._streams[camera].newest = exposed
        return self._collected(detections)

    def failure(self, t: float) -> Stopped | None:
        """The streams that have failed by time t [s], and how; of lost and of late ones, it names the lost."""
        failed = {
            name: t - one.newest
            for name, one in self._streams.items()
            if t > one.newest + one.camera.lag + one.overdue + 1e-9
        }
        under_way = {camera for _, _, camera in self._arrivals}
        return self._worst({name: age for name, age in failed.items() if name not in under_way}, failed)


class ReceivedStreams(_CameraStreams):
    """The images of real cameras: each comes when it comes, with the time of its exposure."""

    def __init__(
        self, cameras: Mapping[str, Camera], detectors: DetectorPool, clock: Callable[[], float], mend: str = ""
    ) -> None:
        """clock: of the cell [s]. mend: what may help, for the reasons of failures."""
        super().__init__(cameras, detectors, mend)
        self._clock, self._pauses = clock, Pauses()
        self.next_event = LOOKING
        """When to look again for images that have come, and for what they show [s]."""

    @property
    def settled(self) -> float:
        """As far as cameras keep their rates."""
        return min(stream.seen + 1.0 / stream.camera.rate for stream in self._streams.values())

    def present(self, t: float, *, resume: bool = False) -> float:
        """As in simulation, but time goes on."""
        now = max(t, self._clock())
        for stream in self._streams.values() if resume else ():
            stream.came, stream.newest, stream.seen = now, max(stream.newest, now), max(stream.seen, now)
            stream.begun = False
            stream.waiting.clear()
        return now

    def expose(self, t: float, take: Expose, believed: Callable[[float], BelievedState]) -> list[CameraImage]:
        """Take the images that have come by time t [s]; returns them. believed: at a time [s]."""
        if self.next_event > t + 1e-9:
            return []
        self.next_event = t + LOOKING
        self._pauses.look(t)
        found = []
        for name, image in take(list(self._streams)).items():
            stream = self._streams[name]
            stream.came, before, stream.newest = t, stream.newest, max(stream.newest, image.t)
            if image.t > before and len(stream.waiting) < MOST_WAITING:
                stream.waiting.append((image, believed(image.t)))
                found.append(image)
        self.images += len(found)
        return sorted(found, key=lambda image: (image.t, image.camera))

    def collect(self, t: float) -> list[Detection]:
        """What images show that are looked at by time t [s]; who is free then gets the oldest images that wait.

        Raises Stopped where an image is the very one before it.
        """
        found: list[Detection] = []
        if self.next_event > t + 1e-9:
            return found
        for name, stream in self._streams.items():
            while stream.looked_at and self.detectors.is_ready(name):
                found.append(self.detectors.collect(name))
                stream.looked_at -= 1
                stream.begun |= found[-1].t > stream.seen
                stream.seen = max(stream.seen, found[-1].t)
        waiting = [stream for stream in self._streams.values() if stream.waiting]
        for stream in sorted(waiting, key=lambda one: one.waiting[0][0].t):
            if self.detectors.is_free(stream.camera.name):
                self.detectors.submit(*stream.waiting.popleft())
                stream.looked_at += 1
        return self._collected(found)

    def failure(self, t: float) -> Stopped | None:
        """The streams that have failed by time t [s]: no images, then old ones, then nobody who looks at them."""
        waited, lost, late, slow = self._pauses.waited, dict[str, float](), dict[str, float](), dict[str, float]()
        for name, one in self._streams.items():
            overdue = one.overdue + (0.0 if one.begun else FIRST)
            patience = one.camera.lag + overdue
            if waited(one.newest) > patience + SLACK or waited(one.came) > overdue + SLACK:
                late[name] = t - one.newest
                if waited(one.came) > 1.0 / one.camera.rate:
                    lost[name] = t - one.newest
            if t > one.seen + patience + LOOKING_SLACK:
                slow[name] = t - one.seen
        return self._worst(lost, late, slow)


Streams: TypeAlias = ImageStreams | ReceivedStreams  # The images of all cameras of a cell, simulated or real
