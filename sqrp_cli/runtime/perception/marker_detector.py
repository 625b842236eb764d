"""Looks for ArUco markers in an image: on objects, and on fingers, where they show how far these are closed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.perception.background import Background
from sqrp_cli.runtime.perception.detections import NO_OUTLINE, BoxDetection, MissReason
from sqrp_cli.runtime.perception.projected import ExpectedView, ProjectedBox
from sqrp_cli.runtime.perception.vision import FoundMarker, dilated, filled, markers_beside
from sqrp_cli.runtime.robot_body import OPEN_SHARE

ABSENT_SHARE = 0.9
"""Share of a marker's outline in which the background must be seen for the marker to be absent."""

AROUND = 0.5
"""How much of the image around a marker is looked at again, as a share of the marker's size in it."""


class _FingerWay(NamedTuple):
    """Where a marker on a finger may be in the image: (2,) [pixels] each."""

    opened: Array
    closed: Array

    @property
    def step(self) -> Array:
        """From one end to the other."""
        return self.closed - self.opened

    def closure(self, marker: FoundMarker) -> float:
        """How far the fingers are closed by a marker: 0 open, 1 closed."""
        return float((marker.center - self.opened) @ self.step / max(float(self.step @ self.step), 1e-9))

    def carries(self, marker: FoundMarker, outline: ProjectedBox) -> bool:
        """Whether a marker lies on it, to half the size of the marker's outline."""
        nearest = self.opened + np.clip(self.closure(marker), 0.0, 1.0) * self.step
        return bool(np.hypot(*(marker.center - nearest)) <= 0.5 * outline.area**0.5)


class MarkerDetector:
    """The search for markers in one image."""

    def __init__(self, view: ExpectedView, background: Background) -> None:
        self._view, self._background = view, background

    def detect(self, atom: str, box: TargetBox) -> BoxDetection:
        """What is seen of a box with a marker."""
        view = self._view
        outline = view.posed_camera.outline(view.pose(box), box.size)
        if outline is None:
            return BoxDetection(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE)
        wanted = view.marker(atom, box)
        way = self._finger_way(box, outline) if box.frame in view.cell.markers else None

        def nearest(markers: Iterable[FoundMarker]) -> FoundMarker | None:
            """The marker of the box among several: that on a finger lies where the fingers can carry it."""
            alike = (marker for marker in markers if wanted is not None and marker.id == wanted.id)
            carried = (marker for marker in alike if way is None or way.carries(marker, outline))
            return min(carried, key=lambda marker: np.hypot(*(marker.center - outline.center)), default=None)

        found, because = None if wanted is None else nearest(view.markers(wanted.dictionary)), MissReason.DETECTOR
        crop = view.crop(outline.polygon, round(AROUND * outline.area**0.5)) if found is None else None
        if crop is not None:
            # What of the robot is before the box, other than what carries the marker, may touch this in the image.
            others = {surface.parent for surface in view.cell.robot.surfaces} - {box.frame, *box.encloses}
            hiding = dilated(view.robot.mask(crop, outline, links=others), 1)
            if (hiding & filled(crop, [outline.corners])).any():
                if wanted is not None:
                    beside = markers_beside(view.image[crop], hiding, wanted.dictionary)
                    found = nearest(FoundMarker(one.id, one.corners + crop.origin) for one in beside)
                because = MissReason.MASK if found is None else because
        share = 0.0 if found is None else 1.0
        if way is not None:
            evidence = Truth.UNKNOWN if found is None else self._on_finger(atom, way, found)
        elif found is not None:
            near = np.hypot(*(found.center - outline.center)) <= max(0.5 * outline.area**0.5, 2.0)
            evidence = Truth.TRUE if near else Truth.FALSE
        else:
            # The share of the outline in which the background is seen and the robot is not.
            if (crop := view.crop(outline.polygon, 2)) is not None:
                background = filled(crop, [outline.corners]) & self._background.matches(view.image, crop)
                background &= ~dilated(view.robot.mask(crop, outline), 1)
                share = min(1.0, float(background.sum()) / max(outline.area, 1.0))
            evidence = Truth.FALSE if share >= ABSENT_SHARE else Truth.UNKNOWN
        return BoxDetection(box.name, evidence, share, outline.polygon, because)

    def _finger_way(self, box: TargetBox, outline: ProjectedBox) -> _FingerWay:
        """The way in the image on which the fingers carry a marker; a point where they do not move it."""
        robot = self._view.cell.robot
        if robot.fingers is None:
            return _FingerWay(outline.center, outline.center)
        ends = []
        for fingers in (robot.fingers.open, robot.fingers.closed):
            X_WL = robot.link_poses(robot.with_fingers(self._view.believed.joints, fingers))
            ends.append(self._view.posed_camera.outline(X_WL[box.frame] @ box.X_FB, box.size))
        opened, closed = ends
        if opened is None or closed is None:  # nobody can tell how far they are closed
            return _FingerWay(outline.center, outline.center)
        return _FingerWay(opened.center, closed.center)

    def _on_finger(self, atom: str, way: _FingerWay, marker: FoundMarker) -> Truth:
        """What a marker on a finger says: where it is between open and closed, if the atom is about the fingers."""
        sought = self._view.sought
        about_object = any(self._view.object_of(atom, other) is not None for other in sought.targets[atom].boxes)
        if about_object or self._view.cell.robot.fingers is None:
            return Truth.TRUE
        if np.hypot(*way.step) * OPEN_SHARE < 1.0:
            return Truth.UNKNOWN  # too small in the image to tell open from closed
        return Truth.TRUE if (way.closure(marker) <= OPEN_SHARE) == sought.when_open[atom] else Truth.FALSE
