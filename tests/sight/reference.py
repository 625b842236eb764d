"""What a camera sees of a box, said once more by the definitions (docs/reference/numbers.md), slowly and plainly.

Limit by limit, solid by solid, triangle by triangle, ray by ray; nothing is kept or shared, and only triangles that lie
wholly beyond a side of the view hull are passed over. Hulls are Qhull's and lenses OpenCV's. Only numbers of the
definitions (rays, skin, thresholds) are the kernel's too. `Verdict.sure` is False where a decision is so close that
rounding, or the flat faces that stand for round shapes here, may turn it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import acos, atan2, cos, hypot, inf, sin, sqrt
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import ANY_BRIGHTNESS, MARKER, Light, brightness_of, look_alike
from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, transform
from sqrp_cli.shapes import Mesh
from sqrp_cli.sight.limits import SIDES, Cause
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox

ROWS, COLUMNS, BEHIND_RAYS, SKIN = 64, 32, 16, 1e-3
CLOSE = 1e-6


class Verdict(NamedTuple):
    cause: Cause
    by: str | None = None
    figure: float = 0.0
    visible: float = float("nan")
    sure: bool = True


@dataclass(eq=False)
class Scene:
    """A camera, a box, solids and lights in one state; X: the poses of frames in the world, (4, 4) each."""

    camera: Camera
    box: SoughtBox
    solids: Sequence[Solid]
    X: Mapping[str, Array]
    lights: Mapping[str, Light] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.X_WC, self.X_WB = self.X[self.camera.frame] @ self.camera.X_FC, self.X[self.box.frame] @ self.box.X_FB
        size = np.array(self.box.size)
        thin = size <= 2 * SKIN + 1e-9
        # Half the sides of the box without its skin, and its middle in its own frame.
        self.half = np.where(thin, size, size - 2 * SKIN) / 2
        self.middle = SKIN * np.array(self.box.normal) if thin.any() and self.box.normal is not None else np.zeros(3)
        self.opaque = [s for s in self.solids if not {s.part.parent, s.part.name} & set(self.box.encloses)]
        self.names = sorted({one.name for one in self.opaque})

    def triangles(self, *solids: Solid) -> Array:
        """In the world, (f, 3, 3)."""
        placed = [transform(self.X[one.part.parent], one.vertices)[one.triangles] for one in solids]
        return np.concatenate([np.zeros((0, 3, 3)), *placed])

    def visible(self, view: View) -> float:
        """The share of rays that nothing blocks."""
        return float(np.isinf(view.depths(self.triangles(*self.opaque))).sum() / view.count)


def verdict(scene: Scene) -> Verdict:
    found, least, view = limit(scene), scene.box.limits.min_visible, View(scene.X_WC, scene)
    if found.cause is not Cause.NONE:
        return found
    sure, visible = found.sure, 1.0
    if least < 1:
        visible = scene.visible(view)
        sure &= abs(visible - least) > 4 / view.count
        if visible < least:
            by, clear = largest(scene, view)
            return Verdict(Cause.HIDDEN, by, 0.0, visible, sure and clear)
    else:
        met = [(one, *reach(scene, view, one)) for one in scene.opaque]
        sure &= all(clear for *_, clear in met)
        if hit := [one for one, reaches, _ in met if reaches]:
            by, clear = first(scene, view, hit)
            return Verdict(Cause.HIDDEN, by, 0.0, scene.visible(view), sure and clear)
    behind, alike = background(scene)
    reasons = [(Cause.SAME_COLOUR, alike, 0.0, True), *([lighting(scene)] if scene.lights else ())]
    for cause, by, lost, clear in reasons:
        told = max(least, (min(least, 0.5) + behind) / max(1 - lost, 1e-9)) if behind > 0 or lost > 0 else least
        sure &= clear and (abs(visible - told) > 4 / view.count or told <= least)
        if visible < told:
            return Verdict(cause, by, 0.0, visible, sure)
    return Verdict(Cause.NONE, None, 0.0, visible, sure)


def limit(scene: Scene) -> Verdict:
    camera, box, limits, margins = scene.camera, scene.box, scene.box.limits, []
    X_CB = inverse(scene.X_WC) @ scene.X_WB
    corners = transform(X_CB, BOX_SIGNS * box.size / 2)
    low, high = corners[:, 2].min(), corners[:, 2].max()

    def fails(by: float) -> bool:
        margins.append(abs(by))
        return not by <= 0

    def found(cause: Cause, by: float, side: str | None = None) -> Verdict:
        return Verdict(cause, side, by, sure=min(margins) > 1e-7)

    for cause, by in ((Cause.BEHIND, -low), (Cause.TOO_NEAR, camera.near - low), (Cause.TOO_FAR, high - camera.far)):
        if fails(by) or low == 0:
            return found(cause, by)
    pixels, w, h = np.array([pixel(camera, p) for p in corners]), camera.width - 0.5, camera.height - 0.5
    shown, (left, top), (right, bottom) = all(in_lens(camera, p) for p in corners), pixels.min(0), pixels.max(0)
    out = [-0.5 - left, right - w, -0.5 - top, bottom - h]
    outside = fails(max(out))
    if limits.is_usual and limits.kind == "color" and outside and shown:
        whole = ConvexHull(pixels)
        sides = [((-1, 0), 0.5), ((1, 0), w), ((0, -1), 0.5), ((0, 1), h)]
        rest = cut(list(pixels[whole.vertices]), [(np.array(n, dtype=float), o) for n, o in sides])
        outside = fails(limits.min_visible - (ConvexHull(rest).volume / whole.volume if rest else 0.0))
    if outside or not shown:
        return found(Cause.OUT_OF_IMAGE, max(max(out), 0.0), SIDES[out.index(max(out))])
    distance, angle = float(np.linalg.norm(X_CB[:3, 3])), 0.0
    if box.normal is not None:
        angle = acos(max(-1.0, min(1.0, float(-(X_CB[:3, :3] @ box.normal) @ X_CB[:3, 3]) / distance)))
    for cause, by in (
        (Cause.DETECTOR_NEAR, limits.distance[0] - distance),
        (Cause.DETECTOR_FAR, distance - limits.distance[1]),
        (Cause.OBLIQUE, angle - limits.max_incidence),
        (Cause.TOO_SMALL, float(limits.smallest(camera, np.array([angle]))[0]) - sqrt(ConvexHull(pixels).volume)),
    ):
        if fails(by):
            return found(cause, by)
    return found(Cause.NONE, 0.0)


def projected(camera: Camera, points: Array, matrix: Array, bent: Array) -> Array:
    """By OpenCV, (n, 2)."""
    is_fisheye, still = camera.distortion_model == "equidistant" and bent.any(), np.zeros(3)
    project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
    return project(points.reshape(-1, 1, 3), still, still, matrix, bent)[0].reshape(-1, 2)


def in_lens(camera: Camera, p: Array) -> bool:
    """Whether the image moves outwards all the way from the axis to the point, in 2,000 steps; by the radial terms."""
    along = np.outer(np.arange(1, 2001) / 2000, [hypot(p[0] / p[2], p[1] / p[2]), 0, 0]) + np.array([0, 0, 1])
    tangential = [] if camera.distortion_model == "equidistant" else [2, 3]
    radial = np.where(np.isin(np.arange(len(camera.distortion)), tangential), 0.0, camera.distortion)
    found = projected(camera, along, np.eye(3), radial if len(radial) else np.zeros(4))
    return bool((np.diff(found[:, 0], prepend=0.0) > 0).all())


def pixel(camera: Camera, p: Array) -> Array:
    """What the lens does not show is as if it did not bend."""
    bends = len(camera.distortion) and in_lens(camera, p)
    return projected(camera, p, camera.matrix, camera.distortion if bends else np.zeros(4))[0]


# Half spaces: (n, o) of the points n . p <= o


def half_spaces(points: Array) -> list[tuple[Array, float]]:
    """Those of a convex hull."""
    return [(one[:3], -one[3]) for one in ConvexHull(points).equations]


def near(triangles: Array, spaces: Sequence[tuple[Array, float]]) -> Array:
    """Those of triangles (f, 3, 3) that are not wholly beyond one plane."""
    for n, o in spaces:
        triangles = triangles[(triangles @ n <= o).any(axis=1)]
    return triangles


def cut(polygon: Sequence[Array], spaces: Sequence[tuple[Array, float]]) -> list[Array]:
    for n, o in spaces:
        rest: list[Array] = []
        for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
            p, q = a @ n - o, b @ n - o
            if p <= 0:
                rest.append(a)
            if (p > 0) != (q > 0):
                rest.append(a + p / (p - q) * (b - a))
        polygon = rest
    return list(polygon)


def reach(scene: Scene, view: View, solid: Solid) -> tuple[bool, bool]:
    """Whether a solid reaches into the view hull, and whether that is sure."""
    triangles, full = scene.triangles(solid), not isinstance(solid.part.shape, Mesh)
    around = full and solid.contains(transform(inverse(scene.X[solid.part.parent]), view.eye[None])[0])

    def meets(grown: float, scale: float = 1.0) -> bool:
        spaces, center = [(n, o + grown) for n, o in view.spaces], triangles.reshape(-1, 3).mean(axis=0)
        return around or any(cut(list(t), spaces) for t in near(center + scale * (triangles - center), spaces))

    found = meets(0.0)
    is_round = full and len(triangles) > 12
    return found, found == meets(-CLOSE, 0.98 if is_round else 1.0) == meets(CLOSE)


def first(scene: Scene, view: View, hit: Sequence[Solid]) -> tuple[str, bool]:
    """The solid first on the ray to the centre, else the one nearest in the hull; and whether that is sure."""
    ray = (scene.X_WB[:3, 3] - view.eye)[None]
    along = [hits(view.eye, ray, scene.triangles(one))[0] for one in hit]
    if min(along) > 1:
        pieces = [[cut(list(t), view.spaces) for t in near(scene.triangles(one), view.spaces)] for one in hit]
        # The nearest mean of a polygon's corners with weights of sum 1 (C. L. Lawson and R. J. Hanson 1974).
        weigh = [
            [np.vstack([np.array(p).T - view.eye[:, None], np.full(len(p), 1e4)]) for p in own if p] for own in pieces
        ]
        along = [min((nnls(rows, [0, 0, 0, 1e4])[1] for rows in own), default=inf) for own in weigh]
    order = np.argsort(along, kind="stable")
    rivals = [along[k] for k in order[1:] if hit[k].name != hit[order[0]].name]
    return hit[order[0]].name, min(rivals, default=inf) > along[order[0]] + 1e-7 and abs(along[order[0]] - 1) > 1e-9


def hits(start: Array, rays: Array, triangles: Array) -> Array:
    """The least positive factor of each ray at which it meets a triangle (Moeller and Trumbore 1997), infinite if none.

    start: of all rays (r, 3), shape (3,), or of each.
    """
    found = np.full(len(rays), inf)
    for a, b, c in triangles:
        across, over = np.cross(rays, c - a), np.cross(start - a, b - a)
        volume = across @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, t = (across * (start - a)).sum(1) / volume, (rays * over).sum(1) / volume, over @ (c - a) / volume
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        found = np.where(met, np.minimum(found, t), found)
    return found


class View:
    """The rays from an eye to a box: 64 rows, turned and shifted as docs/how/visibility.md says; and the view hull."""

    def __init__(self, X_WC: Array, scene: Scene, half: Array | None = None, middle: Array | None = None) -> None:
        """half, middle: of what is looked at in the frame of the box, by default the box itself."""
        place = scene.X_WB, scene.half if half is None else half, scene.middle if middle is None else middle
        self.eye, corners = X_WC[:3, 3], transform(scene.X_WB, place[2] + BOX_SIGNS * place[1])
        self.spaces = half_spaces(np.vstack([corners, self.eye]))
        corners = transform(inverse(X_WC), corners)
        u, v = (corners[:, :2] / corners[:, 2:]).T
        a, b = u - u.mean(), v - v.mean()
        along, across, mixed = a @ a, b @ b, a @ b
        spread = hypot(along - across, 2 * mixed)
        is_long = along + across + spread > 4 * (along + across - spread)
        angle = 0.5 * atan2(2 * mixed, along - across) if is_long else 0.5
        right, down = np.array([sin(angle), -cos(angle)]), np.array([cos(angle), sin(angle)])
        p, q = u * right[0] + v * right[1], u * down[0] + v * down[1]
        shift = (np.arange(ROWS) * (sqrt(5) - 1) / 2) % 1.0
        c = p.min() + (np.arange(COLUMNS) + shift[:, None]) / COLUMNS * np.ptp(p)
        r = q.min() + (np.arange(ROWS)[:, None] + 0.5) / ROWS * np.ptp(q)
        plane = c[..., None] * right + r[..., None] * down
        rays = np.concatenate([plane, np.ones((ROWS, COLUMNS, 1))], axis=2).reshape(-1, 3) @ X_WC[:3, :3].T
        enter, leave = through_box(self.eye, rays, *place)
        self.rays, self.leave = rays[enter < leave], leave[enter < leave]
        self.count = max(1, len(self.rays))

    def depths(self, triangles: Array) -> Array:
        """At which factor each ray first meets a triangle before it leaves the box, infinite where it does not."""
        found = hits(self.eye, self.rays, near(triangles, self.spaces))
        return np.where(found < self.leave, found, inf)


def through_box(eye: Array, rays: Array, X_WB: Array, half: Array, middle: Array) -> tuple[Array, Array]:
    """The factors of rays at which they enter and leave a box."""
    start = transform(inverse(X_WB), eye[None])[0] - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([(s * half - start) / (rays @ X_WB[:3, :3]) for s in (-1, 1)])
    return np.nanmax(np.fmin(*sides), axis=1), np.nanmin(np.fmax(*sides), axis=1)


def depths(scene: Scene, view: View) -> Array:
    """At which factor each ray first meets each part, (parts, r)."""
    return np.array([view.depths(scene.triangles(*(s for s in scene.opaque if s.name == n))) for n in scene.names])


def largest(scene: Scene, view: View) -> tuple[str | None, bool]:
    """The part that alone hides most; and whether that is sure."""
    hidden = [int(np.isfinite(own).sum()) for own in depths(scene, view)]
    if not any(hidden):
        return None, not hidden
    order = np.argsort(hidden, kind="stable")[::-1]
    best = hidden.index(max(hidden))
    return scene.names[best], len(order) == 1 or hidden[best] - hidden[order[1]] > 4


def parts(scene: Scene) -> dict[str, tuple[float, float]]:
    """Of each part, the share of the box's rays on which it is the first, and on which it is the only one."""
    view = View(scene.X_WC, scene)
    along = depths(scene, view)
    blocked = np.isfinite(along)
    nearest, alone = np.where(blocked.any(axis=0), along.argmin(axis=0), -1), blocked & (blocked.sum(axis=0) == 1)
    return {n: ((nearest == k).sum() / view.count, alone[k].sum() / view.count) for k, n in enumerate(scene.names)}


