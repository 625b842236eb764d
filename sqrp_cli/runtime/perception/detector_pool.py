"""The processes that look at images: each has some of the cameras, gets frames and gives sightings back."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

from sqrp_cli.errors import SqrpError
from sqrp_cli.platform.processes import Context, Worker, fresh
from sqrp_cli.runtime.image import Frame
from sqrp_cli.runtime.perception.detections import CellKnowledge, Posture, Sighting, Watchlist
from sqrp_cli.runtime.processes import NEEDED

ANSWER_WITHIN = 20.0
"""A process that takes longer than this for an image [s] counts as crashed."""


class PerceptionError(SqrpError):
    """A process that looks at images has ended or does not answer; `cameras` are those that it looked through."""

    def __init__(self, cameras: Sequence[str], reason: str) -> None:
        super().__init__(f"the process that looks at {', '.join(cameras)} {reason}")
        self.cameras = tuple(cameras)


@dataclass(frozen=True, eq=False)
class _Look:
    frame: Frame
    posture: Posture


class PerceptionPool:
    """Processes that look at images; a context manager. Images are looked at while the caller goes on."""

    def __init__(self, cell: CellKnowledge, processes: int | None = None) -> None:
        """processes: at most one per camera; by default one per core."""
        context = fresh(NEEDED)
        names = list(cell.cameras)
        count = max(1, min(processes or os.cpu_count() or 1, len(names)))
        self._workers = [_Worker(context, cell, names[i::count]) for i in range(count)]
        self._of_camera = {name: worker for worker in self._workers for name in worker.cameras}

    def watch(self, watchlist: Watchlist) -> None:
        """Look for these targets in all frames that come from now on."""
        for worker in self._workers:
            worker.send(watchlist)

    def submit(self, frame: Frame, posture: Posture) -> None:
        """Have a frame looked at, taken with the robot in a posture."""
        self._of_camera[frame.camera].send(_Look(frame, posture))

    def collect(self, camera: str) -> Sighting:
        """What the oldest frame of a camera that has not been collected shows.

        Waits until it is known. Raises PerceptionError if the process has crashed.
        """
        return self._of_camera[camera].receive(camera)

    def crash(self, camera: str) -> None:
        """Kill the process that looks through a camera, for trials."""
        self._of_camera[camera].kill()

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()

    def __enter__(self) -> PerceptionPool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Worker:
    """A process that looks through some of the cameras."""

    def __init__(self, context: Context, cell: CellKnowledge, cameras: list[str]) -> None:
        self.cameras = cameras
        self._process = Worker[Watchlist | _Look, Sighting | None](context, _watchers, cell, cameras)
        self._ready: dict[str, deque[Sighting]] = {name: deque() for name in cameras}

    def send(self, message: Watchlist | _Look) -> None:
        while self._process.answered():  # else both ends could wait for the other to read
            self._take()
        self._process.send(message)

    def receive(self, camera: str) -> Sighting:
        waiting = self._ready[camera]
        while not waiting:
            if not self._process.answered(ANSWER_WITHIN):
                raise PerceptionError(self.cameras, "does not answer")
            self._take()
        return waiting.popleft()

    def _take(self) -> None:
        try:
            sighting = self._process.receive()
        except Exception as error:  # it died, or found what it cannot cope with
            self.kill()
            raise PerceptionError(self.cameras, "has ended") from error
        if sighting is not None:
            self._ready[sighting.camera].append(sighting)

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        self._process.close()


def _watchers(cell: CellKnowledge, cameras: Sequence[str]) -> Callable[[Watchlist | _Look], Sighting | None]:
    """What looks through some of the cameras."""
    from sqrp_cli.runtime.perception.image_detector import Watcher

    watchers = {name: Watcher(cell.cameras[name], cell) for name in cameras}

    def answer(message: Watchlist | _Look) -> Sighting | None:
        if isinstance(message, _Look):
            return watchers[message.frame.camera].look(message.frame, message.posture)
        for watcher in watchers.values():
            watcher.watch(message)
        return None

    return answer
