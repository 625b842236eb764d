"""What the cameras of a cell see surely, from every pose within bounds, or possibly, from some pose at least.

The limits of camera and detector are those of `sensing.limits`. A camera that moves by less than t and turns by less
than a sees a point at the distance r in a direction that differs by at most a + asin(t / r), wherever it is and however
it turned; the other bounds follow from that and from triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.programming.sensing.bounded.bounds import AnyHullTester, PoseBounds, common_hulls
from sqrp_cli.programming.sensing.bounded.centres import ViewedBoxes
from sqrp_cli.programming.sensing.bounded.shares import NearSolids, visible_enough
from sqrp_cli.programming.sensing.limits import Cause, LimitVerdicts, bend, entries_at, hull_areas, to_pixels
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.sensing.sight_lines import BoxViews, Pairs, SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.visibility.backdrop import backdrop_bounds
from sqrp_cli.programming.sensing.visibility.lighting import light_bounds
from sqrp_cli.programming.sensing.visibility.occlusion import near_pairs
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.targets import SoughtBox, Target

_ROUND = 2 * np.pi


class Enclosure(NamedTuple):
    """Numbers between two, of equal shape."""

    low: Array
    high: Array

    def plus(self, other: Enclosure) -> Enclosure:
        """The sum."""
        return Enclosure(self.low + other.low, self.high + other.high)

    def scaled(self, factor: float) -> Enclosure:
        """The product with a number; 0 if that is 0, however far the interval reaches."""
        if factor == 0.0:
            return Enclosure(np.zeros_like(self.low), np.zeros_like(self.high))
        ends = factor * self.low, factor * self.high
        return Enclosure(*ends) if factor > 0 else Enclosure(*ends[::-1])

    def times(self, other: Enclosure) -> Enclosure:
        """The product of two finite ones."""
        ends = [a * b for a in self for b in other]
        return Enclosure(np.minimum.reduce(ends), np.maximum.reduce(ends))


def cosines(middle: Array, spread: Array) -> Enclosure:
    """The cosines of the angles that differ from `middle` by up to `spread` [rad]."""
    low, high = middle - spread, middle + spread
    ends = np.cos(low), np.cos(high)
    # The first multiple of a whole turn, and the first of those half a turn beyond, from `low` on.
    top = np.ceil(low / _ROUND) * _ROUND <= high
    bottom = (np.ceil(low / _ROUND - 0.5) + 0.5) * _ROUND <= high
    return Enclosure(np.where(bottom, -1.0, np.minimum(*ends)), np.where(top, 1.0, np.maximum(*ends)))


_RIGHT, _FAR = 0.5 * np.pi, 1e6
"""A right angle [rad], and how far from the axis, in the plane z = 1, nothing is in any image."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundedBoxes(WatchedBoxes):
    """Boxes whose limits hold surely, for every pose of each camera, or possibly, for some pose."""

    bounds: PoseBounds
    surely: bool

    def check(
        self, projections: Sequence[Projection], box: Indices, *, corners_C: Array, normal_C: Array
    ) -> LimitVerdicts:
        """The limits that no pose, or not every pose meets, each looked at by itself; without figures."""
        bounds, sure = self.bounds, self.surely
        rows = [(p.camera.width, p.camera.height, p.camera.near, p.camera.far) for p in projections]
        width, height, near, far = np.array(rows, dtype=float).T[:, :, None]
        limits = [entry.limits for entry in self.boxes]
        columns = [(*entry.distance, entry.max_incidence, entry.min_pixels) for entry in limits]
        closest, remotest, widest, smallest = np.array(columns, dtype=float).T[:, box]
        depth = _depths(corners_C, bounds)
        nearest = (depth.low if sure else depth.high).min(axis=0)
        farthest = (depth.high if sure else depth.low).max(axis=0)
        center = corners_C.mean(axis=1)
        distance = np.sqrt((center * center).sum(axis=0))
        away = bounds.reach if sure else -bounds.reach
        incidence = _incidence(normal_C, center, distance) + (1.0 if sure else -1.0) * bounds.parallax(distance)
        u, v, shown = _pixels(projections, corners_C, bounds, sure=sure)
        first, last = (0, 1) if sure else (1, 0)  # the ends that must lie in the image
        in_image = shown & (u[first] >= -0.5).all(axis=0) & (u[last] <= width - 0.5).all(axis=0)
        in_image &= (v[first] >= -0.5).all(axis=0) & (v[last] <= height - 0.5).all(axis=0)
        in_front = nearest > 0
        checked = [
            (Cause.BEHIND, in_front),
            (Cause.TOO_NEAR, nearest >= near),
            (Cause.TOO_FAR, farthest <= far),
            (Cause.OUT_OF_IMAGE, in_image),
            (Cause.DETECTOR_NEAR, distance - away >= closest),
            (Cause.DETECTOR_FAR, distance + away <= remotest),
            (Cause.OBLIQUE, ~normal_C.any(axis=0) | (incidence <= widest)),
        ]
        cause = np.full(distance.shape, np.int8(Cause.NONE))
        for code, within in reversed(checked):
            cause[~within] = code
        large = _sizes_allowed(projections, corners_C, smallest, bounds, sure=sure)
        cause[(cause == Cause.NONE) & ~large] = Cause.TOO_SMALL
        return LimitVerdicts(cause=cause, side=np.full(cause.shape, np.int8(-1)), figure=np.zeros(cause.shape))


