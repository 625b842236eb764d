"""Looks at the images of one camera, one by one.

It says which boxes show their thing, which show the background instead, and which cannot be judged.
"""

from __future__ import annotations

import time

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.image import Frame, Pixels
from sqrp_cli.runtime.perception.background import Backdrop
from sqrp_cli.runtime.perception.color_detector import ThingSearch
from sqrp_cli.runtime.perception.detections import NO_OUTLINE, BoxSight, CellKnowledge, Posture, Sighting, Watchlist
from sqrp_cli.runtime.perception.expected_view import Glance
from sqrp_cli.runtime.perception.marker_detector import MarkerSearch


class Watcher:
    """Looks at the images of one camera."""

    def __init__(self, camera: Camera, cell: CellKnowledge) -> None:
        """cell: what is known of it beforehand."""
        self._camera, self._cell = camera, cell
        self._projection = Projection.of(camera)
        self._watchlist = Watchlist({}, {}, {})
        self._backdrop: Backdrop | None = None
        self._last: Pixels | None = None

    def watch(self, watchlist: Watchlist) -> None:
        """Look for these targets from now on."""
        if watchlist.targets.keys() != self._watchlist.targets.keys():
            self._backdrop = None  # what was background until now may be what is looked for, and has perhaps been moved
        self._watchlist = watchlist

    def look(self, frame: Frame, posture: Posture) -> Sighting:
        """What an image shows, taken with the robot in a posture."""
        began = time.process_time()
        if self._last is not None and np.array_equal(self._last, frame.image):
            return Sighting(frame.camera, frame.t, frozen=True, seconds=time.process_time() - began)
        self._last = frame.image
        glance = Glance(self._camera, self._cell, self._projection, self._watchlist, frame.image, posture)
        boxes, places = _judged(glance, self._learned(glance))
        return Sighting(frame.camera, frame.t, False, boxes, places, time.process_time() - began)

    def _learned(self, glance: Glance) -> Backdrop:
        """The background, with what this image adds to what is known of it."""
        if self._backdrop is None:
            moving = self._camera.frame != WORLD
            masks = (glance.robot_mask(), glance.things_mask(), glance.movables_mask())
            self._backdrop = Backdrop(glance.image, *masks, moving=moving)
        elif not self._backdrop.is_complete:
            self._backdrop.learn(glance.image, glance.covered(3))
        return self._backdrop


def _judged(glance: Glance, backdrop: Backdrop) -> tuple[dict[str, tuple[BoxSight, ...]], dict[str, Array]]:
    """What is seen of each box, by atom, and where objects are [m]."""
    boxes: dict[str, list[BoxSight]] = {atom: [] for atom in glance.watchlist.targets}
    places: dict[str, Array] = {}
    by_thing: dict[str, list[tuple[str, TargetBox]]] = {}
    markers = MarkerSearch(glance, backdrop)
    for atom, box in glance.boxes():
        thing = glance.thing_of(atom, box)
        if glance.cell.detectors[box.detector].kind == "aruco":
            boxes[atom].append(markers.sight(atom, box))
        elif thing is None or thing.color is None:
            boxes[atom].append(BoxSight(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE))
        else:
            by_thing.setdefault(thing.name, []).append((atom, box))
    for name, asked in by_thing.items():
        sights, place = ThingSearch(glance, backdrop, glance.cell.objects[name]).sights([box for _, box in asked])
        for (atom, _), sight in zip(asked, sights, strict=True):
            boxes[atom].append(sight)
        if place is not None:
            places[name] = place
    return {atom: tuple(sights) for atom, sights in boxes.items()}, places
