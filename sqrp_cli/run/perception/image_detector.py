"""Looks at images, those of one camera one by one, in processes that each have some of the cameras.

It says which boxes show their object, which show the background instead, and which cannot be judged.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, TypeAlias

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import BUILT_IN
from sqrp_cli.camera.projection import Projection
from sqrp_cli.errors import SqrpError
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, inverse
from sqrp_cli.logic.truth import Truth
from sqrp_cli.platform.processes import Context, Worker, WorkerDied, fresh
from sqrp_cli.run.image import NEEDED, CameraImage, ImageArray
from sqrp_cli.run.perception.detections import (
    NO_OUTLINE,
    BelievedState,
    BoxDetection,
    BoxQuestion,
    CellModel,
    Detection,
    DetectionTargets,
    complaint,
    load_detector,
    plugin_errors,
)
from sqrp_cli.run.perception.detectors import Background, color_detections, marker_detection
from sqrp_cli.run.perception.projected import ExpectedView, pieces_mask
from sqrp_cli.run.perception.vision import dilated, filled
from sqrp_cli.run.record.report import Stopped
from sqrp_cli.skill.target_box import TargetBox

ANSWER_WITHIN = 20.0
"""A process that takes longer than this for an image [s] counts as crashed."""
_ANSWER = bool | np.bool_ | None


class ImageDetector:
    """Looks at the images of one camera."""

    def __init__(self, camera: Camera, cell: CellModel) -> None:
        """cell: what is known of it beforehand. Raises SqrpError for a detector of a package that cannot be made."""
        self._camera, self._cell = camera, cell
        self._projection = Projection(camera)
        self._sought = DetectionTargets({}, {}, {})
        self._background: Background | None = None
        self._last: ImageArray | None = None
        kinds = dict.fromkeys(detector.kind for detector in cell.detectors.values() if detector.kind not in BUILT_IN)
        self._plugins: dict[str, Any] = {}
        for kind in kinds:
            make = load_detector(kind)
            with plugin_errors(kind, "failed"):
                self._plugins[kind] = make(camera)

    def watch(self, sought: DetectionTargets) -> None:
        """Look for these targets from now on."""
        if sought.targets.keys() != self._sought.targets.keys():
            # What was background until now may be what is looked for, and has perhaps been moved.
            self._background = None
        self._sought = sought

    def look(self, frame: CameraImage, believed: BelievedState) -> Detection:
        """What an image shows, with what was believed when it was taken."""
        began = time.process_time()
        if self._last is not None and np.array_equal(self._last, frame.image):
            return Detection(frame.camera, frame.t, frozen=True, seconds=time.process_time() - began)
        self._last = frame.image
        view = ExpectedView(self._cell, self._projection, self._sought, frame.image, believed)
        background = self._background
        if background is None:
            objects = [(self._cell.objects[name], X) for name, X in believed.X_WO.items()]
            outlines = [view.outline(X, obj.size) for obj, X in objects if not obj.fixed]
            movables = filled(view.whole, [outline.corners for outline in outlines if outline is not None])
            masks = (pieces_mask(view.whole, view.robot), view.sought_mask(), movables)
            moving = self._camera.frame != WORLD
            background = Background(view.image, *masks, moving=moving, shadows=self._cell.shadows)
            self._background = background
        elif not background.is_complete:
            robot = filled(view.whole, [part.hull for part in view.robot])  # all of it, and a little more
            background.learn(view.image, dilated(robot | view.sought_mask(), 3))
        boxes: dict[str, list[BoxDetection]] = {atom: [] for atom in view.sought.targets}
        places: dict[str, Array] = {}
        by_object: dict[str, list[tuple[str, TargetBox]]] = {}
        asked: dict[str, list[tuple[str, TargetBox]]] = {kind: [] for kind in self._plugins}
        for atom, box in view.boxes:
            obj, kind = view.object_of(atom, box), view.cell.detectors[box.detector].kind
            if kind in asked:
                asked[kind].append((atom, box))
            elif kind == "aruco":
                boxes[atom].append(marker_detection(view, background, atom, box))
            elif obj is None or obj.color is None:
                boxes[atom].append(BoxDetection(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE))
            else:
                by_object.setdefault(obj.name, []).append((atom, box))
        for name, wanted in by_object.items():
            told, position = color_detections(view, background, view.cell.objects[name], [box for _, box in wanted])
            for (atom, _), found in zip(wanted, told, strict=True):
                boxes[atom].append(found)
            if position is not None:
                places[name] = position
        for kind, wanted in asked.items():
            told = plugin_detections(kind, self._plugins[kind], view, wanted)
            for (atom, _), found in zip(wanted, told, strict=True):
                boxes[atom].append(found)
        seen = {atom: tuple(sights) for atom, sights in boxes.items()}
        return Detection(frame.camera, frame.t, False, seen, places, time.process_time() - began)


def plugin_detections(
    kind: str,
    plugin: Any,  # noqa: ANN401 - of any class
    view: ExpectedView,
    asked: Sequence[tuple[str, TargetBox]],
) -> list[BoxDetection]:
    """What a detector of an installed package sees of some boxes, each with its atom.

    Raises SqrpError where the package's code fails.
    """
    questions = [question_about(view, atom, box) for atom, box in asked]
    put = [question for question in questions if question is not None]
    with plugin_errors(kind, "failed"):
        said: object = plugin.look(view.image.copy(), put)
    answers = list(said) if isinstance(said, Sequence | np.ndarray) else None
    if answers is None or len(answers) != len(put) or not all(isinstance(one, _ANSWER) for one in answers):
        message = f"answered {len(put)} questions with {said!r:.80}; expected one True, False or None for each"
        raise SqrpError(complaint(kind, message))
    left, found = iter(answers), list[BoxDetection]()
    for (_, box), question in zip(asked, questions, strict=True):
        answer = None if question is None else next(left)
        evidence = Truth.UNKNOWN if answer is None else Truth.TRUE if answer else Truth.FALSE
        outline = NO_OUTLINE if question is None else question.outline
        found.append(BoxDetection(box.name, evidence, float(evidence is not Truth.UNKNOWN), outline))
    return found


def question_about(view: ExpectedView, atom: str, box: TargetBox) -> BoxQuestion | None:
    """The question about a box; None where it is not in the image."""
    outline = view.outline(view.pose(box), box.size)
    if outline is None or view.crop(outline.polygon, 0) is None:
        return None
    obj = view.object_of(atom, box)
    robot = pieces_mask(view.whole, view.robot, outline, without=box.encloses)
    return BoxQuestion(
        atom=atom,
        box=box.name,
        object=None if obj is None else obj.name,
        color=None if obj is None else obj.color,
        marker=view.marker(atom, box),
        size=box.size,
        X_CB=inverse(view.X_WC) @ view.pose(box),
        outline=outline.polygon,
        clear=filled(view.whole, [outline.corners]) & ~robot,
    )


_Task: TypeAlias = DetectionTargets | tuple[CameraImage, BelievedState]
"""What to look for from now on, or an image to look at, with what was believed when it was taken."""


class DetectorPool(AbstractContextManager["DetectorPool"]):
    """Processes that look at images; a context manager. Images are looked at while the caller goes on.

    Its methods raise Stopped, for a fault `perception-crash`, where a process has ended or does not answer.
    """

    def __init__(self, cell: CellModel, processes: int | None = None) -> None:
        """processes: at most one per camera; by default one per core."""
        context, names = fresh(NEEDED), list(cell.cameras)
        count = max(1, min(processes or os.cpu_count() or 1, len(names)))
        self._workers = [_Worker(context, cell, names[i::count]) for i in range(count)]
        self._of_camera = {name: worker for worker in self._workers for name in worker.ready}

    def watch(self, sought: DetectionTargets) -> None:
        """Look for these targets in all images from now on."""
        for worker in self._workers:
            worker.send(sought)

    def submit(self, image: CameraImage, believed: BelievedState) -> None:
        """Have an image looked at, with what was believed when it was taken."""
        self._of_camera[image.camera].send((image, believed))

    def get_ready(self) -> None:
        """Wait until all processes have answered what they were asked."""
        for worker in self._workers:
            worker.take(lambda one: one.unanswered == 0)

    def is_free(self, camera: str) -> bool:
        """Whether the process that looks through a camera has nothing to do, so that `submit` returns at once."""
        worker = self._of_camera[camera]
        worker.take()
        return not worker.unanswered

    def is_ready(self, camera: str) -> bool:
        """Whether `collect` would answer at once."""
        worker = self._of_camera[camera]
        worker.take()
        return bool(worker.ready[camera])

    def collect(self, camera: str) -> Detection:
        """What the oldest image of a camera that has not been collected shows; waits until it is known."""
        worker = self._of_camera[camera]
        worker.take(lambda one: bool(one.ready[camera]))
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
        self.process = Worker[_Task, Detection | None](context, _detectors, cell, cameras)
        self.unanswered, self.ready = 0, {name: deque[Detection]() for name in cameras}

    def send(self, message: _Task) -> None:
        self.take()  # else both ends could wait for the other to read
        self.process.send(message)
        self.unanswered += 1

    def take(self, until: Callable[[_Worker], bool] | None = None) -> None:
        """Receive what has been answered; or wait until something is so."""
        while self.process.pipe.poll() if until is None else not until(self):
            try:
                detection = self.process.receive(ANSWER_WITHIN)
            except Exception as error:  # it died, or found what it cannot cope with
                self.process.kill()
                why = str(error) if isinstance(error, WorkerDied) else "has ended"
                why += f": {error}" if isinstance(error, SqrpError) and not isinstance(error, WorkerDied) else ""
                names = ", ".join(self.ready)
                raise Stopped(f"the process that looks at {names} {why}", "perception-crash", self.ready) from error
            self.unanswered -= 1
            if detection is not None:
                self.ready[detection.camera].append(detection)


def _detectors(cell: CellModel, cameras: Sequence[str]) -> Callable[[_Task], Detection | None]:
    """What looks through some of the cameras."""
    detectors = {name: ImageDetector(cell.cameras[name], cell) for name in cameras}

    def answer(message: _Task) -> Detection | None:
        if isinstance(message, tuple):
            return detectors[message[0].camera].look(*message)
        for detector in detectors.values():
            detector.watch(message)
        return None

    return answer