def _depths(corners_C: Array, bounds: PoseBounds) -> Enclosure:
    """Depths of points (3, ...), which are the cosines of their angles with the axis, times their distances [m]."""
    distance = np.sqrt((corners_C * corners_C).sum(axis=0))
    angle = np.arccos(np.clip(corners_C[2] / np.maximum(distance, 1e-300), -1.0, 1.0))
    low = distance * np.cos(np.minimum(angle + bounds.turn, np.pi)) - bounds.reach
    return Enclosure(low, distance * np.cos(np.maximum(angle - bounds.turn, 0.0)) + bounds.reach)


def _incidence(normal_C: Array, center: Array, distance: Array) -> Array:
    """Angles between normals and the directions to the camera [rad]."""
    cosine = -(normal_C * center).sum(axis=0) / np.maximum(distance, 1e-12)
    found: Array = np.arccos(np.clip(cosine, -1.0, 1.0))
    return found


def _pixels(
    projections: Sequence[Projection], corners_C: Array, bounds: PoseBounds, *, sure: bool
) -> tuple[Enclosure, Enclosure, Mask]:
    """Pixels u and v of corners (3, 8, c, n), and which boxes (c, n) the lens surely or possibly shows."""
    shape = corners_C.shape[1:]
    u, v = (Enclosure(np.empty(shape), np.empty(shape)) for _ in range(2))
    shown = np.ones(shape[1:], dtype=bool)
    for number, projection in enumerate(projections):
        points = corners_C[:, :, number]
        spread = bounds.angles(np.sqrt((points * points).sum(axis=0)))
        if projection.camera.distortion_model == "none":
            x, y = (_tangents(points, axis, spread) for axis in (0, 1))
        else:
            x, y, shown[number] = _bent(projection, points, spread, sure=sure)
        for interval, row in zip((u, v), projection.camera.matrix[:2].tolist(), strict=True):
            low, high = x.scaled(row[0]).plus(y.scaled(row[1]))
            interval.low[:, number], interval.high[:, number] = low + row[2], high + row[2]
    return u, v, shown


def _tangents(points: Array, axis: int, spread: Array) -> Enclosure:
    """Where directions within `spread` [rad] of points (3, ...) meet the plane z = 1, along one axis.

    The planes through the other axis that touch the cone of these directions are turned by asin(sin s / w), with the
    length w of the unit direction's part across that axis.
    """
    distance = np.sqrt((points * points).sum(axis=0))
    across = np.hypot(points[axis], points[2]) / np.maximum(distance, 1e-300)
    reach = np.sin(np.minimum(spread, _RIGHT)) / np.maximum(across, 1e-300)
    turn = np.where(reach < 1.0, np.arcsin(np.minimum(reach, 1.0)), np.pi)
    angle = np.arctan2(points[axis], points[2])
    low, high = angle - turn, angle + turn
    return Enclosure(_tangent(low), _tangent(high))


