"""What a camera sees of a box, said once more by the definitions (docs/reference/numbers.md), slowly and plainly.

Limit by limit, solid by solid, ray by ray, triangle by triangle; only triangles wholly beyond a side of the view hull
are passed over. Hulls are Qhull's, lenses OpenCV's; only numbers of the definitions (rays, skin, thresholds) are the
kernel's too. `sure` is False where a decision is so close that rounding, or flat faces of round shapes, may turn it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import acos, cos, hypot, inf, sin, sqrt
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import MARKER, Light, brightness_of, look_alike
from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, look_at, transform
from sqrp_cli.shapes import Box, Mesh
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox
from tests.sight.plain_geometry import cut, half_spaces, hits, near, through_box

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
        self.sure = True
        self.X_WC, self.X_WB = self.X[self.camera.frame] @ self.camera.X_FC, self.X[self.box.frame] @ self.box.X_FB
        size = np.array(self.box.size)
        thin = size <= 2 * SKIN + 1e-9
        # Half the sides of the box without its skin, and its middle in its own frame.
        self.half = np.where(thin, size, size - 2 * SKIN) / 2
        self.middle = SKIN * np.array(self.box.normal) if thin.any() and self.box.normal is not None else np.zeros(3)
        self.opaque = [s for s in self.solids if not {s.part.parent, s.part.name} & set(self.box.encloses)]

    def exceeds(self, value: float, limit: float, close: float = 1e-7) -> bool:
        """Decide by a value; what is said is not sure if it is so close to the limit."""
        self.sure &= abs(value - limit) > close
        return not value <= limit

    def triangles(self, solid: Solid) -> Array:
        return transform(self.X[solid.part.parent], solid.vertices)[solid.triangles]  # in the world, (f, 3, 3)


def verdict(scene: Scene) -> Verdict:
    """The first of limits, view, background and light that fails."""
    found, least, visible = limit(scene), scene.box.limits.min_visible, 1.0
    if found.cause is not Cause.NONE:
        return found
    view = View(scene, scene.X_WC, scene.half, scene.middle)
    close = 4 / view.count
    if least < 1:
        visible = view.visible
        if scene.exceeds(least, visible, close):
            return Verdict(Cause.HIDDEN, largest(view), 0.0, visible, scene.sure)
    elif hit := [one for one in scene.opaque if reaches(view, one)]:
        return Verdict(Cause.HIDDEN, first(view, hit), 0.0, view.visible, scene.sure)
    behind, alike = background(scene)
    told = min(least, 0.5) + behind
    if told > least and scene.exceeds(told, visible, close):
        return Verdict(Cause.SAME_COLOUR, alike, 0.0, visible, scene.sure)
    cause, by, lost = lighting(scene) if scene.lights else (Cause.NONE, None, 0.0)
    told /= max(1 - lost, 1e-9)
    if told > least and scene.exceeds(told, visible, close):
        return Verdict(cause, by, 0.0, visible, scene.sure)
    return Verdict(Cause.NONE, None, 0.0, visible, scene.sure)


def limit(scene: Scene) -> Verdict:
    """The first limit of camera or detector that fails, and by how much."""
    camera, box, asked = scene.camera, scene.box, scene.box.limits
    X_CB = inverse(scene.X_WC) @ scene.X_WB
    corners = transform(X_CB, BOX_SIGNS * box.size / 2)
    low, high = corners[:, 2].min(), corners[:, 2].max()
    for cause, by in ((Cause.BEHIND, -low), (Cause.TOO_NEAR, camera.near - low), (Cause.TOO_FAR, high - camera.far)):
        if scene.exceeds(by, 0):
            return Verdict(cause, None, by, sure=scene.sure)
    pixels, shown = projected(camera, corners)
    (left, top), (right, bottom), w, h = pixels.min(0), pixels.max(0), camera.width - 0.5, camera.height - 0.5
    beyond = {"left": -0.5 - left, "right": right - w, "top": -0.5 - top, "bottom": bottom - h}
    side, by, image = max(beyond, key=lambda name: beyond[name]), max(beyond.values()), ConvexHull(pixels)
    outside = scene.exceeds(by, 0)
    if outside and shown and asked.is_usual and asked.kind == "color":
        edges = [((-1, 0), 0.5), ((1, 0), w), ((0, -1), 0.5), ((0, 1), h)]
        rest = cut(list(pixels[image.vertices]), [(np.array(n, dtype=float), o) for n, o in edges])
        outside = scene.exceeds(asked.min_visible, ConvexHull(rest).volume / image.volume if rest else 0.0)
    if outside or not shown:
        return Verdict(Cause.OUT_OF_IMAGE, side, max(by, 0.0), sure=scene.sure)
    distance, angle = float(np.linalg.norm(X_CB[:3, 3])), 0.0
    if box.normal is not None:
        angle = acos(max(-1.0, min(1.0, float(-(X_CB[:3, :3] @ box.normal) @ X_CB[:3, 3]) / distance)))
    for cause, by in (
        (Cause.DETECTOR_NEAR, asked.distance[0] - distance),
        (Cause.DETECTOR_FAR, distance - asked.distance[1]),
        (Cause.OBLIQUE, angle - asked.max_incidence),
        (Cause.TOO_SMALL, float(asked.smallest(camera, np.array([angle]))[0]) - sqrt(image.volume)),
    ):
        if scene.exceeds(by, 0):
            return Verdict(cause, None, by, sure=scene.sure)
    return Verdict(Cause.NONE, sure=scene.sure)


def projected(camera: Camera, points: Array) -> tuple[Array, bool]:
    """Points of the optical frame as pixels (n, 2), and whether the lens shows all; as if straight what it does not.

    It shows a point if the image moves outwards all the way from the axis to it, in 2,000 steps; by the radial terms.
    """
    is_fisheye, straight, found = camera.distortion_model == "equidistant", np.zeros(4), []

    def project(points: Array, matrix: Array, bent: Array) -> Array:
        with_lens = cv2.fisheye.projectPoints if is_fisheye and bent.any() else cv2.projectPoints
        return with_lens(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, bent)[0].reshape(-1, 2)

    bent = camera.distortion if len(camera.distortion) else straight
    if not bent.any():
        return project(points, camera.matrix, straight), True
    radial = bent if is_fisheye else np.where(np.isin(np.arange(len(bent)), [2, 3]), 0.0, bent)
    for p in points:
        along = np.outer(np.arange(1, 2001) / 2000, [hypot(p[0] / p[2], p[1] / p[2]), 0, 0]) + np.array([0, 0, 1])
        shown = (np.diff(project(along, np.eye(3), radial)[:, 0], prepend=0.0) > 0).all()
        found.append((*project(p, camera.matrix, bent if shown else straight)[0], shown))
    return np.array(found)[:, :2], all(shown for *_, shown in found)


def pieces(view: View, solid: Solid, grown: float = 0.0, scale: float = 1.0) -> list[list[Array]]:
    """The polygons that the view hull, grown on all sides, cuts out of a solid scaled about its middle."""
    triangles, spaces = view.scene.triangles(solid), [(n, o + grown) for n, o in view.spaces]
    center = triangles.mean(axis=(0, 1))
    found = (cut(list(t), spaces) for t in near(center + scale * (triangles - center), spaces))
    return [polygon for polygon in found if polygon]


def reaches(view: View, solid: Solid) -> bool:
    """Whether a solid reaches into the view hull."""
    if not isinstance(solid.part.shape, Mesh):
        eye_P = transform(inverse(view.scene.X[solid.part.parent]), view.eye[None])[0]
        if solid.contains(eye_P):
            return True
    is_round = not isinstance(solid.part.shape, Mesh | Box)
    found, less, more = (bool(pieces(view, solid, *how)) for how in ((), (-CLOSE, 0.98 if is_round else 1.0), (CLOSE,)))
    view.scene.sure &= less == found == more
    return found


def first(view: View, hit: Sequence[Solid]) -> str:
    """The solid first on the ray to the centre, else the one nearest in the hull."""
    scene, eye = view.scene, view.eye
    along = [hits(eye, (scene.X_WB[:3, 3] - eye)[None], scene.triangles(one))[0] for one in hit]
    if min(along) > 1:
        for number, one in enumerate(hit):
            # The nearest mean of a polygon's corners with weights of sum 1 (C. L. Lawson and R. J. Hanson 1974).
            weigh = [np.vstack([(np.array(p) - eye).T, np.full(len(p), 1e4)]) for p in pieces(view, one)]
            along[number] = min((nnls(rows, [0, 0, 0, 1e4])[1] for rows in weigh), default=inf)
    least, name = min(zip(along, (one.name for one in hit), strict=True))
    rival = min((own for own, one in zip(along, hit, strict=True) if one.name != name), default=inf)
    scene.sure &= rival > least + 1e-7 and abs(least - 1) > 1e-9
    return name


def grid(image: Array, is_fine: bool) -> Array:
    """Places of rays over the image (8, 2) of a box's corners, 2,048 or 256, as docs/how/visibility.md says."""
    axes, n = np.eye(2), BEHIND_RAYS
    steps = [((column + 0.5) / n, (row + 0.5) / n) for row, column in product(range(n), range(n))]
    if is_fine:
        (small, large), ways = np.linalg.eigh(np.cov(image.T))
        down = ways[:, 1] * np.sign(ways[0, 1]) if large > 4 * small else np.array([cos(0.5), sin(0.5)])
        axes, shift = np.array([[down[1], -down[0]], down]), (sqrt(5) - 1) / 2
        steps = [((c + r * shift % 1.0) / COLUMNS, (r + 0.5) / ROWS) for r in range(ROWS) for c in range(COLUMNS)]
    turned = image @ axes.T
    return (turned.min(axis=0) + np.array(steps) * np.ptp(turned, axis=0)) @ axes


