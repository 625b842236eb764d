"""The streams of images: exposed at each camera's rate, late by its latency, looked at in other processes.

A stream that fails is a reason to stop: one without a fresh image for too long, and one that repeats an image.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.runtime.image import Frame
from sqrp_cli.runtime.perception.detections import Posture, Sighting
from sqrp_cli.runtime.perception.detector_pool import PerceptionPool
from sqrp_cli.runtime.record.publisher import listed
from sqrp_cli.runtime.record.report import Unwatched

OVERDUE_PERIODS = 1.2
"""A stream has failed if its newest image is older than its latency and this many frame periods: one is missing."""

Expose = Callable[[Sequence[str]], Mapping[str, Frame]]
"""Takes an image with each of some cameras, now."""


@dataclass
class _Stream:
    camera: Camera
    exposures: int = 0
    newest: float = 0.0
    lost: bool = False
    frozen: Frame | None = None
    freezes: bool = False
    delay: float = 0.0
    last: Frame | None = None

    @property
    def next_exposure(self) -> float:
        return self.exposures / self.camera.rate

    @property
    def fails_at(self) -> float:
        """When it fails if no image comes [s]."""
        return self.newest + self.camera.latency + OVERDUE_PERIODS / self.camera.rate


class Eyes:
    """The cameras of a cell, on the cell's clock [s]."""

    def __init__(self, cameras: Iterable[Camera], pool: PerceptionPool) -> None:
        """pool: the processes that look at the images."""
        self._streams = {camera.name: _Stream(camera) for camera in cameras}
        self._pool = pool
        self._arrivals: list[tuple[float, float, str]] = []
        self.seconds = 0.0
        self.images = 0

    @property
    def next_exposure(self) -> float:
        """When the next image is taken [s]."""
        return min(stream.next_exposure for stream in self._streams.values())

    @property
    def next_arrival(self) -> float:
        """When the next image is available [s]; infinite if none is under way."""
        return self._arrivals[0][0] if self._arrivals else float("inf")

    def has_arrival_from(self, end: float) -> bool:
        """Whether an image that was taken by a time is still under way."""
        return any(exposed <= end + 1e-9 for _, exposed, _ in self._arrivals)

    def lose(self, camera: str) -> None:
        """No image comes any more."""
        self._streams[camera].lost = True

    def freeze(self, camera: str) -> None:
        """The last image comes again and again, with new times."""
        self._streams[camera].freezes = True

    def delay(self, camera: str, delay: float) -> None:
        """Images come later by a delay [s]."""
        self._streams[camera].delay = delay

    def expose(self, t: float, take: Expose, posture: Posture) -> list[Frame]:
        """Take the images that are due at time t, with the robot in a posture; returns them as they will arrive."""
        due = [stream for stream in self._streams.values() if stream.next_exposure <= t + 1e-9]
        for stream in due:
            stream.exposures += 1
        frames = take([stream.camera.name for stream in due if not stream.lost])
        sent = []
        for stream in due:
            if stream.lost:
                continue
            frame = frames[stream.camera.name]
            if stream.freezes:
                stream.frozen = stream.frozen or stream.last or frame
                frame = Frame(frame.camera, frame.t, stream.frozen.image)
            stream.last = frame
            self._pool.submit(frame, posture)
            arrival = t + stream.camera.latency + stream.delay
            heapq.heappush(self._arrivals, (arrival, frame.t, frame.camera))
            sent.append(frame)
        self.images += len(sent)
        return sent

    def collect(self, t: float) -> list[Sighting]:
        """What the images show that have arrived by time t, in the order of their exposure.

        Raises PerceptionError if a process that looks at them has crashed.
        """
        sightings = []
        while self._arrivals and self._arrivals[0][0] <= t + 1e-9:
            _, exposed, camera = heapq.heappop(self._arrivals)
            sighting = self._pool.collect(camera)
            self._streams[camera].newest = exposed
            self.seconds += sighting.seconds
            sightings.append(sighting)
        return sorted(sightings, key=lambda sighting: (sighting.t, sighting.camera))

    def failure(self, t: float) -> Unwatched | None:
        """The streams that have failed by time t, and how; None while all is well.

        Where some are lost and others late at the same time, the reason tells of those that are lost.
        """
        failed = [stream for stream in self._streams.values() if t > stream.fails_at + 1e-9]
        lost = [stream for stream in failed if not self._is_under_way(stream.camera.name)]
        if not failed:
            return None
        told = lost or failed
        cameras, verb = [stream.camera.name for stream in told], "is" if len(told) == 1 else "are"
        ages = listed(sorted({f"{t - stream.newest:.2f} s" for stream in told}))
        if lost:
            return Unwatched(f"{listed(cameras)} {verb} lost: no image for {ages}", "camera-loss", cameras)
        return Unwatched(
            f"the images of {listed(cameras)} come too late: the newest {verb} {ages} old", "latency", cameras
        )

    @property
    def next_check(self) -> float:
        """When a stream fails next if no image comes [s]."""
        return min(stream.fails_at for stream in self._streams.values()) + 1e-6

    def _is_under_way(self, camera: str) -> bool:
        return any(name == camera for _, _, name in self._arrivals)
