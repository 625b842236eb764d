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
from sqrp_cli.platform.processes import Worker, WorkerDied, fresh
from sqrp_cli.run.image import NEEDED, CameraImage, ImageArray
from sqrp_cli.run.perception.detections import (
    NO_OUTLINE,
    BelievedState,
    BoxDetection,
    BoxQuestion,
    CellModel,
    Detection,
    DetectionTargets,
    load_detector,
    plugin_errors,
)
from sqrp_cli.run.perception.detectors import Background, color_detections, marker_detection
from sqrp_cli.run.perception.projected import ExpectedView, pieces_mask
from sqrp_cli.run.perception.vision import dilated, filled
from sqrp_cli.run.record.report import Stopped
from sqrp_cli.skill.target_box import TargetBox

ANSWER_WITHIN = 20.0  # A process that takes longer than this for an image [s] counts as crashed
_ANSWER = bool | np.bool_ | None
Asked: TypeAlias = tuple[str, TargetBox]  # A box to look at, after the atom that it decides


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
        elif background.unknown.any():
            robot = filled(view.whole, [part.hull for part in view.robot])  # all of it, and a little more
            background.learn(view.image, dilated(robot | view.sought_mask(), 3))
        boxes: dict[str, list[BoxDetection]] = {atom: [] for atom in view.sought.targets}
        places: dict[str, Array] = {}
        # By the kind of a detector and, for our own, the object. Those of packages get every image, asked or not.
        together: dict[tuple[str, str], list[Asked]] = {(kind, ""): [] for kind in self._plugins}
        for atom, box in view.boxes:
            obj, kind = view.object_of(atom, box), view.cell.detectors[box.detector].kind
            if kind in self._plugins:
                together[kind, ""].append((atom, box))
            elif kind == "aruco":
                boxes[atom].append(marker_detection(view, background, atom, box))
            elif obj is None or obj.color is None:
                boxes[atom].append(BoxDetection(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE))
            else:
                together.setdefault(("color", obj.name), []).append((atom, box))
        for (kind, name), asked in together.items():
            if kind in self._plugins:
                told = plugin_detections(kind, self._plugins[kind], view, asked)
            else:
                told, position = color_detections(view, background, view.cell.objects[name], [box for _, box in asked])
                places |= {} if position is None else {name: position}
            for (atom, _), found in zip(asked, told, strict=True):
                boxes[atom].append(found)
        seen = {atom: tuple(sights) for atom, sights in boxes.items()}
        return Detection(frame.camera, frame.t, False, seen, places, time.process_time() - began)


def plugin_detections(
    kind: str,
    plugin: Any,  # noqa: ANN401 - of any class
    view: ExpectedView,
    asked: Sequence[Asked],
) -> list[BoxDetection]:
    """What a detector of an installed package sees of some boxes, each with its atom.

    Raises SqrpError where the package's code fails.
    """
    questions: dict[int, BoxQuestion] = {}  # by the index of the box, of those that are in the image
    for index, (atom, box) in enumerate(asked):
        outline, obj = view.outline(view.pose(box), box.size), view.object_of(atom, box)
        if outline is not None and view.crop(outline.polygon, 0) is not None:
            robot = pieces_mask(view.whole, view.robot, outline, without=box.encloses)
            questions[index] = BoxQuestion(
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
    with plugin_errors(kind, "failed"):
        said: object = plugin.look(view.image.copy(), list(questions.values()))
        answers = list(said) if isinstance(said, Sequence | np.ndarray) else None
        if answers is None or len(answers) != len(questions) or not all(isinstance(one, _ANSWER) for one in answers):
            problem = f"answered {len(questions)} questions with {said!r:.80}"
            raise SqrpError(f"{problem}; expected one True, False or None for each")
    found = [BoxDetection(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE) for _, box in asked]
    for (index, question), answer in zip(questions.items(), answers, strict=True):
        evidence = Truth.UNKNOWN if answer is None else Truth.TRUE if answer else Truth.FALSE
        found[index] = BoxDetection(question.box, evidence, float(answer is not None), question.outline)
    return found


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
        self._processes = [
            Worker[_Task, Detection | None](context, _detectors, cell, names[i::count]) for i in range(count)
        ]
        self._unanswered = [0] * count
        self._of_camera = {name: i % count for i, name in enumerate(names)}
        self._ready = {name: deque[Detection]() for name in names}

    def watch(self, sought: DetectionTargets) -> None:
        """Look for these targets in all images from now on."""
        for number in range(len(self._processes)):
            self._send(number, sought)

    def submit(self, image: CameraImage, believed: BelievedState) -> None:
        """Have an image looked at, with what was believed when it was taken."""
        self._send(self._of_camera[image.camera], (image, believed))

    def get_ready(self) -> None:
        """Wait until all processes have answered what they were asked."""
        for number in range(len(self._processes)):
            while self._unanswered[number]:
                self._receive(number)

    def is_free(self, camera: str) -> bool:
        """Whether the process that looks through a camera has nothing to do, so that `submit` returns at once."""
        self.is_ready(camera)
        return not self._unanswered[self._of_camera[camera]]

    def is_ready(self, camera: str) -> bool:
        """Whether `collect` would answer at once."""
        number = self._of_camera[camera]
        while self._processes[number].pipe.poll():
            self._receive(number)
        return bool(self._ready[camera])

    def collect(self, camera: str) -> Detection:
        """What the oldest image of a camera that has not been collected shows; waits until it is known."""
        while not self._ready[camera]:
            self._receive(self._of_camera[camera])
        return self._ready[camera].popleft()

    def crash(self, camera: str) -> None:
        """Kill the process that looks through a camera, for trials."""
        self._processes[self._of_camera[camera]].kill()

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        for process in self._processes:
            process.close()

    def _send(self, number: int, task: _Task) -> None:
        """Send a process a task; it has been listened to before: else both could wait for the other to read."""
        while self._processes[number].pipe.poll():
            self._receive(number)
        self._processes[number].send(task)
        self._unanswered[number] += 1

    def _receive(self, number: int) -> None:
        """Wait for the next answer of a process."""
        try:
            detection = self._processes[number].receive(ANSWER_WITHIN)
        except Exception as error:  # it died, or found what it cannot cope with
            self._processes[number].kill()
            why = str(error) if isinstance(error, WorkerDied) else "has ended"
            why += f": {error}" if isinstance(error, SqrpError) and not isinstance(error, WorkerDied) else ""
            cameras = [name for name, of in self._of_camera.items() if of == number]
            message = f"the process that looks at {', '.join(cameras)} {why}"
            raise Stopped(message, "perception-crash", cameras) from error
        self._unanswered[number] -= 1
        if detection is not None:
            self._ready[detection.camera].append(detection)


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