class View:
    """The rays from an eye through the box, or a block with half sides and middle in its frame, and the view hull."""

    def __init__(self, scene: Scene, X_WC: Array, half: Array, middle: Array, is_fine: bool = True) -> None:
        self.scene, self.eye, corners = scene, X_WC[:3, 3], transform(scene.X_WB, middle + BOX_SIGNS * half)
        self.spaces = half_spaces(np.vstack([corners, self.eye]))
        corners = transform(inverse(X_WC), corners)
        places = grid(corners[:, :2] / corners[:, 2:], is_fine)
        rays = np.append(places, np.ones((len(places), 1)), axis=1) @ X_WC[:3, :3].T
        enter, leave = through_box(self.eye, rays, scene.X_WB, half, middle)
        self.rays, self.leave, self.count = rays[enter < leave], leave[enter < leave], max(1, sum(enter < leave))

    @cached_property
    def parts(self) -> dict[str, list[float]]:
        """At which factor each ray first meets each part before it leaves the box, infinite where it does not."""
        found: dict[str, list[float]] = {}
        for one in sorted(self.scene.opaque, key=lambda one: one.name):
            along = hits(self.eye, self.rays, near(self.scene.triangles(one), self.spaces), 0.0, self.leave)
            found[one.name] = [*map(min, along, found.get(one.name, along))]
        return found

    @property
    def visible(self) -> float:
        """The share of rays that nothing blocks."""
        blocked = sum(min(ray) < inf for ray in zip(*self.parts.values(), strict=True))
        return (len(self.rays) - blocked) / self.count