def background(scene: Scene) -> tuple[float, str | None]:
    """The share of the box before something that looks alike, and the solid with most of it."""
    scenery = [s for s in scene.solids if s.color is not None and scene.box.seeks not in (s.part.parent, s.part.name)]
    alike = np.array([look_alike(scene.box.color, one.color) for one in scenery])
    if not alike.any():
        return 0.0, None
    X_WC, eye = scene.X_WC, scene.X_WC[:3, 3]
    corners = transform(inverse(X_WC) @ scene.X_WB, scene.middle + BOX_SIGNS * scene.half)
    image = corners[:, :2] / corners[:, 2:]
    steps, low, size = (np.arange(BEHIND_RAYS) + 0.5) / BEHIND_RAYS, image.min(axis=0), np.ptp(image, axis=0)
    places = low + np.array(list(product(steps, steps))) * size
    rays = np.append(places, np.ones((len(places), 1)), axis=1) @ X_WC[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    enter, leave = through_box(eye, rays, scene.X_WB, scene.half, scene.middle)
    inside = (enter < leave) & (leave > 0)
    rays, start = rays[inside], eye + (leave[inside, None] - 1e-3) * rays[inside]
    along = np.array([hits(start, rays, scene.triangles(one)) for one in scenery])
    nearest = np.where(np.isfinite(along).any(axis=0), along.argmin(axis=0), -1)
    counts = np.bincount(nearest[nearest >= 0], minlength=len(scenery)) * alike
    return counts.sum() / max(len(rays), 1), scenery[int(counts.argmax())].name if counts.any() else None


def lighting(scene: Scene) -> tuple[Cause, str | None, float, bool]:
    """What is wrong with the light, what gives or takes it, which share of the box is lost by it; and whether sure."""
    box, eye, gain = scene.box, scene.X_WC[:3, 3], scene.camera.gain or 1.0
    told = MARKER if box.limits.kind == "aruco" else brightness_of(box.color) if box.color else ANY_BRIGHTNESS
    least, most = told[0] / gain, told[1] / gain
    total, dark, bright, sure, worst, shaded = 0.0, 0.0, 0.0, True, 0.0, None
    ambient = sum(light.intensity for light in scene.lights.values() if light.is_ambient)
    shining = {name: light for name, light in scene.lights.items() if not light.is_ambient}
    sums = dict.fromkeys(scene.lights, 0.0)
    for axis, sign in product(range(3), (-1.0, 1.0)):
        normal = sign * np.eye(3)[axis]
        center = transform(scene.X_WB, (scene.middle + normal * scene.half)[None])[0]
        out, way = scene.X_WB[:3, :3] @ normal, eye - center
        weight = float(np.delete(scene.half, axis).prod() * max(way @ out, 0.0) / np.linalg.norm(way) ** 3)
        if weight <= 0:
            continue
        strength = {name: one.intensity for name, one in scene.lights.items()}
        plates: dict[str, View] = {}
        for name, light in shining.items():
            forward, distance, arrives = np.array(light.heading), np.inf, light.intensity
            if light.position is not None:  # a lamp, weaker with the square of the distance
                forward = np.subtract(center, light.position)
                distance = max(float(np.linalg.norm(forward)), 1e-6)
                forward /= distance
                arrives = light.intensity / distance**2 if forward @ light.heading >= np.cos(light.half_beam) else 0.0
            strength[name] = float(arrives * max(-forward @ out, 0.0))
            if distance > 2 * np.linalg.norm(scene.half):  # else nothing is taken to be between them
                across = np.cross(forward, [0, 0, 1] if abs(forward[2]) < 0.9 else [1, 0, 0])
                across, at = across / np.linalg.norm(across), center - min(distance, 1000.0) * forward
                X_WL = np.vstack([np.stack([across, np.cross(forward, across), forward, at], axis=1), [0, 0, 0, 1]])
                thin = np.where(normal != 0, 1e-4, scene.half)
                plates[name] = View(X_WL, scene, thin, scene.middle + normal * (scene.half + 1e-4))
        full = sum(strength.values())
        matters = full >= least and (ambient < least or full > most)
        cast = (name for name in plates if matters and strength[name] > 1e-3)
        reached = dict.fromkeys(scene.lights, 1.0) | {name: scene.visible(plates[name]) for name in cast}
        total += weight
        for on in product((False, True), repeat=len(shining)):
            lit = dict(zip(shining, on, strict=True))
            chance = float(np.prod([reached[name] if lit[name] else 1 - reached[name] for name in shining]))
            level = ambient + sum(strength[name] for name in shining if lit[name])
            sure &= chance == 0 or (abs(level - least) > 1e-9 and abs(level - most) > 1e-9)
            dark, bright = dark + weight * chance * (level < least), bright + weight * chance * (level > most)
        for name in scene.lights:
            sums[name] += strength[name] * reached[name] * weight
            missing = strength[name] * (1 - reached[name]) * weight
            if missing > worst:
                sure &= worst == 0 or missing > 1.2 * worst
                worst, shaded = missing, plates[name]
    bad = (dark + bright) / total
    sure &= abs(bad - 0.02) > 0.005 and (dark == 0 or bright == 0 or abs(dark - bright) > 0.01 * total)
    lost = 0.0 if bad <= 0.02 else 1.0 if box.color is None else bad
    if bright > dark:
        return Cause.TOO_BRIGHT, max(sums, key=lambda name: sums[name]), lost, sure
    by, clear = largest(scene, shaded) if shaded is not None else (None, True)
    return Cause.TOO_DARK, by, lost, sure and clear
