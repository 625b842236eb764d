"""From when on images show that the tool has lost a part: what must lie apart first, and what must be in its place.

A lost part falls freely, with the tool's velocity, to where it stood or is to stand, or onto what is below it. An image
shows that it is not held once it lies clear of where the tool would show it, or apart from there and in a place that
the camera sees and in which it is looked for, too: seen in between, a detector of colours calls it neither held nor
gone. An image shows that it is in its place once the line of sight through its centre meets the middle plane of its box
inside the box.

Cameras contradict each other as long as one of them takes the part for held. So there are two answers: images *surely*
show a drop once the slowest camera does that may judge it soon after, and *usually* once more of these say so than say
the opposite. Which these are follows from the robot's motion and from what never moves: what else hides a part makes
windows smaller, but never a drop quicker to see.

Points and vectors of many drops at many times are arrays by component, (3, drops, times): sums over a last axis of
three take several times as long.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import ALIKE, BORDER, EMPTY, FULL, LEAST_SHARE, SHIFT_PIXELS, SHIFT_SHARE
from sqrp_cli.cell.scene import FLOOR_DEPTH
from sqrp_cli.geometry import Array, Mask, transform
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.formula_time import TimeInterval
from sqrp_cli.logic.image_time import Onset
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.motion.collision import CLEARANCE
from sqrp_cli.motion.fingers import move_fingers
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox, Target
from sqrp_cli.skill.target_box import object_of
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import PlannedMotion
from sqrp_cli.task.pieces import fault_intervals, fault_literals


class DropRule(NamedTuple):
    """What a detector of colours needs to call a part not held, as far as it may be known beforehand."""

    pixels: float  # How far apart it must be seen from where the tool would show it [pixels], ..
    share: float  # ... and a share of its size.
    inside: float  # How far from a place, as a share of its length that way, it fills enough of it to count as there
    covered: float  # How much of where the tool would show it it may cover if it counts as there nowhere: a share


SURE = DropRule(
    # The detector measures by whole pixels. What it leaves open lies at an edge across the way, half of it hidden.
    pixels=SHIFT_PIXELS + 1.0,
    share=SHIFT_SHARE + 2.0 * ALIKE,
    # Moved by a share d, a convex silhouette still covers (1 - d)^2 of itself at least (Brunn-Minkowski), even if all
    # that it leaves uncovered is in the share of it that must be visible.
    inside=1.0 - float(np.sqrt(1.0 - LEAST_SHARE * (1.0 - FULL / 2))),
    covered=0.0,
)
"""So much is surely enough."""

USUAL = DropRule(
    # What the detector leaves open lies at two edges.
    pixels=SHIFT_PIXELS,
    share=SHIFT_SHARE + ALIKE / 2.0,
    # Moved along an edge by a share d, a box covers 1 - d of itself.
    inside=1.0 - FULL / 2,
    covered=EMPTY,
)
"""So much is usually enough."""
GRAVITY = 9.81  # [m/s^2]
_STARTS, _STEP = 25, 0.1
"""Instants of an interval at which a part is let fall: at least so many, and one in so many seconds."""
LONGEST = 4.0  # How long what is lost is followed [s]; what images do not show by then, they never do
_FALL = LONGEST * np.linspace(0.0, 1.0, 81) ** 2
"""Times after it is lost at which it is looked at [s], the first ones closer."""
_FIRST = 32
"""So many of these times tell when nearly all drops are seen; all of them are looked at for the others alone."""
_SOON = 0.8  # How long after a loss cameras count that judge the part [s]
_ALONG = 2.0  # What moves away from a camera so many times as far as across its line of sight falls along that
_NEVER = 1e3  # How long after the motion what no image shows is shown [s]: after all windows


class ShownDrops(NamedTuple):
    """When s drops of a part are shown by c cameras, and what takes each so long."""

    part: str
    x: Array  # When the fault becomes true, shape (s,) [s]
    each: Array  # From when on each camera that may judge a drop shows it, -inf of the others, (c, s) [s]
    usual: Array  # From when on all of them together usually do, (s,) [s]
    causes: NDArray[np.str_]  # What takes each camera longest, a `LateCause`, (c, s)


@dataclass(frozen=True, eq=False, kw_only=True)
class DropOnset(Onset):
    """From when on images show that the tool has lost a part."""

    drops: ShownDrops


class SeenOffset(NamedTuple):
    """How far a part is from where it is expected, as cameras see it in n drops at f times; shape (n, f) [m] each."""

    across: Array  # Across the line of sight
    distance: Array  # From the camera to where it is expected
    nearer: Array  # By how much it is nearer than that
    length: Array  # How long the silhouette of its box is along the direction of the offset, through its middle
    focal: Array  # Of the cameras, shape (n, 1) [pixels]
    spread: float  # Square root of the mean area of the silhouette of its box

    @classmethod
    def of(cls, expected: Array, free: Array, eyes: Array, focal: Array, R_WB: Array, size: Array) -> SeenOffset:
        """expected, free: where its centre would be, (3, n, f or 1), and is, (3, n, f) [m].

        R_WB, size: of the box expected there. eyes: where the cameras are, (3, n, f or 1) [m]; focal: their focal
        lengths, (n,) [pixels].
        """
        ray, gap = expected - eyes, free - expected
        distance, nearer = np.sqrt(_dot(ray, ray)), -_dot(ray, gap)
        nearer /= distance
        across = gap + nearer / distance * ray
        # The length is the most r for which r * direction + k * ray is in the box for some k; at a corner of these
        # bounds two faces meet.
        gone = np.sqrt(_dot(across, across))
        axes = np.moveaxis(R_WB, (-1, -2), (0, 1))[..., None]  # of the box, by component
        turn = [across[j] * ray[k] - across[k] * ray[j] for j, k in ((1, 2), (2, 0), (0, 1))]
        scale = np.maximum(gone, 1e-9) * distance
        v = [np.abs(_dot(axis, ray)) / distance for axis in axes]
        length = np.full(gone.shape, np.linalg.norm(size))
        for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            reach = (size[i] * v[j] + size[j] * v[i]) * scale
            np.minimum(length, reach / np.maximum(np.abs(_dot(axes[k], turn)), 1e-9 * scale), out=length)
        return cls(gone, distance, nearer, length, focal[:, None], _spread(size))

    def gone(self, rule: DropRule) -> tuple[Array, Array]:
        """By how much it is further from where it is expected than it must be, and is seen beside that: clear of it."""
        apart = self.across - (rule.pixels * self.distance / self.focal + rule.share * self.spread)
        scale = self.distance / np.maximum(self.distance - self.nearer, 1e-6)
        return apart, self.across * scale - 0.5 * (1.0 + scale) * (1.0 - rule.covered) * self.length

    def fills(self, rule: DropRule) -> Array:
        """By how much it is nearer to that than it must be to fill it."""
        return rule.inside * self.length - self.across


def onset(planned: PlannedMotion, observer: Observer, literals: Sequence[Literal], interval: TimeInterval) -> Onset:
    """From when on images show a fault of these literals that becomes true at a time of an interval.

    Where the tool loses nothing in it, images show it at once.
    """
    stage = planned.stage
    found = _shown(planned, observer, literals, interval, of_one_cell=True)
    if found is None or not observer.cameras:
        return Onset.at_once(interval.start, interval.end)
    fingers, closing = stage.model.fingers, 0.0  # how long they take to close behind what they lose [s]
    if fingers.joints:  # the windows are those of closed fingers
        start = stage.positions(stage.samples_at(np.array([interval.start])))[0, len(stage.model.arm) :]
        closing = move_fingers(fingers, start, fingers.closed, 0.0).duration
    closed = found.x + closing
    causes = np.where(found.each < closed, "fingers_close", found.causes)
    found = found._replace(each=np.maximum(found.each, closed), causes=causes)
    x, usual, slowest = found.x, found.usual, found.each.max(axis=0)
    # What takes longer by more than a step is shown later at once, where between two starts is not known.
    jumps = np.flatnonzero(np.diff(slowest - x) > _STEP) + 1
    x, before = np.insert(x, jumps, x[jumps - 1] + 1e-6), usual[jumps - 1]
    surely = _between(x, np.insert(slowest, jumps, slowest[jumps]), interval)
    usually = _between(x, np.insert(usual, jumps, before), interval)
    return DropOnset(surely.x, surely.shown, np.minimum(usually.shown, surely.shown), drops=found)


def least_delays(planned: PlannedMotion, observer: Observer, response: float) -> Array:
    """What the longest delay of any fault is at least, with each camera and whichever others, shape (cameras,) [s].

    As the slowest of the cameras that may judge a part tells when it is shown, others make no camera faster.
    At some phase the image that shows it is known one response later. See `onset`.

    response: the shortest of all cameras [s].
    """
    longest = np.zeros(len(observer.cameras))
    for fault, literals in fault_literals(planned.formulas).items():
        for interval in fault_intervals(planned.formulas, fault):
            found = _shown(planned, observer, literals, interval, of_one_cell=False)
            alone = [] if found is None else [_between(found.x, surely, interval) for surely in found.each]
            delays = [(one.shown - one.x + response).max() for one in alone]
            longest = np.maximum(longest, response if found is None else delays)
    return longest


def _shown(
    planned: PlannedMotion,
    observer: Observer,
    literals: Sequence[Literal],
    interval: TimeInterval,
    *,
    of_one_cell: bool,
) -> ShownDrops | None:
    """When drops at s instants of an interval are shown by c cameras; None where the tool loses nothing.

    of_one_cell: whether the cameras contradict each other; else each is looked at as if it were alone.
    """
    stage, targets = planned.stage, {target.atom: target for target in planned.targets}
    name = held_in(stage, interval)
    if name is None or interval.length <= 0.0:
        return None
    # The boxes in which the part is looked for: those that it left with the tool, those that it reaches by the fault,
    # and all that rest, in which a detector of colours may take it for being.
    own = {
        atom: [box for box in target.boxes if object_of(str(atom), box, stage.X_WO) == name]
        for atom, target in targets.items()
    }
    boxes = [
        (literal.positive, targets[literal.atom].cameras, box) for literal in literals for box in own[literal.atom]
    ]
    needed = {box: cameras for _, cameras, box in boxes}
    left = [box for positive, _, box in boxes if not positive and box.frame in stage.model.links]
    reached = {
        box: stage.resting[box.frame][0] @ box.X_FB
        for positive, _, box in boxes
        if positive and box.frame in stage.resting
    }
    if not left:
        return None
    by_color = left[0].limits.kind == "color"
    every = dict.fromkeys([*reached, *(box for some in own.values() for box in some)])
    places = [box for box in every if by_color and box.frame in stage.resting]
    # The part falls from where the tool has it at each instant.
    t = np.linspace(interval.start, interval.end, max(_STARTS, int(np.ceil(interval.length / _STEP)) + 1))
    step = t[1] - t[0]
    times = np.append(t, np.arange(interval.end + step, interval.end + LONGEST + step, step))
    states = stage.states(stage.samples_at(times))
    free = _falling(stage, observer, name, np.broadcast_to(states.X_WF[name], (len(times), 4, 4)), times, len(t))
    drops = _Drops(name, t, times, states, free)
    # Which cameras judge it: soon, or at any later time where none does; and for how long they must go on showing it.
    judges, seen = _judges(stage, observer, drops, [*left, *reached], places)
    some = np.any(list(judges.values()), axis=0)
    unjudged = ~some.any(axis=0) & of_one_cell
    if unjudged.any():
        some[:, unjudged] = _judge_later(stage, observer, drops, [*left, *reached])[:, None]
    periods = np.array([1.0 / camera.rate for camera in observer.cameras])
    if of_one_cell:
        periods = np.full(len(periods), periods[some.any(axis=1)].max(initial=0.0))
    (surely, parted, unheld, usually, *there), along = _first_shown(
        stage, observer, drops, some, periods, left[0], seen, reached
    )
    # From when on each shows that the part is not in the tool, and most of them together.
    causes = np.where(along, "line_of_sight", "hardly_apart")
    causes = np.where(parted - t < 0.5 * np.minimum(surely - t, LONGEST), "no_place", causes)
    x, judge = t, np.any([judges[box] for box in left], axis=0)
    judging = np.where(judge, surely, -np.inf)
    unheld, usually = np.where(judge, unheld, -np.inf), np.where(judge, usually, np.inf)
    together = majority_time(unheld, usually, needed[left[0]])
    # And that it is where the fault leaves it: the fault becomes true no earlier than it gets there.
    for (box, X_WB), shown in zip(reached.items(), there, strict=True):
        half, judge = 0.5 * np.array(box.size), judges[box]
        x = np.maximum(x, t + _first((half[:, None, None] - np.abs(_in_box(X_WB, free))).min(axis=0)))
        causes = np.where(shown > surely, "not_in_place", causes)
        surely, judging = np.maximum(surely, shown), np.maximum(judging, np.where(judge, shown, -np.inf))
        until, since = (np.where(judge, shown, other) for other in (-np.inf, np.inf))
        together = np.maximum(together, majority_time(until, since, needed[box]))
    each, latest = np.where(unjudged, surely, judging), stage.motion.time + _NEVER
    x, each, together = (np.minimum(one, latest) for one in (x, each, together))
    return ShownDrops(name, x, each, together, causes)


class _Drops(NamedTuple):
    """A part that the tool loses at each of s instants of an interval."""

    name: str
    t: Array  # The instants, shape (s,) [s]
    times: Array  # These, and as many after them as it takes to follow the last drop, shape (m,) [s]
    states: SceneStates  # Where everything is at these, as long as nothing is lost
    free: Array  # Where the centre of the part is at f times after it is lost, shape (3, s, f) [m]

    def followed(self, track: Array) -> Array:
        """Where a point is while the part falls, shape (3, s, f) [m]; track: at all times, (m, 3)."""
        when = self.t[:, None] + _FALL
        return np.stack([np.interp(when, self.times, component) for component in track.T])


def _first_shown(
    stage: Stage,
    observer: Observer,
    drops: _Drops,
    judges: Mask,
    periods: Array,
    box: SoughtBox,
    seen: Mapping[SoughtBox, Mask],
    reached: Mapping[SoughtBox, Array],
) -> tuple[Array, Mask]:
    """When cameras first show that each drop is surely gone and apart, no longer held, usually gone, and in each box.

    Shape (4 + boxes `reached`, c, s) [s]; -inf where no camera looks, infinite where it never does. And whether it
    parts along the line of sight, (c, s).

    judges: which camera looks at a drop, (c, s). periods: for how long each must go on showing it, (c,) [s]. box: in
    which the tool would show the part. seen: see `_judges`. reached: pose of each box, (4, 4).
    """
    cameras, (name, t, times, states, fallen) = observer.cameras, drops
    camera, start = np.nonzero(judges)  # n looks: pairs of a camera and a drop
    tracks = [states.camera_poses(one)[:, :3, 3] for one in cameras]
    if all(len(track) == 1 for track in tracks):
        eyes = np.array(tracks).reshape(-1, 3).T[:, camera, None]
    else:
        whole = (drops.followed(np.broadcast_to(track, (len(times), 3))) for track in tracks)
        eyes = np.stack(list(whole), axis=1)[:, camera, start]
    focal, period = _focal(cameras)[camera], periods[camera]
    tool, X_WB_held = states.X_WF[name][:, :3, 3], states.box_poses(box)
    held_at = tool.T[..., None] if len(tool) == 1 else drops.followed(tool)
    # Whether each camera sees a place before and after each time; and which of these comes before each of a drop.
    never = np.zeros((1, len(cameras)), dtype=bool)
    beside = {place: np.append(one[:-1] & one[1:], never, axis=0) for place, one in seen.items()}
    known = max(map(len, beside.values()), default=0)
    before = np.searchsorted(times[:known], t[:, None] + _FALL, side="right") - 1
    found, left_open = np.empty((4 + len(reached), len(start))), np.arange(len(start))
    along = np.zeros(judges.shape, dtype=bool)
    for count in (_FIRST, len(_FALL)):
        at, eye, by = start[left_open], eyes[:, left_open, :count], camera[left_open]
        free, lengths = fallen[:, at, :count], focal[left_open]
        expected = held_at if len(tool) == 1 else held_at[:, at, :count]
        R_WB = (X_WB_held if len(X_WB_held) == 1 else X_WB_held[at])[:, :3, :3]
        held = SeenOffset.of(expected, free, eye, lengths, R_WB, np.array(box.size))
        in_a_place = {rule: np.full_like(held.across, -np.inf) for rule in (SURE, USUAL)}
        for place, both in beside.items():
            X_WB = stage.resting[place.frame] @ place.X_FB
            offset = SeenOffset.of(
                X_WB[:, :3, 3].T[..., None], free, eye, lengths, X_WB[:, :3, :3], np.array(place.size)
            )
            is_seen = both[before[at, :count], by[:, None]]
            for rule, most in in_a_place.items():
                np.maximum(most, offset.fills(rule), out=most, where=is_seen)
        apart, clear = zip(*map(held.gone, (SURE, USUAL)), strict=True)
        gone = apart
        if box.limits.kind == "color":
            gone = tuple(map(np.maximum, clear, map(np.minimum, apart, in_a_place.values())))
        inside = [_in_sight(_in_box(X, free), _in_box(X, eye), place.size) for place, X in reached.items()]
        margins = [gone[0], apart[0], apart[1], gone[1], *inside]
        found[:, left_open] = [_first(margin, period[left_open]) for margin in margins]
        when = np.arange(len(left_open)), np.minimum(np.searchsorted(_FALL, found[1, left_open]), count - 1)
        along[by, at] = np.abs(held.nearer[when]) > _ALONG * held.across[when]
        left_open = left_open[np.isinf(found[:, left_open]).any(axis=0)]
        if not len(left_open):
            break
    shown = np.full((len(found), *judges.shape), -np.inf)
    shown[:, camera, start] = t[start] + found
    return shown, along


def _judges(
    stage: Stage, observer: Observer, drops: _Drops, boxes: Sequence[SoughtBox], places: Sequence[SoughtBox]
) -> tuple[dict[SoughtBox, Mask], dict[SoughtBox, Mask]]:
    """Whether each camera judges boxes soon after each loss, (c, s), and sees the places at the first k times, (k, c).

    Of the boxes, cameras count, too, that may judge one or not, and what may be moved is in nobody's way: more of them
    only ever show a drop later. Of a place, one that counts is sure to look for the part there, past a tool that has
    lost it.
    """
    some = drops.times[drops.times <= drops.t[-1] + _SOON + drops.t[1] - drops.t[0]]
    judged_at, lost = _judged_at(observer, boxes, drops.states, len(some)), stage.once_lost()
    own = [Target(Atom(box.name), 1, (replace(box, limits=box.limits.judging),)) for box in places]
    verdicts = observer.verdicts(own, lost.states(lost.samples_at(some)), shares=False, culprits=False)
    seen = {place: verdict.cause == Cause.NONE for place, (verdict,) in zip(places, verdicts, strict=True)}
    first, last = (np.searchsorted(some, edge) for edge in (drops.t, drops.t + _SOON))
    windows = [slice(max(i - 1, 0), j + 1) for i, j in zip(first, last, strict=True)]
    return {box: np.transpose([one[window].any(axis=0) for window in windows]) for box, one in judged_at.items()}, seen


def _judge_later(stage: Stage, observer: Observer, drops: _Drops, boxes: Sequence[SoughtBox]) -> Mask:
    """Which of c cameras judge boxes at any time from the first loss to the end of the motion; all if none does, (c,).

    A camera that never does shows nothing, and contradicts none.
    """
    t = np.arange(drops.t[0], stage.motion.time + _STEP, _STEP)
    found = [at.any(axis=0) for at in _judged_at(observer, boxes, stage.states(stage.samples_at(t)), len(t)).values()]
    ever: Mask = np.any(found, axis=0)
    return ever if ever.any() else ~ever


def _judged_at(
    observer: Observer, boxes: Sequence[SoughtBox], states: SceneStates, count: int
) -> dict[SoughtBox, Mask]:
    """Whether each camera may judge boxes in the first states, through what may be moved; shape (count, c) each."""
    if not observer.cameras:
        return {box: np.zeros((count, 0), dtype=bool) for box in boxes}
    movable = [one.part.name for one in observer.solids if one.movable]
    own = [replace(box, limits=box.limits.judging).seen_through(movable) for box in boxes]
    targets, rows = [Target(Atom(box.name), 1, (box,)) for box in own], [np.arange(count)] * len(own)
    verdicts = observer.verdicts(targets, states, rows=rows, culprits=False)
    looks = zip(boxes, own, verdicts, strict=True)
    return {box: may_judge(one, verdict, observer.cameras, states) for box, one, (verdict,) in looks}


def _in_sight(part: Array, eye: Array, size: Sequence[float]) -> Array:
    """How far inside a box of a size the line of sight through the part meets its middle plane, (n, f) [m].

    part, eye: in the frame of the box, (3, n, f).
    """
    ray = part - eye
    met = part[:2] - ray[:2] * (part[2] / np.where(np.abs(ray[2]) > 1e-6, ray[2], 1e-6))
    inside: Array = (0.5 * np.array(size)[:2, None, None] - np.abs(met)).min(axis=0)
    return inside


def majority_time(until: Array, since: Array, needed: int) -> Array:
    """When more cameras say something than say the opposite, and as many as needed, shape (s,) [s]; infinite if never.

    until: when each of c cameras ceases to say the opposite, (c, s) [s]. since: when each says it, (c, s) [s].
    """
    times = np.concatenate([until, since])
    yes = (since[None] <= times[:, None]).sum(axis=1)
    no = (until[None] > times[:, None]).sum(axis=1)
    found: Array = np.where((yes > no) & (yes >= needed), times, np.inf).min(axis=0, initial=np.inf)
    return found


def held_in(stage: Stage, interval: TimeInterval) -> str | None:
    """What the tool holds throughout an interval."""
    primitives = stage.motion.primitives
    held = {p.held for p in primitives if p.start < interval.end - 1e-9 and p.end > interval.start + 1e-9}
    return held.pop() if len(held) == 1 else None


def _between(x: Array, shown: Array, interval: TimeInterval) -> Onset:
    """The onset of what becomes true at x and is shown from some times on, within an interval."""
    x = np.maximum.accumulate(x)
    lag = np.maximum(shown - x, 0.0)
    kept = np.append(np.diff(x) > 1e-9, True)
    inner = (x > interval.start) & (x < interval.end) & kept
    at = np.concatenate([[interval.start], x[inner], [interval.end]])
    return Onset(at, np.maximum.accumulate(at + np.interp(at, x[kept], lag[kept])))


def _falling(stage: Stage, observer: Observer, name: str, X_WO: Array, times: Array, starts: int) -> Array:
    """Where the centre of a lost part is, shape (3, s, f) [m].

    It falls freely to where it stood or is to stand, else onto the first solid below where it is lost, or the floor.

    X_WO: of the part in the tool, at `times`, (n, 4, 4). starts: how many of them are starts of a fall, s.
    """
    path = X_WO[:, :3, 3]
    start, velocity = path[:starts], np.gradient(path, times, axis=0)[:starts]
    floor = start[:, 2] - _height(observer, stage, name, X_WO[:starts])
    begins_held = stage.motion.primitives[0].held == name
    for X_rest in (None if begins_held else stage.X_WO[name], stage.motion.final.X_WO.get(name)):
        if X_rest is not None:
            above = np.hypot(*(start - X_rest[:3, 3])[:, :2].T) < 0.02
            floor = np.where(above, np.maximum(floor, X_rest[2, 3]), floor)
    up, height = velocity[:, 2], np.maximum(start[:, 2] - floor, 0.0)
    fall = np.minimum(_FALL, ((up + np.sqrt(up**2 + 2.0 * GRAVITY * height)) / GRAVITY)[:, None])
    free: Array = start.T[..., None] + velocity.T[..., None] * fall
    free[2] -= 0.5 * GRAVITY * fall**2
    return free


def _height(observer: Observer, stage: Stage, name: str, X_WO: Array) -> Array:
    """How far an object at s poses (s, 4, 4) is above what lies below its middle and its corners, shape (s,) [m]."""
    others = [one for one in observer.solids if one.part.parent != name and one.part.parent in stage.resting]
    X_WP = np.array([stage.resting[one.part.parent][0] for one in others]).reshape(-1, 4, 4)
    corners = np.concatenate([one.corners for one in observer.solids if one.part.parent == name])
    at = transform(X_WO, corners)
    bottom, middle = at[..., 2].min(axis=1), at.mean(axis=1, keepdims=True)
    feet = np.concatenate([middle, middle + 0.9 * (at - middle)], axis=1)[..., :2]
    columns, of = np.unique(feet.round(3).reshape(-1, 2), axis=0, return_inverse=True)  # few where it is lifted
    # The faces of what may be above or below.
    balls = transform(X_WP, np.array([one.center for one in others]).reshape(-1, 1, 3))[:, 0, :2]
    radii = np.array([one.radius for one in others])[:, None] + 1e-9
    close = ((balls >= columns.min(axis=0) - radii) & (balls <= columns.max(axis=0) + radii)).all(axis=1)
    faces = [transform(X_WP[k], others[k].vertices)[others[k].triangles] for k in np.flatnonzero(close)]
    a, b, c = np.moveaxis(np.concatenate([np.empty((0, 3, 3)), *faces]), 1, 0)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    q, r = b - a, c - a
    area = q[:, 0] * r[:, 1] - q[:, 1] * r[:, 0]
    near = (low[:, :2] <= columns.max(axis=0)).all(axis=1) & (high[:, :2] >= columns.min(axis=0)).all(axis=1)
    near &= np.abs(area) > 1e-12
    a, q, r, area = (one[near, None] for one in (a, q, r, area))
    x, y = np.moveaxis(columns - a[..., :2], 2, 0)
    u, v = (x * r[..., 1] - y * r[..., 0]) / area, (y * q[..., 0] - x * q[..., 1]) / area
    z = np.where((u >= 0) & (v >= 0) & (u + v <= 1), a[..., 2] + u * q[..., 2] + v * r[..., 2], -np.inf)
    z = z[:, of.reshape(len(X_WO), -1)]
    tops = np.where(z <= bottom[:, None] + CLEARANCE, z, -np.inf).max(axis=(0, 2), initial=-np.inf)
    if np.isinf(tops).any():  # only the floor is below
        lowest = (transform(X, one.vertices)[:, 2].min() for X, one in zip(X_WP, others, strict=True))
        tops = np.maximum(tops, min([0.0, *lowest]) - FLOOR_DEPTH)
    height: Array = np.maximum(bottom - tops, 0.0)
    return height


def may_judge(box: SoughtBox, seen: BoxVerdicts, cameras: Sequence[Camera], states: SceneStates) -> Mask:
    """Whether each of c cameras may judge a box, though something may hide a little more than allowed, shape (n, c)."""
    least = np.full(seen.cause.shape, box.limits.min_visible)
    if box.limits.kind == "color":
        eyes = np.stack(np.broadcast_arrays(*(states.camera_poses(camera)[: len(least), :3, 3] for camera in cameras)))
        far = np.linalg.norm(states.box_poses(box)[: len(least), :3, 3] - eyes, axis=-1).T
        least = np.maximum(least - BORDER * far / (_focal(cameras) * _spread(np.array(box.size))), LEAST_SHARE)
    in_free_view = (seen.cause == Cause.NONE) | (seen.cause > Cause.HIDDEN)
    found: Mask = np.where(seen.cause == Cause.HIDDEN, seen.visible >= least, in_free_view)
    return found


def _focal(cameras: Sequence[Camera]) -> Array:
    """Focal lengths of c cameras, shape (c,) [pixels]."""
    return np.array([np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]) for camera in cameras])


def _spread(size: Array) -> float:
    """Square root of the mean area of the silhouette of a box of full extents (3,) [m]."""
    return float(np.sqrt(0.5 * (size * np.roll(size, 1)).sum()))


def _in_box(X_WB: Array, points: Array) -> Array:
    """Points by component, (3, ...), from the world into a box's frame."""
    found: Array = np.tensordot(X_WB[:3, :3].T, points - X_WB[:3, 3].reshape(3, 1, 1), 1)
    return found