def _tangent(angle: Array) -> Array:
    """Tangents of angles, `_FAR` at most; beyond a right angle, which is never shown, that."""
    return np.clip(np.tan(np.clip(angle, -_RIGHT, _RIGHT)), -_FAR, _FAR)


def _bent(projection: Projection, points: Array, spread: Array, *, sure: bool) -> tuple[Enclosure, Enclosure, Mask]:
    """Where a lens shows directions within `spread` [rad] of points (3, 8, n): x and y in the plane z = 1.

    The cone lies within angles from the axis and about it. Up to the projection's radius, the radial distortion grows
    with the former, so that it maps ends to ends; the rest of the distortion is a polynomial of second degree.

    With which boxes (n,) the lens surely or possibly shows; what it never shows is left out of x and y.
    """
    axial = np.arctan2(np.hypot(points[0], points[1]), points[2])
    near, far = _tangent(np.maximum(axial - spread, 0.0)), _tangent(axial + spread)
    inside: Mask = np.all((far if sure else near) <= projection.radius, axis=0)
    plane = Enclosure(np.minimum(near, projection.radius), np.minimum(far, projection.radius))
    round_axis = np.sin(np.minimum(spread, _RIGHT)) / np.maximum(np.sin(axial), 1e-300)
    turn = np.where(round_axis < 1.0, np.arcsin(np.minimum(round_axis, 1.0)), np.pi)
    about = np.arctan2(points[1], points[0])
    cosine, sine = cosines(about, turn), cosines(about - _RIGHT, turn)
    camera = projection.camera
    tangential = np.zeros(2) if camera.distortion_model == "equidistant" else camera.distortion[2:4]
    straight = np.array(camera.distortion)
    if camera.distortion_model != "equidistant":
        straight[2:4] = 0.0
    radial = replace(projection, camera=replace(camera, distortion=straight))
    bent = Enclosure(*(radial.bent(np.stack([r, np.zeros_like(r)], axis=-1)).points[..., 0] for r in plane))
    x, y = bent.times(cosine), bent.times(sine)
    p1, p2 = tangential.tolist()
    if p1 or p2:
        u, v = plane.times(cosine), plane.times(sine)
        mixed, square = u.times(v).scaled(2.0), plane.times(plane)
        x = x.plus(mixed.scaled(p1)).plus(square.plus(_square(u).scaled(2.0)).scaled(p2))
        y = y.plus(mixed.scaled(p2)).plus(square.plus(_square(v).scaled(2.0)).scaled(p1))
    return x, y, inside


def _square(values: Enclosure) -> Enclosure:
    """Squares of the numbers."""
    low, high = values.times(values)
    return Enclosure(np.maximum(low, 0.0), high)


