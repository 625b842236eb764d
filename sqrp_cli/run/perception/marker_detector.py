"""Looks for ArUco markers in an image: on objects, and on fingers, where they show how far these are closed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception.background import Background
from sqrp_cli.run.perception.detections import NO_OUTLINE, BoxDetection, MissReason
from sqrp_cli.run.perception.projected import ExpectedView, ProjectedBox
from sqrp_cli.run.perception.vision import FoundMarker, dilated, filled, markers_beside
from sqrp_cli.run.robot_body import OPEN_SHARE
from sqrp_cli.skill.target_box import TargetBox

ABSENT_SHARE = 0.9
"""Share of a marker's outline in which the background must be seen for the marker to be absent."""

AROUND = 0.5
"""How much of the image around a marker is looked at again, as a share of the marker's size in it."""


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
        on_finger = box.frame in view.cell.markers
        opened, step = self._finger_way(box, outline) if on_finger else (outline.center, np.zeros(2))

        def closure(marker: FoundMarker) -> float:
            """How far the fingers are closed by a marker that they carry: 0 open, 1 closed."""
            return float((marker.center - opened) @ step / max(float(step @ step), 1e-9))

        def nearest(markers: Iterable[FoundMarker]) -> FoundMarker | None:
            """The marker of the box among several: that on a finger lies where the fingers can carry it."""
            found = [marker for marker in markers if wanted is not None and marker.id == wanted.id]
            if on_finger:  # to half the size of the outline
                ways = [opened + np.clip(closure(marker), 0.0, 1.0) * step for marker in found]
                off = [np.hypot(*(marker.center - way)) for marker, way in zip(found, ways, strict=True)]
                found = [marker for marker, far in zip(found, off, strict=True) if far <= 0.5 * outline.area**0.5]
            return min(found, key=lambda marker: np.hypot(*(marker.center - outline.center)), default=None)

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
        if on_finger:
            sought, robot, evidence = view.sought, view.cell.robot, Truth.UNKNOWN
            about_object = any(view.object_of(atom, other) is not None for other in sought.targets[atom].boxes)
            if found is not None and (about_object or robot.fingers is None):
                evidence = Truth.TRUE
            elif found is not None and np.hypot(*step) * OPEN_SHARE >= 1.0:  # else too small to tell open from closed
                is_open = closure(found) <= OPEN_SHARE
                evidence = Truth.TRUE if is_open == sought.when_open[atom] else Truth.FALSE
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

    def _finger_way(self, box: TargetBox, outline: ProjectedBox) -> tuple[Array, Array]:
        """Where open fingers carry a marker in the image, and the way to where closed ones do, (2,) [pixels] each.

        The way is 0 where they do not move it, or nobody can tell how far they are closed.
        """
        robot, ends = self._view.cell.robot, list[ProjectedBox | None]()
        for fingers in (robot.fingers.open, robot.fingers.closed) if robot.fingers is not None else ():
            X_WL = robot.link_poses(robot.with_fingers(self._view.believed.joints, fingers))
            ends.append(self._view.posed_camera.outline(X_WL[box.frame] @ box.X_FB, box.size))
        centers = [end.center for end in ends if end is not None]
        return (centers[0], centers[1] - centers[0]) if len(centers) == 2 else (outline.center, np.zeros(2))