def largest(view: View) -> str | None:
    """The part that alone hides most."""
    hidden = sorted((-sum(own < inf for own in along), name) for name, along in view.parts.items())
    view.scene.sure &= not hidden or hidden[0][0] < 0
    view.scene.sure &= len(hidden) < 2 or hidden[1][0] - hidden[0][0] > 4
    return hidden[0][1] if hidden and hidden[0][0] else None


def parts(scene: Scene) -> dict[str, tuple[float, float]]:
    """Of each part, the share of the box's rays on which it is the first, and on which it is the only one."""
    view, share, alone = View(scene, scene.X_WC, scene.half, scene.middle), Counter[str](), Counter[str]()
    for ray in zip(*view.parts.values(), strict=True):
        blocked = sorted((along, name) for along, name in zip(ray, view.parts, strict=True) if along < inf)
        share.update(name for _, name in blocked[:1])
        alone.update(name for _, name in blocked if len(blocked) == 1)
    return {name: (share[name] / view.count, alone[name] / view.count) for name in view.parts}


def background(scene: Scene) -> tuple[float, str | None]:
    """The share of the box before something that looks alike, and the solid with most of it."""
    scenery = [s for s in scene.solids if s.color is not None and scene.box.seeks not in (s.part.parent, s.part.name)]
    alike, counts = {one.name for one in scenery if look_alike(scene.box.color, one.color)}, Counter[str]()
    if not alike:
        return 0.0, None
    view = View(scene, scene.X_WC, scene.half, scene.middle, is_fine=False)
    cone = [(n, o) for n, o in view.spaces if abs(n @ view.eye - o) < 1e-9]  # all its rays are in it
    begins = view.leave - 1e-3 / np.linalg.norm(view.rays, axis=1)
    along = [hits(view.eye, view.rays, near(scene.triangles(one), cone), begins) for one in scenery]
    for ray in zip(*along, strict=True):
        name = scenery[ray.index(min(ray))].name
        counts.update([name] if name in alike and min(ray) < inf else [])
    return counts.total() / view.count, max(counts, key=lambda name: counts[name], default=None)


