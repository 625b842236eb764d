"""Looks at images one by one: which boxes show their thing, which show the background instead, which cannot be judged.

An object is looked for where each of its boxes would show it, by its colour. It is at the tool if the patch of colour
lies where the tool would show it, to a few pixels; otherwise it rests where its patch is seen. Background counts as
such only if it is what the camera is known to show there, and the robot's own silhouette, known from its encoders, is
not in the way. What is neither thing nor background is not judged.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.projection import Projection
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.program import ProgramBox
from sqrp_cli.runtime.frame import Frame
from sqrp_cli.runtime.perception.backdrop import Backdrop
from sqrp_cli.runtime.perception.outlines import Outline, Silhouette, View
from sqrp_cli.runtime.perception.sighting import BoxSight, CellKnowledge, Evidence, Posture, Sighting, Watchlist
from sqrp_cli.runtime.perception.vision import (
    Corners,
    FoundMarker,
    Image,
    Mask,
    blobs,
    color_mask,
    dilated,
    direction,
    filled,
    find_markers,
)
from sqrp_cli.runtime.twin import OPEN_SHARE, START

NEEDED_SHARE = 0.35
"""Share of a box's outline that must be judged, of a coloured thing."""

FULL, EMPTY = 0.6, 0.1
"""A box is filled if at least this share of what is visible of it has the thing's colour, empty if at most this."""

SHIFT_PIXELS, SHIFT_SHARE = 2.0, 0.05
"""How far the patch of an object may lie from where the tool would show it: pixels, plus a share of its size there."""

LEAST_PIXELS = 4.0
"""Least square root of the area of an outline that can be judged [pixels]."""


@dataclass(frozen=True, eq=False)
class _Place:
    """A box in which an object may be, with what the image shows there.

    share: of the outline that was judged, without what parts that the box encloses hide of it. filled: share of its
    visible part that has the object's colour, without what has that colour anyway behind it. shift: of the patch of
    colour from where it would be if the object were there [pixels]; None without a patch.
    """

    outline: Outline | None
    share: float
    filled: float
    shift: Array | None

    @property
    def fits(self) -> bool:
        """Whether the object is here, as exactly as the image tells."""
        if self.outline is None or self.shift is None or self.filled < FULL:
            return False
        return bool(np.hypot(*self.shift) <= SHIFT_PIXELS + SHIFT_SHARE * self.outline.area**0.5)


_NOWHERE = _Place(None, 0.0, 0.0, None)


class Watcher:
    """Looks at the images of one camera."""

    def __init__(self, camera: Camera, cell: CellKnowledge) -> None:
        """cell: what is known of it beforehand."""
        self._camera, self._cell = camera, cell
        self._projection = Projection.of(camera)
        self._watchlist = Watchlist({}, {}, {})
        self._backdrop: Backdrop | None = None
        self._last: Image | None = None

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
        glance = _Glance(self._camera, self._cell, self._projection, self._watchlist, frame.image, posture)
        if self._backdrop is None:
            self._backdrop = glance.first_backdrop()
        elif not self._backdrop.is_complete:
            self._backdrop.learn(frame.image, glance.covered(3))
        boxes, places = glance.judge(self._backdrop)
        return Sighting(frame.camera, frame.t, False, boxes, places, time.process_time() - began)


