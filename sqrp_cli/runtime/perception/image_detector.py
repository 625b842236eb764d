"""Looks at the images of one camera, one by one.

It says which boxes show their object, which show the background instead, and which cannot be judged.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from sqrp_cli.geometry import Array
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
from sqrp_cli.runtime.perception.plugin_detector import PluginDetector


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
        self._plugins = {kind: PluginDetector(kind, camera) for kind in kinds}

    def watch(self, sought: detections.DetectionTargets) -> None:
        """Look for these targets from now on."""
        if sought.targets.keys() != self._sought.targets.keys():
            self._background = (
                None  # what was background until now may be what is looked for, and has perhaps been moved
            )
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
    view: ExpectedView, background: Background, plugins: Mapping[str, PluginDetector]
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
