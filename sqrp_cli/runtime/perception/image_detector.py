"""Looks at the images of one camera, one by one.

It says which boxes show their object, which show the background instead, and which cannot be judged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from sqrp_cli.geometry import Array, inverse
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.detector import BUILT_IN
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.image import CameraImage, ImageArray
from sqrp_cli.runtime.perception import detections
from sqrp_cli.runtime.perception.background import Background
from sqrp_cli.runtime.perception.color_detector import ColorDetector
from sqrp_cli.runtime.perception.expected_view import ExpectedView
from sqrp_cli.runtime.perception.marker_detector import MarkerDetector
from sqrp_cli.runtime.perception.plugin import BoxQuestion, PluginError, complaint, load_detector, named
from sqrp_cli.runtime.perception.vision import filled

Done = TypeVar("Done")


class ImageDetector:
    """Looks at the images of one camera."""

    def __init__(self, camera: Camera, cell: detections.CellModel) -> None:
        """cell: what is known of it beforehand."""
        self._camera, self._cell = camera, cell
        self._projection = Projection.of(camera)
        self._sought = detections.DetectionTargets({}, {}, {})
        self._background: Background | None = None
        self._last: ImageArray | None = None
        kinds = dict.fromkeys(detector.kind for detector in cell.detectors.values() if detector.kind not in BUILT_IN)
        self._plugins = {kind: _PluginDetector(kind, camera) for kind in kinds}

    def watch(self, sought: detections.DetectionTargets) -> None:
        """Look for these targets from now on."""
        if sought.targets.keys() != self._sought.targets.keys():
            # What was background until now may be what is looked for, and has perhaps been moved.
            self._background = None
        self._sought = sought

    def look(self, frame: CameraImage, believed: detections.BelievedState) -> detections.Detection:
        """What an image shows, with what was believed when it was taken."""
        began = time.process_time()
        if self._last is not None and np.array_equal(self._last, frame.image):
            return detections.Detection(frame.camera, frame.t, frozen=True, seconds=time.process_time() - began)
        self._last = frame.image
        view = ExpectedView(self._cell, self._projection, self._sought, frame.image, believed)
        boxes, places = _judged(view, self._learned(view), self._plugins)
        return detections.Detection(frame.camera, frame.t, False, boxes, places, time.process_time() - began)

    def _learned(self, view: ExpectedView) -> Background:
        """The background, with what this image adds to what is known of it."""
        if self._background is None:
            moving = self._camera.frame != WORLD
            masks = (view.robot_mask(), view.sought_mask(), view.movables_mask())
            self._background = Background(view.image, *masks, moving=moving, shadows=self._cell.shadows)
        elif not self._background.is_complete:
            self._background.learn(view.image, view.covered(3))
        return self._background


def _judged(
    view: ExpectedView, background: Background, plugins: Mapping[str, _PluginDetector]
) -> tuple[dict[str, tuple[detections.BoxDetection, ...]], dict[str, Array]]:
    """What is seen of each box, by atom, and where objects are [m]."""
    boxes: dict[str, list[detections.BoxDetection]] = {atom: [] for atom in view.sought.targets}
    places: dict[str, Array] = {}
    by_object: dict[str, list[tuple[str, TargetBox]]] = {}
    asked: dict[str, list[tuple[str, TargetBox]]] = {kind: [] for kind in plugins}
    markers = MarkerDetector(view, background)
    for atom, box in view.boxes():
        obj, kind = view.object_of(atom, box), view.cell.detectors[box.detector].kind
        if kind in plugins:
            asked[kind].append((atom, box))
        elif kind == "aruco":
            boxes[atom].append(markers.detect(atom, box))
        elif obj is None or obj.color is None:
            boxes[atom].append(detections.BoxDetection(box.name, Truth.UNKNOWN, 0.0, detections.NO_OUTLINE))
        else:
            by_object.setdefault(obj.name, []).append((atom, box))
    for name, wanted in by_object.items():
        found, place = ColorDetector(view, background, view.cell.objects[name]).detect([box for _, box in wanted])
        for (atom, _), detection in zip(wanted, found, strict=True):
            boxes[atom].append(detection)
        if place is not None:
            places[name] = place
    for kind, wanted in asked.items():
        for (atom, _), detection in zip(wanted, plugins[kind].detect(view, wanted), strict=True):
            boxes[atom].append(detection)
    return {atom: tuple(sights) for atom, sights in boxes.items()}, places


class _PluginDetector:
    """Asks a detector of an installed package what the images of one camera show; see `plugin`."""

    def __init__(self, kind: str, camera: Camera) -> None:
        """Raises PluginError if it cannot be made."""
        self._kind = kind
        make = load_detector(kind)
        self._plugin = self._tried(lambda: make(camera))

    def detect(self, view: ExpectedView, asked: Sequence[tuple[str, TargetBox]]) -> list[detections.BoxDetection]:
        """What is seen of some boxes, each with its atom. Raises PluginError where the package's code fails."""
        questions = [question_about(view, atom, box) for atom, box in asked]
        put = [question for question in questions if question is not None]
        answers = iter(self._checked(self._tried(lambda: self._plugin.look(view.image.copy(), put)), len(put)))
        found = []
        for (_, box), question in zip(asked, questions, strict=True):
            evidence = _EVIDENCE[next(answers)] if question is not None else Truth.UNKNOWN
            outline = detections.NO_OUTLINE if question is None else question.outline
            found.append(detections.BoxDetection(box.name, evidence, float(evidence is not Truth.UNKNOWN), outline))
        return found

    def _tried(self, work: Callable[[], Done]) -> Done:
        try:
            return work()
        except Exception as error:  # it is somebody else's code
            raise PluginError(complaint(self._kind, f"failed: {named(error)}")) from error

    def _checked(self, answers: object, count: int) -> list[bool | None]:
        listed = list(answers) if isinstance(answers, Sequence | np.ndarray) else None
        known = [None if one is None else bool(one) for one in listed or () if isinstance(one, bool | np.bool_ | None)]
        if listed is None or len(listed) != count or len(known) != count:
            message = f"answered {count} questions with {answers!r:.80}; expected one True, False or None for each"
            raise PluginError(complaint(self._kind, message))
        return known


_EVIDENCE: Mapping[bool | None, Truth] = {True: Truth.TRUE, False: Truth.FALSE, None: Truth.UNKNOWN}


def question_about(view: ExpectedView, atom: str, box: TargetBox) -> BoxQuestion | None:
    """The question about a box; None where it is not in the image."""
    outline = view.posed_camera.outline(view.pose(box), box.size)
    if outline is None or view.crop(outline.polygon, 0) is None:
        return None
    obj = view.object_of(atom, box)
    whole = view.posed_camera.whole
    robot = view.robot.mask(whole, outline, without=box.encloses)
    return BoxQuestion(
        atom=atom,
        box=box.name,
        object=None if obj is None else obj.name,
        color=None if obj is None else obj.color,
        marker=view.marker(atom, box),
        size=box.size,
        X_CB=inverse(view.posed_camera.X_WC) @ view.pose(box),
        outline=outline.polygon,
        clear=filled(whole, [outline.corners]) & ~robot,
    )
