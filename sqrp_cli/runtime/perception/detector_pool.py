"""The processes that look at images: each has some of the cameras, gets frames and gives sightings back."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from types import TracebackType

from sqrp_cli.errors import SqrpError
from sqrp_cli.runtime.image import Frame
from sqrp_cli.runtime.perception.detections import CellKnowledge, Posture, Sighting, Watchlist
from sqrp_cli.runtime.processes import process_context, without_interrupts

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
        context = process_context()
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
    def __init__(self, context: ForkServerContext | SpawnContext, cell: CellKnowledge, cameras: list[str]) -> None:
        self.cameras = cameras
        self._connection, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs, cell, cameras), daemon=True)
        with without_interrupts():
            self._process.start()
        theirs.close()
        self._ready: dict[str, list[Sighting]] = {name: [] for name in cameras}

    def send(self, message: Watchlist | _Look) -> None:
        try:
            while self._connection.poll():  # else both ends could wait for the other to read
                self._take()
            self._connection.send(message)
        except (EOFError, OSError) as error:
            raise PerceptionError(self.cameras, "has ended") from error

    def receive(self, camera: str) -> Sighting:
        waiting = self._ready[camera]
        while not waiting:
            try:
                if not self._connection.poll(ANSWER_WITHIN):
                    raise PerceptionError(self.cameras, "does not answer")
                self._take()
            except (EOFError, OSError) as error:
                raise PerceptionError(self.cameras, "has ended") from error
        return waiting.pop(0)

    def _take(self) -> None:
        sighting: Sighting = self._connection.recv()
        self._ready[sighting.camera].append(sighting)

    def kill(self) -> None:
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        self._connection.close()
        self._process.join(1.0)
        if self._process.is_alive():
            self.kill()


def _serve(connection: Connection, cell: CellKnowledge, cameras: Sequence[str]) -> None:
    """Look at what comes, until the connection closes."""
    from sqrp_cli.runtime.perception.image_detector import Watcher

    watchers: Mapping[str, Watcher] = {name: Watcher(cell.cameras[name], cell) for name in cameras}
    try:
        while True:
            message: Watchlist | _Look = connection.recv()
            if isinstance(message, Watchlist):
                for watcher in watchers.values():
                    watcher.watch(message)
            else:
                connection.send(watchers[message.frame.camera].look(message.frame, message.posture))
    except (EOFError, OSError):
        return
