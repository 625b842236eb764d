"""The perception processes: each has some of the cameras, gets images and returns detections."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import NamedTuple

from sqrp_cli.errors import SqrpError
from sqrp_cli.platform.processes import Context, Worker, WorkerDied, fresh
from sqrp_cli.runtime.image import NEEDED, CameraImage
from sqrp_cli.runtime.perception.detections import BelievedState, CellModel, Detection, DetectionTargets
from sqrp_cli.runtime.perception.plugin import PluginError

ANSWER_WITHIN = 20.0
"""A process that takes longer than this for an image [s] counts as crashed."""


class PerceptionError(SqrpError):
    """A process that looks at images has ended or does not answer; `cameras` are those that it looked through."""

    def __init__(self, cameras: Sequence[str], reason: str) -> None:
        super().__init__(f"the process that looks at {', '.join(cameras)} {reason}")
        self.cameras = tuple(cameras)


class _ImageTask(NamedTuple):
    image: CameraImage
    believed: BelievedState


class DetectorPool(AbstractContextManager["DetectorPool"]):
    """Processes that look at images; a context manager. Images are looked at while the caller goes on."""

    def __init__(self, cell: CellModel, processes: int | None = None) -> None:
        """processes: at most one per camera; by default one per core."""
        context = fresh(NEEDED)
        names = list(cell.cameras)
        count = max(1, min(processes or os.cpu_count() or 1, len(names)))
        self._workers = [_Worker(context, cell, names[i::count]) for i in range(count)]
        self._of_camera = {name: worker for worker in self._workers for name in worker.cameras}

    def watch(self, sought: DetectionTargets) -> None:
        """Look for these targets in all images from now on. Raises PerceptionError if a process has crashed."""
        for worker in self._workers:
            worker.send(sought)

    def submit(self, image: CameraImage, believed: BelievedState) -> None:
        """Have an image looked at, with what was believed when it was taken."""
        self._of_camera[image.camera].send(_ImageTask(image, believed))

    def get_ready(self) -> None:
        """Wait until all processes have answered what they were asked. Raises PerceptionError if one has crashed."""
        for worker in self._workers:
            while worker.unanswered:
                worker.take()

    def is_free(self, camera: str) -> bool:
        """Whether the process that looks through a camera has nothing to do, so that `submit` returns at once."""
        worker = self._of_camera[camera]
        worker.take_all()
        return not worker.unanswered

    def is_ready(self, camera: str) -> bool:
        """Whether `collect` would answer at once. Raises PerceptionError if the process has crashed."""
        worker = self._of_camera[camera]
        while not worker.ready[camera] and worker.process.answered():
            worker.take()
        return bool(worker.ready[camera])

    def collect(self, camera: str) -> Detection:
        """What the oldest image of a camera that has not been collected shows.

        Waits until it is known. Raises PerceptionError if the process has crashed.
        """
        worker = self._of_camera[camera]
        while not worker.ready[camera]:
            worker.take()
        return worker.ready[camera].popleft()

    def crash(self, camera: str) -> None:
        """Kill the process that looks through a camera, for trials."""
        self._of_camera[camera].process.kill()

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.process.close()


class _Worker:
    """A process that looks through some of the cameras."""

    def __init__(self, context: Context, cell: CellModel, cameras: list[str]) -> None:
        self.cameras = cameras
        self.process = Worker[DetectionTargets | _ImageTask, Detection | None](context, _detectors, cell, cameras)
        self.ready: dict[str, deque[Detection]] = {name: deque() for name in cameras}
        self.unanswered = 0

    def send(self, message: DetectionTargets | _ImageTask) -> None:
        self.take_all()  # else both ends could wait for the other to read
        self.process.send(message)
        self.unanswered += 1

    def take_all(self) -> None:
        while self.process.answered():
            self.take()

    def take(self) -> None:
        try:
            detection = self.process.receive(ANSWER_WITHIN)
        except Exception as error:  # it died, or found what it cannot cope with
            self.process.kill()
            why = str(error) if isinstance(error, WorkerDied) else "has ended"
            why += f": {error}" if isinstance(error, PluginError) else ""
            raise PerceptionError(self.cameras, why) from error
        self.unanswered -= 1
        if detection is not None:
            self.ready[detection.camera].append(detection)


def _detectors(cell: CellModel, cameras: Sequence[str]) -> Callable[[DetectionTargets | _ImageTask], Detection | None]:
    """What looks through some of the cameras."""
    from sqrp_cli.runtime.perception.image_detector import ImageDetector

    detectors = {name: ImageDetector(cell.cameras[name], cell) for name in cameras}

    def answer(message: DetectionTargets | _ImageTask) -> Detection | None:
        if isinstance(message, _ImageTask):
            return detectors[message.image.camera].look(*message)
        for detector in detectors.values():
            detector.watch(message)
        return None

    return answer
