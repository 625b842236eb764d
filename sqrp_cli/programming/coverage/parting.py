"""From when on images show that a part was lost: what must part first, and what must be in its place.

A part that the tool loses falls freely, with the tool's velocity, down to where it stood or is to stand. An image shows
that it is not held once it lies clear of where the tool would show it, or apart from there and in a place in which it
is looked for, too: seen in between, a detector of colours calls it neither held nor gone. It shows that it is in its
place once the line of sight through its centre meets the middle plane of its box inside the box.

How far apart is enough depends on what the tool hides of the part, and cameras may contradict each other. So there are
two answers: when images *surely* show it, each camera by itself, and when they *usually* do, with more cameras that say
so than cameras that say the opposite.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.detector import ALIKE, BORDER, EMPTY, FULL, LEAST_SHARE, SHIFT_PIXELS, SHIFT_SHARE
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.skill.target_box import object_of
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.image_time import Onset
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts, Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import SoughtBox, Target


class PartingRule(NamedTuple):
    """What a detector of colours needs to call a part not held, as far as it may be known beforehand."""

    pixels: float
    """How far apart it must be seen from where the tool would show it [pixels], ..."""
    share: float
    """... and a share of its size."""
    inside: float
    """How far from a place, as a share of its length that way, it fills enough of it to count as there."""
    covered: float
    """How much of where the tool would show it it may cover if it counts as there nowhere: a share."""


SURE = PartingRule(
    # The detector measures by whole pixels. What it leaves open lies at an edge across the way, half of it hidden.
    pixels=SHIFT_PIXELS + 1.0,
    share=SHIFT_SHARE + 2.0 * ALIKE,
    # Moved by a share d, a convex silhouette still covers (1 - d)^2 of itself at least (Brunn-Minkowski), even if all
    # that it leaves uncovered is in the share of it that must be visible.
    inside=1.0 - float(np.sqrt(1.0 - LEAST_SHARE * (1.0 - FULL / 2))),
    covered=0.0,
)
"""So much is surely enough."""

USUAL = PartingRule(
    # What the detector leaves open lies at two edges.
    pixels=SHIFT_PIXELS,
    share=SHIFT_SHARE + ALIKE / 2.0,
    # Moved along an edge by a share d, a box covers 1 - d of itself.
    inside=1.0 - FULL / 2,
    covered=EMPTY,
)
"""So much is usually enough."""

GRAVITY = 9.81
"""[m/s^2]."""

_LOOK = 0.15
"""Share of an interval after which cameras are asked whether they see what may be lost in it."""

_STARTS = 25
"""Instants of an interval at which a part is let fall."""

_LONGEST = 0.8
"""How long what is lost is followed [s]; later it counts as apart, if it is."""

_FALL = _LONGEST * np.linspace(0.0, 1.0, 41) ** 1.5
"""Times after it is lost at which it is looked at [s], the first ones closer."""


@dataclass(frozen=True, eq=False)
class LostPart:
    """A part that is lost at instants of an interval: s of them, each followed for f times `_FALL`."""

    t: Array
    """When it is lost, shape (s,) [s]."""
    held: Array
    """Where its centre would be if the tool held it, shape (s, f, 3) [m]."""
    free: Array
    """Where its centre is, shape (s, f, 3) [m]."""


@dataclass(frozen=True, eq=False)
class HeldPart:
    """A lost part beside the box in which the tool would show it."""

    loss: LostPart
    R_WB: Array
    """How the box is turned when the part is lost, shape (s, 3, 3)."""
    size: Array
    """Full extents of the box, shape (3,) [m]."""

    @property
    def spread(self) -> float:
        """See `_spread` [m]."""
        return _spread(self.size)


def onset(
    stage: Stage, observer: Observer, literals: Sequence[Literal], targets: Mapping[Atom, Target], interval: Stretch
) -> Onset:
    """From when on images show a fault that becomes true at a time of an interval.

    literals: of the fault, with the target of each. Where the tool loses nothing in it, images show it at once.
    """
    found = _by_camera(stage, observer, literals, targets, interval)
    if found is None:
        return Onset.at_once(interval.start, interval.end)
    surely = found.shown.max(axis=0, initial=0.0)
    shown = _between(found.x, surely, interval)
    usual = _between(found.x, np.minimum(found.usual, surely), interval, earlier=True)
    return replace(shown, usual=usual.shown)


def least_delays(
    stage: Stage,
    observer: Observer,
    literals: Sequence[Literal],
    targets: Mapping[Atom, Target],
    interval: Stretch,
    response: float,
) -> Array:
    """What the longest delay of a fault is at least, with each camera and whichever others, shape (cameras,) [s].

    As the slowest of the cameras that see a part tells when it is shown, others make no camera faster. At some phase
    the image that shows it is known one response later, unless the motion ends before. See `onset`.

    response: the shortest of all cameras [s].
    """
    found = _by_camera(stage, observer, literals, targets, interval)
    if found is None:
        return np.full(len(observer.cameras), min(response, stage.motion.time - interval.start))
    alone = [_between(found.x, shown, interval) for shown in found.shown]
    return np.array([np.minimum(one.shown - one.x + response, stage.motion.time - one.x).max() for one in alone])


class _ByCamera(NamedTuple):
    """When a lost part is shown by each of c cameras."""

    x: Array
    """When the fault becomes true, shape (s,) [s]."""
    shown: Array
    """From when on each surely shows it, as soon as it is lost where the camera is not asked, shape (c, s) [s]."""
    usual: Array
    """From when on all of them together usually show it, shape (s,) [s]."""


def _by_camera(
    stage: Stage, observer: Observer, literals: Sequence[Literal], targets: Mapping[Atom, Target], interval: Stretch
) -> _ByCamera | None:
    """When each camera shows a fault, see `onset`; None where the tool loses nothing."""
    name = held_in(stage, interval)
    boxes = {} if name is None else {lit: _boxes_of(stage, targets[lit.atom], name) for lit in literals}
    left = [box for lit, found in boxes.items() if not lit.positive for box in found if box.frame in stage.model.links]
    reached = [box for lit, found in boxes.items() if lit.positive for box in found if box.frame in stage.resting]
    if name is None or not left or interval.length <= 0.0:
        return None
    loss = _loss(stage, name, interval)
    needed = {box: targets[lit.atom].cameras for lit, found in boxes.items() for box in found}
    x, shown, usual = loss.t, np.tile(loss.t, (len(observer.cameras), 1)), loss.t
    rests = [box for box in _rests(stage, targets, name) if box not in reached]
    left_by, *by_place = _watching(stage, observer, [left, *([box] for box in [*reached, *rests])], interval)
    held = HeldPart(loss, _turn(stage, left[0], loss.t), np.array(left[0].size))
    view = _View(*_eyes([observer.cameras[number] for number in left_by]))
    places = [(box, np.isin(left_by, by)) for box, by in zip([*reached, *rests], by_place, strict=True)]
    told_by_color = left[0].limits.kind == "color"
    _, gone = _moments(held, stage, view, places if told_by_color else None, SURE)
    shown[left_by] = loss.t + gone
    usual = loss.t + _outvoted(*_moments(held, stage, view, places if told_by_color else None, USUAL), needed[left[0]])
    for box, by in zip(reached, by_place, strict=False):
        X_WB = stage.resting[box.frame][0] @ box.X_FB
        offset = (loss.free - X_WB[:3, 3]) @ X_WB[:3, :3]
        half = 0.5 * np.array(box.size)
        x = np.maximum(x, loss.t + _first((half - np.abs(offset)).min(axis=2)[None])[0])
        there = _first(_in_place(loss, X_WB, half, _eyes([observer.cameras[number] for number in by])[0]))
        shown[by] = np.maximum(shown[by], loss.t + there)
        usual = np.maximum(usual, loss.t + _outvoted(there, there, needed[box]))
    return _ByCamera(x, shown, usual)


class _View(NamedTuple):
    """Cameras that look at a part."""

    eyes: Array
    """Where they are, shape (c, 3) [m]."""
    focal: Array
    """Their focal lengths, shape (c,) [pixels]."""


def _moments(
    held: HeldPart, stage: Stage, view: _View, places: Sequence[tuple[SoughtBox, Mask]] | None, rule: PartingRule
) -> tuple[Array, Array]:
    """How long after a loss images of each camera no longer show the part held, and show it not held, (c, s) each [s].

    places: in which it is looked for, each with the cameras that see it, shape (c,); None where a marker tells.
    """
    apart = _apart(held, view.eyes, view.focal, rule)
    if places is None:
        return _first(apart), _first(apart)
    there = [
        np.where(sees[:, None, None], _at_place(held, stage, box, view.eyes, rule), -np.inf) for box, sees in places
    ]
    gone = np.maximum(_clear(held, view.eyes, rule), np.minimum(apart, np.max(there, axis=0, initial=-np.inf)))
    return _first(apart), _first(gone)


def _outvoted(until: Array, since: Array, needed: int) -> Array:
    """When more cameras say something than say the opposite, and as many as needed, shape (s,) [s].

    until: when each of c cameras ceases to say the opposite, (c, s) [s]. since: when each says it, (c, s) [s].
    """
    times = np.concatenate([until, since])
    yes = (since[None] <= times[:, None]).sum(axis=1)
    no = (until[None] > times[:, None]).sum(axis=1)
    found: Array = np.where((yes > no) & (yes >= needed), times, np.inf).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(found), found, since.max(axis=0, initial=0.0))


def _between(x: Array, shown: Array, interval: Stretch, *, earlier: bool = False) -> Onset:
    """The onset of what becomes true at x and is shown from some times on, within an interval.

    earlier: whether it may be shown before it is true, such as a part in a place that it falls into.
    """
    x = np.maximum.accumulate(x)
    lag = shown - x if earlier else np.maximum(shown - x, 0.0)
    kept = np.append(np.diff(x) > 1e-9, True)
    inner = (x > interval.start) & (x < interval.end) & kept
    at = np.concatenate([[interval.start], x[inner], [interval.end]])
    late = at + np.interp(at, x[kept], lag[kept])
    return Onset(at, np.maximum.accumulate(late))


def _watching(
    stage: Stage, observer: Observer, boxes: Sequence[Sequence[SoughtBox]], interval: Stretch
) -> list[Indices]:
    """For each of some groups of boxes the fixed cameras that judge any of them, early in an interval, by number.

    These are more than the cameras that see them: what they say counts, though nobody relies on it.
    """
    t = interval.start + _LOOK * interval.length
    piece = next(i for i, piece in enumerate(stage.pieces) if piece.start <= t <= piece.end)
    states = stage.states(Samples(np.array([piece]), np.array([t])))
    judged = {box: replace(box, limits=box.limits.judging) for group in boxes for box in group}
    targets = [Target(Atom(box.name), 1, (box,)) for box in judged.values()]
    found = zip(judged, observer.verdicts(targets, states), strict=True)
    judges = {box: _judges(judged[box], verdicts[0], observer.cameras, states) for box, verdicts in found}
    fixed = np.array([camera.frame == WORLD for camera in observer.cameras], dtype=bool)
    return [np.flatnonzero(np.any([judges[box] for box in group], axis=0) & fixed) for group in boxes]


def _judges(box: SoughtBox, found: BoxVerdicts, cameras: Sequence[Camera], states: SceneStates) -> Mask:
    """Whether each of c cameras judges a box in a state, though something may hide a little more than allowed, (c,)."""
    least: ArrayLike = box.limits.min_visible
    if box.limits.kind == "color":
        center = states.box_poses(box)[0, :3, 3]
        distance = [np.linalg.norm(center - states.camera_poses(camera)[0, :3, 3]) for camera in cameras]
        pixels = _eyes(cameras)[1] * _spread(np.array(box.size)) / np.array(distance)
        least = np.maximum(box.limits.min_visible - BORDER / pixels, LEAST_SHARE)
    hidden = (found.cause[0] == Cause.HIDDEN) & (found.visible[0] >= least)
    judges: Mask = (found.cause[0] == Cause.NONE) | hidden
    return judges


def held_in(stage: Stage, interval: Stretch) -> str | None:
    """What the tool holds throughout an interval."""
    primitives = stage.motion.primitives
    held = {p.held for p in primitives if p.start < interval.end - 1e-9 and p.end > interval.start + 1e-9}
    return held.pop() if len(held) == 1 else None


def _rests(stage: Stage, targets: Mapping[Atom, Target], name: str) -> list[SoughtBox]:
    """The places that hold still in which images of the task look for an object."""
    boxes = (box for target in targets.values() for box in _boxes_of(stage, target, name))
    return [box for box in boxes if box.frame in stage.resting and box.limits.kind == "color"]


def _boxes_of(stage: Stage, target: Target, name: str) -> list[SoughtBox]:
    return [box for box in target.boxes if object_of(str(target.atom), box, stage.X_WO) == name]


def _loss(stage: Stage, name: str, interval: Stretch) -> LostPart:
    t = np.linspace(interval.start, interval.end, _STARTS)
    step = t[1] - t[0]
    total = stage.motion.time
    later = np.arange(interval.end + step, min(interval.end + _LONGEST, total) + step, step)
    path = _path(stage, name, np.concatenate([t, later]))
    times = np.concatenate([t, later])
    when = t[:, None] + _FALL
    held = np.stack([np.interp(when, times, path[:, axis]) for axis in range(3)], axis=2)
    velocity = np.gradient(path, times, axis=0)[: len(t)]
    start = path[: len(t)]
    free = start[:, None] + velocity[:, None] * _FALL[:, None]
    free[..., 2] -= 0.5 * GRAVITY * _FALL**2
    free[..., 2] = np.maximum(free[..., 2], _floor(stage, name, start)[:, None])
    return LostPart(t, held, free)


def _positions(stage: Stage, t: Array) -> tuple[Array, Indices]:
    """The joints at instants of a motion, shape (n, joints), and the number of the primitive at each, (n,)."""
    motion = stage.motion
    ends = [primitive.end for primitive in motion.primitives[:-1]]
    clipped = np.minimum(t, motion.time)
    number = np.searchsorted(ends, clipped)
    return np.concatenate([motion.positions(int(i), clipped[number == i]) for i in np.unique(number)]), number


def _path(stage: Stage, name: str, t: Array) -> Array:
    """Where the centre of an object is at instants of the motion, shape (n, 3) [m]; after its end as at its end."""
    motion = stage.motion
    q, number = _positions(stage, t)
    X_WT = stage.model.link_poses(q)[stage.model.tool_frame]
    path = np.empty((len(t), 3))
    for index in np.unique(number).tolist():
        primitive, rows = motion.primitives[index], number == index
        if primitive.held == name and primitive.X_TO is not None:
            path[rows] = (X_WT[rows] @ primitive.X_TO)[:, :3, 3]
        else:
            path[rows] = primitive.X_WO.get(name, stage.X_WO[name])[:3, 3]
    return path


def _turn(stage: Stage, box: SoughtBox, t: Array) -> Array:
    """How a box on a link is turned at instants of the motion, shape (n, 3, 3)."""
    X_WL: Array = stage.model.link_poses(_positions(stage, t)[0])[box.frame]
    return np.broadcast_to(X_WL @ box.X_FB, (len(t), 4, 4))[:, :3, :3]


def _floor(stage: Stage, name: str, start: Array) -> Array:
    """How low the centre of a part can fall from places (s, 3), to where it stood or is to stand; shape (s,) [m]."""
    floor = np.full(len(start), -np.inf)
    begins_held = stage.motion.primitives[0].held == name
    for X_WO in (None if begins_held else stage.X_WO[name], stage.motion.final.X_WO.get(name)):
        if X_WO is not None:
            above = np.hypot(*(start - X_WO[:3, 3])[:, :2].T) < 0.02
            floor = np.where(above, np.maximum(floor, X_WO[2, 3]), floor)
    lowest: Array = np.minimum(floor, start[:, 2])
    return lowest


def _spread(size: Array) -> float:
    """Square root of the mean area of the silhouette of a box of full extents (3,) [m]."""
    return float(np.sqrt(0.5 * (size * np.roll(size, 1)).sum()))


def _eyes(cameras: Sequence[Camera]) -> tuple[Array, Array]:
    """Where cameras are, shape (c, 3) [m], and their focal lengths, (c,) [pixels]."""
    return (
        np.array([camera.X_FC[:3, 3] for camera in cameras]).reshape(-1, 3),
        np.array([np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]) for camera in cameras]),
    )


def _apart(held: HeldPart, eyes: Array, focal: Array, rule: PartingRule) -> Array:
    """By how much a part is further from where the tool would show it than it must be, shape (c, s, f) [m]."""
    across, distance, _ = _beside(held.loss.held, held.loss.free, eyes)
    least = rule.pixels * distance / focal[:, None, None] + rule.share * held.spread
    margin: Array = np.linalg.norm(across, axis=3) - least
    return margin


def _clear(held: HeldPart, eyes: Array, rule: PartingRule) -> Array:
    """By how much a part is seen beside where the tool would show it, covering too little of that, (c, s, f) [m]."""
    across, distance, nearer = _beside(held.loss.held, held.loss.free, eyes)
    length = _length(across, held.loss.held - eyes[:, None, None], held.R_WB[:, None], held.size)
    scale = distance / (distance - nearer)
    margin: Array = np.linalg.norm(across, axis=3) * scale - 0.5 * (1.0 + scale) * (1.0 - rule.covered) * length
    return margin


def _at_place(held: HeldPart, stage: Stage, box: SoughtBox, eyes: Array, rule: PartingRule) -> Array:
    """By how much a part is nearer to where a place would show it than it must be to fill it, shape (c, s, f) [m]."""
    X_WB = stage.resting[box.frame][0] @ box.X_FB
    place = np.broadcast_to(X_WB[:3, 3], held.loss.free.shape)
    across, *_ = _beside(place, held.loss.free, eyes)
    length = _length(across, place - eyes[:, None, None], X_WB[:3, :3], held.size)
    margin: Array = rule.inside * length - np.linalg.norm(across, axis=3)
    return margin


def _beside(expected: Array, free: Array, eyes: Array) -> tuple[Array, Array, Array]:
    """How far a part is from where it is expected, as cameras see it.

    Returns it across the line of sight, shape (c, s, f, 3) [m], the distance of where it is expected, and by how much
    it is nearer than that, both of shape (c, s, f) [m].
    """
    ray = expected - eyes[:, None, None]
    distance = np.linalg.norm(ray, axis=3)
    gap = free - expected
    nearer = -(ray * gap).sum(axis=3) / distance
    across: Array = gap + (nearer / distance)[..., None] * ray
    return across, distance, nearer


def _length(across: Array, ray: Array, R_WB: Array, size: Array) -> Array:
    """How long the silhouette of a box is along a direction, through its middle and seen along a ray, (c, s, f) [m].

    The most r for which r * direction + k * ray is in the box for some k; at a corner of these bounds two faces meet.
    """
    gone = np.linalg.norm(across, axis=3, keepdims=True)
    way = np.where(gone > 1e-9, across / np.maximum(gone, 1e-9), 0.0)[..., None, :] @ R_WB
    u, v = way[..., 0, :], (ray[..., None, :] @ R_WB)[..., 0, :]
    v = v / np.linalg.norm(v, axis=3, keepdims=True)
    other_u, other_v, other_size = (np.roll(part, 1, axis=-1) for part in (u, v, size))
    turn = np.abs(u * other_v - v * other_u)
    longest: Array = ((size * np.abs(other_v) + other_size * np.abs(v)) / np.maximum(turn, 1e-9)).min(axis=3)
    return np.minimum(longest, np.linalg.norm(size))


def _in_place(loss: LostPart, X_WB: Array, half: Array, eyes: Array) -> Array:
    """By how much the line of sight through a part meets the middle plane of a box inside it, shape (c, s, f) [m]."""
    eye = (eyes - X_WB[:3, 3]) @ X_WB[:3, :3]
    part = (loss.free - X_WB[:3, 3]) @ X_WB[:3, :3]
    ray = part - eye[:, None, None]
    met = part[..., :2] - ray[..., :2] * (part[..., 2:] / np.where(np.abs(ray[..., 2:]) > 1e-6, ray[..., 2:], 1e-6))
    margin: Array = (half[:2] - np.abs(met)).min(axis=3)
    return margin


def _first(margin: Array) -> Array:
    """When a margin (c, s, f) is first not negative after the loss, shape (c, s) [s]; at most the longest time."""
    good = margin >= 0.0
    index = np.where(good.any(axis=2), good.argmax(axis=2), margin.shape[2] - 1)
    before = np.maximum(index - 1, 0)
    late, early = (np.take_along_axis(margin, i[..., None], axis=2)[..., 0] for i in (index, before))
    share = np.where((index > 0) & (late > 0) & (early < 0), early / np.where(early != late, early - late, 1.0), 1.0)
    found: Array = _FALL[before] + np.clip(share, 0.0, 1.0) * (_FALL[index] - _FALL[before])
    return found