def _dot(a: Sequence[Array] | Array, b: Sequence[Array] | Array) -> Array:
    """Inner products of vectors by component, (3, ...)."""
    found: Array = a[0] * b[0]
    found += a[1] * b[1]
    found += a[2] * b[2]
    return found


def _first(margin: Array, least: Array | None = None) -> Array:
    """When a margin (n, f) is first not negative after the loss for a least time (n,) [s], shape (n,) [s].

    Infinite if it never is, as far as the first f times tell.
    """
    times, end = _FALL[: margin.shape[1]], min(_FALL[margin.shape[1] :], default=np.inf)
    bad = np.where(margin < 0.0, times, end)
    lasts = np.minimum.accumulate(bad[:, ::-1], axis=1)[:, ::-1] - times
    good = (margin >= 0.0) & (lasts >= (0.0 if least is None else least[:, None]))
    index = good.argmax(axis=1)
    before = np.maximum(index - 1, 0)
    late, early = (margin[np.arange(len(margin)), i] for i in (index, before))
    with np.errstate(invalid="ignore"):
        share = np.where((index > 0) & np.isfinite(early) & (early < 0), early / np.minimum(early - late, -1e-12), 1.0)
    found = _FALL[before] + np.clip(share, 0.0, 1.0) * (_FALL[index] - _FALL[before])
    return np.where(good.any(axis=1), found, np.inf)