def lighting(scene: Scene) -> tuple[Cause, str | None, float]:
    """What is wrong with the light, what gives or takes it, and which share of the box is lost by it."""
    box, eye, gain = scene.box, scene.X_WC[:3, 3], scene.camera.gain or 1.0
    least, most = (told / gain for told in (MARKER if box.limits.kind == "aruco" else brightness_of(box.color)))
    ambient = sum(light.intensity for light in scene.lights.values() if light.is_ambient)
    total, dark, bright, worst, shaded = 0.0, 0.0, 0.0, 0.0, None
    sums = dict.fromkeys(scene.lights, 0.0)
    for axis, sign in product(range(3), (-1.0, 1.0)):
        normal = sign * np.eye(3)[axis]
        center, out = transform(scene.X_WB, (scene.middle + normal * scene.half)[None])[0], scene.X_WB[:3, :3] @ normal
        # What the face fills of the image; and the thin plate that lights see of it.
        weight = float(np.delete(scene.half, axis).prod() * (eye - center) @ out / np.linalg.norm(eye - center) ** 3)
        plate = np.where(normal != 0, 1e-4, scene.half), scene.middle + normal * (scene.half + 1e-4)
        if weight <= 0:
            continue
        total += weight
        arriving = {name: arrives(scene, light, center, out) for name, light in scene.lights.items()}
        full = sum(strength for strength, _ in arriving.values())
        levels, matters = [(1.0, 0.0)], full >= least and (ambient < least or full > most)
        for name, (strength, X_WL) in arriving.items():
            view = View(scene, X_WL, *plate) if matters and strength > 1e-3 and X_WL is not None else None
            reached = 1.0 if view is None else view.visible
            levels = [(p * q, at + add) for p, at in levels for q, add in ((reached, strength), (1 - reached, 0.0))]
            sums[name] += strength * reached * weight
            missing = strength * (1 - reached) * weight
            if missing > worst:
                scene.sure &= worst == 0 or missing > 1.2 * worst
                worst, shaded = missing, view
        for chance, level in levels:
            scene.sure &= chance == 0 or min(abs(level - least), abs(level - most)) > 1e-9
            dark, bright = dark + weight * chance * (level < least), bright + weight * chance * (level > most)
    bad = (dark + bright) / total
    lost = (1.0 if box.color is None else bad) if scene.exceeds(bad, 0.02, 0.005) else 0.0
    scene.sure &= dark == 0 or bright == 0 or abs(dark - bright) > 0.01 * total
    if bright > dark:
        return Cause.TOO_BRIGHT, max(sums, key=lambda name: sums[name]), lost
    return Cause.TOO_DARK, None if shaded is None else largest(shaded), lost


def arrives(scene: Scene, light: Light, center: Array, out: Array) -> tuple[float, Array | None]:
    """How bright a light makes a face with a normal `out`; and from where what is between them counts."""
    if light.is_ambient:
        return light.intensity, None
    forward, distance, intensity = np.array(light.heading), inf, light.intensity
    if light.position is not None:  # a lamp, weaker with the square of the distance
        distance = max(float(np.linalg.norm(np.subtract(center, light.position))), 1e-6)
        forward = np.subtract(center, light.position) / distance
        intensity = light.intensity / distance**2 if forward @ light.heading >= cos(light.half_beam) else 0.0
    strength = float(intensity * max(-forward @ out, 0.0))
    if distance <= 2 * np.linalg.norm(scene.half):
        return strength, None
    at, up = center - min(distance, 1000.0) * forward, (0, 0, 1) if abs(forward[2]) < 0.9 else (1, 0, 0)
    return strength, look_at(at, center, up)
