"""The perception processes: each has some of the cameras, gets images and returns detections."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class _ImageTask:
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
            worker.answer_all()

    def is_free(self, camera: str) -> bool:
        """Whether the process that looks through a camera has nothing to do, so that `submit` returns at once."""
        return self._of_camera[camera].is_free()

    def is_ready(self, camera: str) -> bool:
        """Whether `collect` would answer at once. Raises PerceptionError if the process has crashed."""
        return self._of_camera[camera].is_ready(camera)

    def collect(self, camera: str) -> Detection:
        """What the oldest image of a camera that has not been collected shows.

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

    def __exit__(self, *_: object) -> None:
        self.close()


class _Worker:
    """A process that looks through some of the cameras."""

    def __init__(self, context: Context, cell: CellModel, cameras: list[str]) -> None:
        self.cameras = cameras
        self._process = Worker[DetectionTargets | _ImageTask, Detection | None](context, _detectors, cell, cameras)
        self._ready: dict[str, deque[Detection]] = {name: deque() for name in cameras}
        self._unanswered = 0

    def send(self, message: DetectionTargets | _ImageTask) -> None:
        while self._process.answered():  # else both ends could wait for the other to read
            self._take()
        self._process.send(message)
        self._unanswered += 1

    def answer_all(self) -> None:
        while self._unanswered:
            self._take()

    def is_free(self) -> bool:
        while self._process.answered():
            self._take()
        return not self._unanswered

    def is_ready(self, camera: str) -> bool:
        while not self._ready[camera] and self._process.answered():
            self._take()
        return bool(self._ready[camera])

    def receive(self, camera: str) -> Detection:
        waiting = self._ready[camera]
        while not waiting:
            self._take()
        return waiting.popleft()

    def _take(self) -> None:
        try:
            detection = self._process.receive(ANSWER_WITHIN)
        except Exception as error:  # it died, or found what it cannot cope with
            self.kill()
            why = str(error) if isinstance(error, WorkerDied) else "has ended"
            why += f": {error}" if isinstance(error, PluginError) else ""
            raise PerceptionError(self.cameras, why) from error
        self._unanswered -= 1
        if detection is not None:
            self._ready[detection.camera].append(detection)

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        self._process.close()


def _detectors(cell: CellModel, cameras: Sequence[str]) -> Callable[[DetectionTargets | _ImageTask], Detection | None]:
    """What looks through some of the cameras."""
    from sqrp_cli.runtime.perception.image_detector import ImageDetector

    detectors = {name: ImageDetector(cell.cameras[name], cell) for name in cameras}

    def answer(message: DetectionTargets | _ImageTask) -> Detection | None:
        if isinstance(message, _ImageTask):
            return detectors[message.image.camera].look(message.image, message.believed)
        for detector in detectors.values():
            detector.watch(message)
        return None

    return answer