class _Glance:
    """One image with everything that is known of its moment."""

    def __init__(
        self,
        camera: Camera,
        cell: CellKnowledge,
        projection: Projection,
        watchlist: Watchlist,
        image: Image,
        posture: Posture,
    ) -> None:
        self._camera, self._cell, self._watchlist = camera, cell, watchlist
        self._image, self._posture = image, posture
        self._X_WL = cell.twin.link_poses(posture.joints)
        X_WC = camera.X_FC if camera.frame == "world" else self._X_WL[camera.frame] @ camera.X_FC
        self._view = View(projection, X_WC)
        self._robot: Silhouette = self._view.silhouette(cell.twin.surfaces, self._X_WL)

    def first_backdrop(self) -> Backdrop:
        """The background, as far as this image shows it."""
        things = filled(self._view.shape, (0, 0), self._thing_polygons())
        robot = self._robot.mask(self._view.shape, (0, 0), np.inf)
        return Backdrop(self._image, robot, things, moving=self._camera.frame != "world")

    def covered(self, margin: int) -> Mask:
        """What the robot and the watched objects may cover, with a margin [pixels]."""
        shape = self._view.shape
        return dilated(self._robot.cover(shape) | filled(shape, (0, 0), self._thing_polygons()), margin)

    def judge(self, backdrop: Backdrop) -> tuple[dict[str, tuple[BoxSight, ...]], dict[str, Array]]:
        """What is seen of each box, by atom, and where objects are [m]."""
        boxes: dict[str, list[BoxSight]] = {atom: [] for atom in self._watchlist.targets}
        places: dict[str, Array] = {}
        by_thing: dict[str, list[tuple[str, ProgramBox]]] = {}
        for atom, box in self._boxes():
            thing = self._thing_of(atom, box)
            if self._cell.detectors[box.detector].kind == "aruco":
                boxes[atom].append(self._marker_sight(atom, box, backdrop))
            elif thing is None or thing.color is None:
                boxes[atom].append(_sight(box, _NOWHERE, Evidence.BLIND))
            else:
                by_thing.setdefault(thing.name, []).append((atom, box))
        for name, asked in by_thing.items():
            sights, place = self._object_sights(self._cell.objects[name], [box for _, box in asked], backdrop)
            for (atom, _), sight in zip(asked, sights, strict=True):
                boxes[atom].append(sight)
            if place is not None:
                places[name] = place
        return {atom: tuple(sights) for atom, sights in boxes.items()}, places

    def _object_sights(
        self, thing: SceneObject, boxes: list[ProgramBox], backdrop: Backdrop
    ) -> tuple[list[BoxSight], Array | None]:
        """What is seen of the boxes in which a coloured object may be, and where it is [m]."""
        colored = color_mask(self._image, thing.color or "")
        places = [self._place(box, thing, colored, backdrop) for box in boxes]
        poses = [self._pose(box) for box in boxes]
        at_tool = [self._is_at_tool(box) for box in boxes]
        position: Array | None = None
        held = [i for i, place in enumerate(places) if at_tool[i] and self._posture.holding and place.fits]
        if held:
            position = poses[held[0]][:3, 3]
        else:
            resting = [i for i, place in enumerate(places) if not at_tool[i] and place.filled > FULL / 2]
            if resting:
                best = max(resting, key=lambda i: places[i].filled)
                position = self._on_support(places[best], poses[best])
            elif not any(place.filled > EMPTY for place in places):
                position = self._elsewhere(thing, poses, at_tool, colored, backdrop)
        sights = []
        for i, (box, place) in enumerate(zip(boxes, places, strict=True)):
            evidence = Evidence.BLIND
            if place.outline is not None and place.share >= NEEDED_SHARE and place.outline.area >= LEAST_PIXELS**2:
                if position is not None:
                    inside = i in held if at_tool[i] else _is_inside(position, poses[i], box)
                    evidence = Evidence.SEEN if inside else Evidence.ABSENT
                elif place.filled <= EMPTY:
                    evidence = Evidence.ABSENT
            sights.append(_sight(box, place, evidence))
        return sights, position

    def _place(self, box: ProgramBox, thing: SceneObject, colored: Mask, backdrop: Backdrop) -> _Place:
        """What the image shows where an object would be if it were in a box."""
        X_WO = self._pose(box)
        outline = self._view.outline(X_WO, thing.size)
        if outline is None or outline.area <= 0.0:
            return _NOWHERE
        margin = max(6, round(0.6 * outline.area**0.5))
        crop = self._crop(outline.polygon, margin)
        if crop is None:
            return _Place(outline, 0.0, 0.0, None)
        rows, columns = crop
        shape, origin = (rows.stop - rows.start, columns.stop - columns.start), (columns.start, rows.start)
        silhouette = filled(shape, origin, [outline.corners])
        front = dilated(self._in_front(thing, X_WO, outline, shape, origin), 1)
        background = backdrop.matches(self._image, crop)
        own = colored[crop] & ~background
        behind = self._robot.mask(shape, origin, outline.depth, behind=True)
        background |= behind & backdrop.robot_colored(self._image, crop)
        visible = silhouette & ~front
        # Where the background has the object's own colour, the image cannot tell the one from the other.
        decided = visible & ~(background & colored[crop])
        judged = decided & (own | background)
        enclosed = silhouette & dilated(self._robot.mask(shape, origin, outline.depth, links=box.encloses), 1)
        askable = max(outline.area - float(enclosed.sum()), LEAST_PIXELS**2)
        share = float(judged.sum()) / askable
        if not decided.any():
            return _Place(outline, 0.0, 0.0, None)
        patch = dilated(silhouette, margin // 2) & ~front & own
        shift = _mean_pixel(patch) - _mean_pixel(decided) if patch.any() else None
        return _Place(outline, min(share, 1.0), float((decided & own).sum() / decided.sum()), shift)

    def _in_front(
        self, thing: SceneObject, X_WO: Array, outline: Outline, shape: tuple[int, int], origin: tuple[int, int]
    ) -> Mask:
        """What of the robot and of other objects is before an object, in a crop."""
        mask = self._robot.mask(shape, origin, outline.depth)
        steps = np.linspace(-0.45, 0.45, 3)
        grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) * thing.size
        points = grid @ X_WO[:3, :3].T + X_WO[:3, 3]
        for name, other in self._cell.objects.items():
            X = self._posture.X_WO.get(name)
            if name != thing.name and X is not None and self._view.hides(other, X, points):
                blocking = self._view.outline(X, other.size)
                mask |= True if blocking is None else filled(shape, origin, [blocking.corners])
        return mask

    def _on_support(self, place: _Place, X_WO: Array) -> Array:
        """Position of an object that rests as high as it would at a pose, by the ray to its patch [m]."""
        assert place.outline is not None and place.shift is not None  # noqa: S101, PT018
        position = self._at_height(place.outline.center + place.shift, float(X_WO[2, 3]))
        return X_WO[:3, 3] if position is None else position

    def _at_height(self, pixel: Array, height: float) -> Array | None:
        """Where the ray of a pixel is at a height [m]; None if it never is."""
        X_WC = self._view.X_WC
        ray = X_WC[:3, :3] @ direction(self._camera, pixel)
        distance = (height - X_WC[2, 3]) / ray[2] if abs(ray[2]) > 1e-6 else -1.0
        position: Array = X_WC[:3, 3] + distance * ray
        return position if distance > 0 else None

    def _elsewhere(
        self, thing: SceneObject, poses: list[Array], at_tool: list[bool], colored: Mask, backdrop: Backdrop
    ) -> Array | None:
        """Where an object lies that is in none of its boxes: the largest new patch of its colour that is big enough."""
        resting = [X for X, tool in zip(poses, at_tool, strict=True) if not tool]
        everything = (slice(0, self._view.shape[0]), slice(0, self._view.shape[1]))
        if not resting or not colored.any():
            return None
        new = colored & ~backdrop.matches(self._image, everything)
        found = blobs(new)
        if not found:
            return None
        position = self._at_height(found[0].center, float(resting[0][2, 3]))
        if position is None:
            return None
        X_WO = resting[0].copy()
        X_WO[:3, 3] = position
        expected = self._view.outline(X_WO, thing.size)
        return position if expected is not None and found[0].area >= NEEDED_SHARE * expected.area else None

    def _marker_sight(self, atom: str, box: ProgramBox, backdrop: Backdrop) -> BoxSight:
        """What is seen of a box with a marker."""
        outline = self._view.outline(self._pose(box), box.size)
        if outline is None:
            return _sight(box, _NOWHERE, Evidence.BLIND)
        wanted = self._marker_of(atom, box)
        found = next((marker for marker in find_markers(self._image) if marker.id == wanted), None)
        share = 0.0 if found is None else 1.0
        if box.frame in self._cell.markers:
            evidence = Evidence.BLIND if found is None else self._finger_evidence(atom, box, found)
        elif found is not None:
            near = np.hypot(*(found.corners.mean(axis=0) - outline.center)) <= max(0.5 * outline.area**0.5, 2.0)
            evidence = Evidence.SEEN if near else Evidence.ABSENT
        else:
            share = self._background_share(outline, backdrop)
            evidence = Evidence.ABSENT if share >= 1.0 - EMPTY else Evidence.BLIND
        return BoxSight(box.name, evidence, share, outline.polygon)

    def _finger_evidence(self, atom: str, box: ProgramBox, marker: FoundMarker) -> Evidence:
        """What a marker on a finger says: where it is between open and closed, if the atom is about the fingers."""
        fingers = self._cell.twin.fingers
        about_object = any(self._thing_of(atom, other) is not None for other in self._watchlist.targets[atom].boxes)
        if about_object or fingers is None:
            return Evidence.SEEN
        ends = []
        for posture in (fingers.open, fingers.closed):
            X_WL = self._cell.twin.link_poses(self._cell.twin.with_fingers(self._posture.joints, posture))
            outline = self._view.outline(X_WL[box.frame] @ np.array(box.pose), box.size)
            if outline is None:
                return Evidence.BLIND
            ends.append(outline.center)
        way = ends[1] - ends[0]
        if np.hypot(*way) * OPEN_SHARE < 1.0:
            return Evidence.BLIND  # too small in the image to tell open from closed
        closure = float((marker.corners.mean(axis=0) - ends[0]) @ way / (way @ way))
        return Evidence.SEEN if (closure <= OPEN_SHARE) == self._watchlist.when_open[atom] else Evidence.ABSENT

    def _background_share(self, outline: Outline, backdrop: Backdrop) -> float:
        """The share of an outline in which the background is seen and the robot is not."""
        crop = self._crop(outline.polygon, 2)
        if crop is None:
            return 0.0
        rows, columns = crop
        shape, origin = (rows.stop - rows.start, columns.stop - columns.start), (columns.start, rows.start)
        background = filled(shape, origin, [outline.corners]) & backdrop.matches(self._image, crop)
        background &= ~dilated(self._robot.mask(shape, origin, outline.depth), 1)
        return min(1.0, float(background.sum()) / max(outline.area, 1.0))

    def _marker_of(self, atom: str, box: ProgramBox) -> int | None:
        """The id of the marker that a box is for."""
        thing = self._thing_of(atom, box)
        on_links = [self._cell.markers[name].id for name in (*box.encloses, box.frame) if name in self._cell.markers]
        return next(iter(on_links), thing.marker if thing else None)

    def _boxes(self) -> Iterator[tuple[str, ProgramBox]]:
        for atom, target in self._watchlist.targets.items():
            for box in target.boxes:
                yield atom, box

    def _thing_of(self, atom: str, box: ProgramBox) -> SceneObject | None:
        """The object that a box is for: what it encloses, else, if that is nothing at all, what the atom is about."""
        inside = atom.partition("(")[2].rstrip(")").split(", ")
        names = (*box.encloses, box.frame.removesuffix(START), *(() if box.encloses else inside))
        return next((self._cell.objects[name] for name in names if name in self._cell.objects), None)

    def _is_at_tool(self, box: ProgramBox) -> bool:
        return box.frame in self._X_WL

    def _pose(self, box: ProgramBox) -> Array:
        """World pose of a box, (4, 4)."""
        if box.frame == "world":
            X_WF = np.eye(4)
        elif box.frame in self._X_WL:
            X_WF = self._X_WL[box.frame]
        elif box.frame.endswith(START):
            X_WF = self._watchlist.starts[box.frame.removesuffix(START)]
        else:
            X_WF = self._posture.X_WO[box.frame]
        X_WB: Array = X_WF @ np.array(box.pose)
        return X_WB

    def _crop(self, polygon: Array, margin: int) -> tuple[slice, slice] | None:
        """The part of the image around a polygon; None if they do not meet."""
        height, width = self._view.shape
        (left, top), (right, bottom) = polygon.min(axis=0) - margin, polygon.max(axis=0) + margin
        rows = slice(max(0, int(top)), min(height, int(bottom) + 1))
        columns = slice(max(0, int(left)), min(width, int(right) + 1))
        return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None

    def _thing_polygons(self) -> list[Corners]:
        """The outlines of the objects that are looked for, wherever they may be."""
        found = []
        for atom, box in self._boxes():
            thing = self._thing_of(atom, box)
            outline = self._view.outline(self._pose(box), thing.size if thing else box.size)
            if outline is not None:
                found.append(outline.corners)
        return found


def _is_inside(position: Array, X_WB: Array, box: ProgramBox) -> bool:
    offset = (position - X_WB[:3, 3]) @ X_WB[:3, :3]
    return bool((np.abs(offset) <= 0.5 * np.array(box.size)).all())


def _mean_pixel(mask: Mask) -> Array:
    """Mean (x, y) of the pixels of a mask that has some."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def _sight(box: ProgramBox, place: _Place, evidence: Evidence) -> BoxSight:
    outline = np.zeros((0, 2)) if place.outline is None else place.outline.polygon
    return BoxSight(box.name, evidence, place.share, outline)