def _sizes_allowed(
    projections: Sequence[Projection], corners_C: Array, smallest: Array, bounds: PoseBounds, *, sure: bool
) -> Mask:
    """Whether boxes in front of the cameras (c, n) are surely or possibly shown as large as `smallest` (n,) [pixels].

    A box's image from another centre is, in the plane z = 1, shifted, as much larger as the box is nearer, and no
    corner is else displaced by more than `sweep`. How many pixels an area gets changes, in logarithms, by the angle
    times the slope of their density: for a turn that of 1 / cos^3, and for both what the lens makes of it.
    """
    depth = corners_C[2]
    plane = corners_C[:2] / np.where(depth > 0, depth, 1.0)
    distance = np.sqrt((corners_C * corners_C).sum(axis=0))
    nearest, middle, farthest = depth.min(axis=0), depth.mean(axis=0), depth.max(axis=0)
    t, slant = bounds.reach, (distance / np.maximum(depth, 1e-300)).max(axis=0)
    clear = nearest > 2.0 * t
    gap = np.where(clear, nearest - t, 1.0)
    sweep = t * slant * np.maximum(middle - nearest, farthest - middle) / (gap * np.where(clear, middle, 1.0))
    width, height = np.ptp(plane, axis=1)
    sides = width + height
    # Where the quadrilateral of four corners is slim, the hull is looked at.
    area = hull_areas(plane[0], plane[1], _extremes(plane[0], plane[1]), 0.4 * width * height)
    uneven = np.where(area > 0, _SWEPT * sides * sweep / np.maximum(area, 1e-300), np.inf)
    turned = np.arctan(np.sqrt((plane * plane).sum(axis=0))).max(axis=0)
    turn = bounds.angles(distance).max(axis=0)
    # A shift changes nothing that a lens without distortion shows of a plane parallel to the image.
    uneven_lens = np.stack(
        [
            bounds.turn * 3.0 * np.tan(np.minimum(at + by, _RIGHT - 1e-3)) + by * _bending(projection)(at + by)
            for projection, at, by in zip(projections, turned, turn, strict=True)
        ]
    )
    if sure:
        factor = np.maximum(1.0 - uneven, 0.0) * (middle / (middle + t)) ** 2 * np.exp(-uneven_lens)
    else:
        larger = 1.0 + uneven + np.pi * sweep**2 / np.maximum(area, 1e-300)
        # Infinite where wide bounds leave nothing known; what is not in front of the camera is replaced below.
        with np.errstate(over="ignore", invalid="ignore"):
            factor = larger * (middle / gap) ** 2 * np.exp(uneven_lens)
    factor = np.where(clear, factor, 0.0 if sure else np.inf)
    bend(projections, plane)
    u, v = to_pixels(projections, plane)
    enough = smallest**2 / np.maximum(factor, 1e-200)
    return hull_areas(u, v, _extremes(u, v), enough) >= enough


def _extremes(u: Array, v: Array) -> Array:
    """U and v of the points (8, ...) that are farthest left, right, up and down, shape (2, 4, ...)."""
    return entries_at((u, v), (u.argmin(axis=0), u.argmax(axis=0), v.argmin(axis=0), v.argmax(axis=0)))


_SWEPT = 2.1
"""How much of its image a box may gain or lose per corner's displacement, in sums of the sides of the rectangle around
it: no more than its perimeter, which is at most twice that; the rest is for an uneven density of pixels."""

_RINGS, _SPOKES = 400, 16
"""Where the density of pixels is looked at, about the axis of a lens."""


