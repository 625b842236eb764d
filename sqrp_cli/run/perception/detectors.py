"""Looks for coloured objects and ArUco markers in an image, before a background that proves that they are absent.

A coloured object is at the tool if the patch of its colour lies where the tool would show it, to a few pixels;
otherwise it rests where its patch is seen. Background counts as such only where the object itself would be seen, if it
is what the camera is known to show there and the robot's own silhouette, known from its encoders, is not in the way.
What is neither object nor background is not judged. Markers on fingers show how far these are closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from sqrp_cli.camera import detector
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import Array, Mask, pose, transform
from sqrp_cli.logic.truth import Truth
from sqrp_cli.records import dataclass
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.detections import NO_OUTLINE, BoxDetection, MissReason
from sqrp_cli.run.perception.projected import ExpectedView, ProjectedObject, pieces_mask
from sqrp_cli.run.perception.vision import (
    Crop,
    FoundMarker,
    color_mask,
    dilated,
    displacement,
    filled,
    find_markers,
    inpainted,
    largest_blob,
    same_color,
)
from sqrp_cli.run.robot_body import OPEN_SHARE
from sqrp_cli.skill.target_box import TargetBox

TOLERANCE = 24
"""Largest difference of a colour channel (of 255) from the background; covers noise and mild changes of light."""
SHADE_TOLERANCE = 0.12  # How much of a pixel's brightness may be of another hue in a shade of the background
COLOR_BITS = 4  # Bits per channel of the coarse colours that make up the robot's palette
LEAST_PALETTE_SHARE = 5e-4  # Share of the robot's pixels that a coarse colour must have to belong to its palette
ABSENT_SHARE = 0.9  # Share of a marker's outline in which the background must be seen for the marker to be absent
AROUND = 0.5  # How much of the image around a marker is looked at again, as a share of the marker's size in it


class Background:
    """Learns, from the images of one camera, the picture of what never moves, and the colours of the robot.

    What the robot or a watched object covers in the first image is guessed from its surroundings until it is seen.
    For a camera that moves there is no such picture: colours of what surrounds the robot stand for it.
    """

    def __init__(
        self, image: ImageArray, robot: Mask, sought: Mask, movables: Mask, *, moving: bool, shadows: bool = False
    ) -> None:
        """robot, sought, movables: what the robot, watched and movable objects cover in the first image.

        shadows: whether shadows may fall on the background, so that a darker or lighter shade of it is background too.
        Objects may stand before the robot: their colours are not the robot's. What looks like the watched one in one
        place must not count as surroundings in another.
        """
        objects, self._shadows = sought | movables, shadows
        self._palette = _palette(image[robot & ~dilated(objects, 2)])
        self._surroundings = _palette(image[~(robot | objects)]) if moving else None
        self.unknown: Mask = dilated(robot | sought, 3) & (not moving)
        """What is still to be learned."""
        self._picture = image if moving else inpainted(image, self.unknown)
        self._news = np.zeros_like(self.unknown)

    def learn(self, image: ImageArray, covered: Mask) -> None:
        """Take from an image what was still unknown and is not covered in it."""
        fresh: Mask = self.unknown & ~covered
        self._picture[fresh] = image[fresh]
        self.unknown &= covered
        self._news |= fresh

    def matches(self, image: ImageArray, crop: Crop) -> Mask:
        """Which pixels of a crop show the background."""
        part = image[crop]
        if self._surroundings is not None:
            return self._surroundings[_coarse(part)]
        return same_color(part, self._picture[crop], TOLERANCE, SHADE_TOLERANCE if self._shadows else None)

    def compared(self, image: ImageArray, crop: Crop, color: str) -> tuple[Mask, Mask, Mask]:
        """Which pixels of a crop show the background, which have a colour of it, and which have one of the robot.

        Where the background has the hue of the colour, a shade of it may be the background's own. What is unknown there
        is guessed again first, by what was learned there since it was guessed last.
        """
        if self._news[crop].any() and self.unknown[crop].any():
            self._picture[crop] = inpainted(self._picture[crop], self.unknown[crop])
            self._news[crop] = False
        shown, part = self.matches(image, crop), image[crop]
        same = color_mask(self._picture[crop], color) if self._surroundings is None else shown & color_mask(part, color)
        return shown, same, self._palette[_coarse(part)]


def _coarse(pixels: ImageArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    r, g, b = (pixels[..., channel].astype(np.int64) >> (8 - COLOR_BITS) for channel in range(3))
    return (r << 2 * COLOR_BITS) | (g << COLOR_BITS) | b


def _palette(pixels: ImageArray) -> Mask:
    counts = np.bincount(_coarse(pixels).ravel(), minlength=2 ** (3 * COLOR_BITS))
    found: Mask = counts > LEAST_PALETTE_SHARE * max(counts.sum(), 1)
    return found


@dataclass(frozen=True, eq=False)
class _Place:
    """A box in which an object may be, with what the image shows there."""

    projected: ProjectedObject | None  # How the object would be seen there; None where it would not be
    share: float = 0.0  # Of its silhouette that was judged, without what parts that the box encloses hide of it
    hidden: float = 0.0  # Share of it that is taken to be behind the robot or another object
    edge: float = 0.0  # Share of it along the edge of what hides it, one pixel wide, on the side that is visible
    same_color: float = 0.0  # Share of it that shows its colour before a background of that colour
    filled: float = 0.0
    """As how much of the silhouette has the object's colour, without what has that colour anyway behind it.

    Wherever in the box, as its parts may be thin and it may have tipped.
    """
    shift: Array | None = None
    """Of the patch of colour from where it would be if the object were there [pixels]; None without a patch."""


def color_detections(
    view: ExpectedView, background: Background, obj: SceneObject, boxes: Sequence[TargetBox]
) -> tuple[list[BoxDetection], Array | None]:
    """What is seen of the boxes in which a coloured object may be, and where it was seen [m]; None if unknown."""
    colored = view.colored(obj.color or "")
    places = [_place(view, background, obj, colored, box) for box in boxes]
    poses, at_tool = [view.pose(box) for box in boxes], [box.frame in view.X_WL for box in boxes]
    held = []
    for i, place in enumerate(places):
        if at_tool[i] and view.believed.holding and place.filled >= detector.FULL and place.shift is not None:
            assert place.projected is not None  # noqa: S101 - what is filled is there
            most = detector.SHIFT_PIXELS + detector.SHIFT_SHARE * place.projected.box.area**0.5
            held += [i] if np.hypot(*place.shift) <= most else []
    position = poses[held[0]][:3, 3] if held else None
    if not held:
        rests = [one for one, tool in zip(zip(places, poses, strict=True), at_tool, strict=True) if not tool]
        news = None  # somewhere else than in any box
        if colored.any() and all(place.filled <= detector.EMPTY for place in places):
            news = colored & ~background.matches(view.image, view.whole)
        position = _resting(view, obj, rests, news)
    found = []
    for i, (box, place) in enumerate(zip(boxes, places, strict=True)):
        if position is None:
            evidence = Truth.FALSE if place.filled <= detector.EMPTY else Truth.UNKNOWN
        else:
            offset = (position - poses[i][:3, 3]) @ poses[i][:3, :3]
            inside = i in held if at_tool[i] else (np.abs(offset) <= 0.5 * np.array(box.size)).all()
            evidence = Truth.TRUE if inside else Truth.FALSE
        because: MissReason = "detector limit"
        wanted = view.cell.detectors[box.detector].min_visible
        if place.share < np.clip(wanted - detector.BORDER * place.edge, detector.LEAST_SHARE, detector.MOST_SHARE):
            missing: dict[MissReason, float] = {
                "mask border": place.hidden,
                "same colour behind": place.same_color,
                "lighting": 1.0 - place.share - place.hidden - place.same_color,
            }
            evidence, because = Truth.UNKNOWN, max(missing, key=missing.__getitem__)
        if place.projected is None or place.projected.area < detector.LEAST_PIXELS**2:
            evidence, because = Truth.UNKNOWN, "detector limit"
        outline = NO_OUTLINE if place.projected is None else place.projected.box.polygon
        found.append(BoxDetection(box.name, evidence, place.share, outline, because))
    return found, position


def _resting(
    view: ExpectedView, obj: SceneObject, rests: Sequence[tuple[_Place, Array]], news: Mask | None
) -> Array | None:
    """Where an object rests that the tool does not hold [m]: in one of its boxes, else anywhere.

    rests: the boxes that do not move with the tool, with their poses. In none of them it is the largest new patch of
    its colour (news), if that is big enough, at the height of a box.
    """
    X_WC = view.X_WC

    def at_height(pixel: Array, height: float) -> Array | None:
        """Where the ray of a pixel is at a height [m]; None if it never is."""
        ray_C = np.append(view.projection.plane(pixel[None])[0], 1.0)
        ray = X_WC[:3, :3] @ (ray_C / np.linalg.norm(ray_C))
        distance = (height - X_WC[2, 3]) / ray[2] if abs(ray[2]) > 1e-6 else -1.0
        position: Array = X_WC[:3, 3] + distance * ray
        return position if distance > 0 else None

    place, X_WB = max(rests, key=lambda one: one[0].filled, default=(None, None))
    if place is not None and X_WB is not None and place.filled > detector.FULL / 2:
        # As high as it would at the pose, by the ray to its patch.
        assert place.projected is not None and place.shift is not None  # noqa: S101, PT018 - what is filled is there
        position = at_height(place.projected.box.center + place.shift, float(X_WB[2, 3]))
        return X_WB[:3, 3] if position is None else position
    if not rests or news is None or (patch := largest_blob(news)) is None:
        return None
    (_, resting), (area, center) = rests[0], patch
    position = at_height(center, float(resting[2, 3]))
    expected = None if position is None else view.projected(obj.name, pose(resting[:3, :3], position))
    if expected is None or area < detector.LEAST_SHARE * expected.area:
        return None
    return at_height(center - expected.offset, float(resting[2, 3]))


def _place(view: ExpectedView, background: Background, obj: SceneObject, colored: Mask, box: TargetBox) -> _Place:
    """What the image shows where an object would be if it were in a box; colored: where it has the object's colour."""
    X_WO = view.pose(box)
    projected = view.projected(obj.name, X_WO)
    if projected is None:
        return _Place(None)
    outlined, margin = projected.box, max(6, round(0.6 * projected.box.area**0.5))
    crop = view.crop(outlined.polygon, margin)
    if crop is None or projected.area <= 0.0:
        return _Place(projected)
    silhouette = projected.mask(crop)
    # Where the background has the object's own colour, the image cannot tell the two apart: a shade is no object.
    shown, same, robot_colored = background.compared(view.image, crop, obj.color or "")
    own = colored[crop] & ~shown & ~same
    behind = pieces_mask(crop, view.robot, outlined, behind=True) & robot_colored
    # What of the robot, without some links, and of other objects is before the object.
    before = pieces_mask(crop, view.robot, outlined, without=box.encloses)
    steps = np.linspace(-0.45, 0.45, 3)
    points = transform(X_WO, np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) * obj.size)
    for name in view.cell.objects:
        if name != obj.name and name in view.believed.X_WO:
            blocking = view.blocking(name, points)
            before |= True if blocking is None else pieces_mask(crop, blocking)
    hiding = dilated(before, 1)
    enclosed = dilated(pieces_mask(crop, view.robot, outlined, links=box.encloses), 1)
    front = hiding | enclosed
    hidden = min(float((silhouette & front).sum()) / projected.area, 1.0)
    same_color = float((silhouette & ~front & same).sum()) / projected.area
    telling = ~front & ~same
    decided = int((silhouette & telling).sum())
    if not decided:
        return _Place(projected, hidden=hidden, same_color=same_color)
    judged = telling & (own | shown | behind)
    # What else hides, the enclosed parts do not hide from being asked.
    askable = max(projected.area - float((silhouette & enclosed & ~hiding).sum()), detector.LEAST_PIXELS**2)
    outline, shift = filled(crop, [outlined.corners]), None
    if (dilated(outline, margin // 2) & judged & own).any():
        # It fills a place from `FULL / 2` on, so that it may lie beside that by the rest of its length.
        most = round((1.0 - detector.FULL / 2) * float(np.ptp(outlined.polygon, axis=0).max())) + 2
        shift = displacement(own, judged, lambda by: projected.mask(crop, by), (margin // 2, most))
    return _Place(
        projected,
        share=min(float((silhouette & judged).sum()) / askable, 1.0),
        hidden=hidden,
        edge=float((silhouette & hiding & ~before).sum()) / askable,
        same_color=same_color,
        filled=min(float((outline & judged & own).sum() / decided), 1.0),
        shift=shift,
    )


def marker_detection(view: ExpectedView, background: Background, atom: str, box: TargetBox) -> BoxDetection:
    """What is seen of a box with an ArUco marker, on an object or on a finger."""
    outline = view.outline(view.pose(box), box.size)
    if outline is None:
        return BoxDetection(box.name, Truth.UNKNOWN, 0.0, NO_OUTLINE)
    wanted, robot, on_finger = view.marker(atom, box), view.cell.robot, box.frame in view.cell.markers
    # Where open fingers carry a marker in the image, and the way to where closed ones do, (2,) [pixels] each: 0 where
    # they do not move it, or nobody can tell how far they are closed.
    opened, step = outline.center, np.zeros(2)
    if on_finger and robot.fingers is not None:
        ways = (robot.with_fingers(view.believed.joints, one) for one in (robot.fingers.open, robot.fingers.closed))
        start, end = (view.outline(robot.link_poses(q)[box.frame] @ box.X_FB, box.size) for q in ways)
        if start is not None and end is not None:
            opened, step = start.center, end.center - start.center

    def nearest(markers: Iterable[FoundMarker]) -> tuple[float, float] | None:
        """How far the marker of the box is from its place [pixels], and how closed the fingers are by it, 0..1."""
        found = list[tuple[float, float]]()
        for number, corners in markers:
            center: Array = corners.mean(axis=0)
            closure = float((center - opened) @ step / max(float(step @ step), 1e-9))
            off = np.hypot(*(center - opened - np.clip(closure, 0.0, 1.0) * step))
            # That on a finger lies where the fingers can carry it, to half the size of the outline.
            if wanted is not None and number == wanted.id and not (on_finger and off > 0.5 * outline.area**0.5):
                found.append((float(np.hypot(*(center - outline.center))), closure))
        return min(found, default=None)

    found = None if wanted is None else nearest(view.markers(wanted.dictionary))
    because: MissReason = "detector limit"
    crop = view.crop(outline.polygon, round(AROUND * outline.area**0.5)) if found is None else None
    if crop is not None:
        # What of the robot is before the box, other than what carries the marker, may touch this in the image.
        others = {surface.parent for surface in robot.surfaces} - {box.frame, *box.encloses}
        hiding = dilated(pieces_mask(crop, view.robot, outline, links=others), 1)
        if (hiding & filled(crop, [outline.corners])).any():
            if wanted is not None:
                origin = (crop[1].start, crop[0].start)
                beside = find_markers(view.image[crop], wanted.dictionary, hiding)
                found = nearest((number, corners + origin) for number, corners in beside)
            because = "mask border" if found is None else because
    share, evidence = float(found is not None), Truth.UNKNOWN
    if on_finger:
        about_object = any(view.object_of(atom, other) is not None for other in view.sought.targets[atom].boxes)
        if found is not None and (about_object or robot.fingers is None):
            evidence = Truth.TRUE
        elif found is not None and np.hypot(*step) * OPEN_SHARE >= 1.0:  # else too small to tell open from closed
            is_open = found[1] <= OPEN_SHARE
            evidence = Truth.TRUE if is_open == view.sought.when_open[atom] else Truth.FALSE
    elif found is not None:
        evidence = Truth.TRUE if found[0] <= max(0.5 * outline.area**0.5, 2.0) else Truth.FALSE
    else:
        # The share of the outline in which the background is seen and the robot is not.
        if (crop := view.crop(outline.polygon, 2)) is not None:
            seen = filled(crop, [outline.corners]) & background.matches(view.image, crop)
            seen &= ~dilated(pieces_mask(crop, view.robot, outline), 1)
            share = min(1.0, float(seen.sum()) / max(outline.area, 1.0))
        evidence = Truth.FALSE if share >= ABSENT_SHARE else Truth.UNKNOWN
    return BoxDetection(box.name, evidence, share, outline.polygon, because)