def _bending(projection: Projection) -> Callable[[Array], Array]:
    """How fast the logarithm of the pixels per area of the plane z = 1 changes with the direction, up to an angle."""
    if projection.camera.distortion_model == "none":
        return np.zeros_like
    widest = min(np.arctan(projection.radius), _RIGHT - 1e-2)
    angle, about = np.linspace(0.0, widest, _RINGS)[1:-1, None], np.arange(_SPOKES) * (2 * np.pi / _SPOKES)
    radius, step = np.tan(angle), 1e-5

    def bent(away: float, aside: float) -> Array:
        r = radius + away
        points = np.stack([r * np.cos(about) - aside * np.sin(about), r * np.sin(about) + aside * np.cos(about)], -1)
        return projection.bent(points).points

    along, over = (bent(step, 0.0) - bent(-step, 0.0), bent(0.0, step) - bent(0.0, -step))
    density = np.abs(along[..., 0] * over[..., 1] - along[..., 1] * over[..., 0]) / (4 * step * step)
    logarithm = np.log(np.maximum(density, 1e-12))
    outward = np.abs(np.gradient(logarithm, angle[:, 0], axis=0))
    around = np.abs(logarithm - np.roll(logarithm, 1, axis=1)) * _SPOKES / (2 * np.pi * np.sin(angle))
    steepest = np.maximum.accumulate(np.hypot(outward, around).max(axis=1))
    return lambda at: 1.1 * np.interp(at, angle[:, 0], steepest, right=np.inf)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundedObserver(Observer):
    """The cameras of a cell, of which each may be anywhere within bounds, with all its solids.

    Covered is, of each target, what enough cameras see surely, whatever their poses; or possibly, where not even the
    best pose of each helps the others. The response is that of the slowest or fastest of them.
    """

    bounds: PoseBounds
    surely: bool
    _any_tester: AnyHullTester = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "_any_tester", AnyHullTester(self.bounds))

    def _watched(self, boxes: Sequence[SoughtBox], states: SceneStates, cameras: Indices | None = None) -> WatchedBoxes:
        some = self._some(cameras)
        return BoundedBoxes(boxes, some, self._solids, states, bounds=self.bounds, surely=self.surely)

    def _near(self, watched: WatchedBoxes, lines: SightLines) -> Pairs:
        return near_pairs(lines, watched.solid_poses, watched.opaque, self.bounds.reach)

    @classmethod
    def of(cls, observer: Observer, bounds: PoseBounds, *, surely: bool) -> BoundedObserver:
        """The same cell, with its cameras within bounds."""
        return cls(observer.cameras, observer.solids, observer.lights, bounds=bounds, surely=surely)

    def viewed(self, target: Target, states: SceneStates) -> ViewedBoxes:
        """What the first camera sees of a target, of whose boxes a part must be visible."""
        watched, count = self._watched(target.boxes, states), len(target.boxes)
        box, state = np.repeat(np.arange(count), states.count), np.tile(np.arange(states.count), count)
        within = (watched.limits(box, state).cause[0] == Cause.NONE).reshape(count, -1).all(axis=0)
        rows = np.repeat(np.flatnonzero(within), count)
        lines = watched.sight_lines(BoxViews(np.arange(len(rows)) % count, np.zeros_like(rows), rows))
        near, gain = self._near(watched, lines), np.repeat(watched.gains[:1], len(rows))
        return ViewedBoxes(
            within=within,
            lines=lines,
            poses=watched.solid_poses,
            near=NearSolids.of(lines, watched.solid_poses, near, self.bounds.reach),
            surely=replace(self, surely=True)._needed(watched, lines, gain),
            possibly=replace(self, surely=False)._needed(watched, lines, gain),
            bounds=self.bounds,
        )

    def _needed(self, watched: WatchedBoxes, lines: SightLines, gain: Array) -> Array:
        bounds = backdrop_bounds(lines, watched.boxes, watched.solid_poses, watched.alike, self.bounds.reach)
        lost = light_bounds(lines, watched, gain, tuple(self.lights.values())) if self.lights else None
        needed = bounds.needed(watched.least_of(lines), lost)
        return needed.high if self.surely else needed.low

    def _unseen(self, watched: WatchedBoxes, lines: SightLines, near: Pairs, needed: Array) -> Indices:
        poses, finite, every = watched.solid_poses, lines.finite[lines.hull], watched.least_of(lines) >= 1
        partly, whole = near.of_lines(~every), near.of_lines(every)
        seen = visible_shares(lines, poses, partly, enough=needed)
        enough = np.ones(len(needed), dtype=bool)
        enough[seen.line[seen.share < needed[seen.line]]] = False
        if self.surely:
            enough &= visible_enough(lines, poses, partly.of_lines(enough), needed, self.bounds, surely=True)
            met = self._any_tester.met(lines, poses, whole, first_only=True)
        else:
            enough |= visible_enough(lines, poses, partly.of_lines(~enough & finite), needed, self.bounds, surely=False)
            met = self._met_by_all(lines, watched, whole)
        return np.concatenate([np.flatnonzero(~enough), met.line])

    def _met_by_all(self, lines: SightLines, watched: WatchedBoxes, pairs: Pairs) -> Pairs:
        """Pairs of the lines whose view hulls surely meet something, first those of the middle poses."""
        poses, hidden = watched.solid_poses, np.zeros(len(lines.state), dtype=bool)
        hidden[self._tester.met(lines, poses, pairs, first_only=True).line] = True
        wanted = np.zeros(len(lines.box), dtype=bool)
        wanted[lines.hull[hidden]] = True
        common = common_hulls(lines, self.bounds, wanted)
        known = hidden & (common.known | ~lines.finite)[lines.hull]
        return self._tester.met(common.lines, poses, pairs.of_lines(known), first_only=True)
