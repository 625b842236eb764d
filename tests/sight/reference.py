"""What a camera sees of a box, said once more by the definitions (docs/reference/numbers.md), slowly and plainly.

Limit by limit, solid by solid, triangle by triangle, ray by ray; nothing is kept or shared, and only triangles that lie
wholly beyond a side of the view hull are passed over. Only numbers of the definitions (rays, skin, thresholds) are the
kernel's too. `Verdict.sure` is False where a decision is so close that rounding, or the flat faces that stand for round
shapes here, may turn it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from math import acos, atan, atan2, cos, hypot, inf, sin, sqrt

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import ANY_BRIGHTNESS, MARKER, Light, brightness_of, look_alike
from sqrp_cli.camera.projection import monotonic_radius
from sqrp_cli.geometry import Array, inverse, transform
from sqrp_cli.shapes import Mesh
from sqrp_cli.sight.limits import SIDES, Cause
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox

ROWS, COLUMNS, BEHIND_RAYS, SKIN = 64, 32, 16, 1e-3
CLOSE = 1e-6
SIGNS = list(product((-1.0, 1.0), repeat=3))


@dataclass(frozen=True)
class Verdict:
    cause: Cause
    by: str | None = None
    figure: float = 0.0
    visible: float = float("nan")
    sure: bool = True


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera, a box, solids and lights in one state; X: the poses of frames in the world, (4, 4) each."""

    camera: Camera
    box: SoughtBox
    solids: Sequence[Solid]
    X: Mapping[str, Array]
    lights: Mapping[str, Light] = field(default_factory=dict)

    @property
    def X_WC(self) -> Array:
        return self.X[self.camera.frame] @ self.camera.X_FC

    @property
    def X_WB(self) -> Array:
        return self.X[self.box.frame] @ self.box.X_FB

    @property
    def shrunk(self) -> tuple[Array, Array]:
        """Half the sides of the box without its skin, and its middle in its own frame."""
        size, middle = np.array(self.box.size), np.zeros(3)
        thin = size <= 2 * SKIN + 1e-9
        if thin.any() and self.box.normal is not None:
            middle = SKIN * np.array(self.box.normal)
        return np.where(thin, size, size - 2 * SKIN) / 2, middle

    @property
    def opaque(self) -> list[Solid]:
        return [one for one in self.solids if not {one.part.parent, one.part.name} & set(self.box.encloses)]

    def triangles(self, solid: Solid) -> Array:
        """In the world, (f, 3, 3)."""
        return transform(self.X[solid.part.parent], solid.vertices)[solid.triangles]


def verdict(scene: Scene) -> Verdict:
    found = limit(scene)
    if found.cause is not Cause.NONE:
        return found
    box, sure, visible, by = scene.box, found.sure, 1.0, None
    shares = View(scene.X_WC, scene.X_WB, *scene.shrunk)
    if box.limits.min_visible < 1:
        visible = shares.visible([scene.triangles(one) for one in scene.opaque])
        sure &= abs(visible - box.limits.min_visible) > 4 / shares.count
        if visible < box.limits.min_visible:
            by, clear = largest(scene, shares, scene.opaque)
            return Verdict(Cause.HIDDEN, by, 0.0, visible, sure and clear)
    else:
        met = [(one, reach(scene, one)) for one in scene.opaque]
        sure &= all(clear for _, (_, clear) in met)
        hit = [one for one, (reaches, _) in met if reaches]
        if hit:
            by, clear = first(scene, hit)
            visible = shares.visible([scene.triangles(one) for one in scene.opaque])
            return Verdict(Cause.HIDDEN, by, 0.0, visible, sure and clear)
    behind, by = background(scene)
    least = needed(box, behind, 0.0)
    sure &= abs(visible - least) > 4 / shares.count or (least <= box.limits.min_visible)
    if visible < least:
        return Verdict(Cause.SAME_COLOUR, by, 0.0, visible, sure)
    if scene.lights:
        dark, bright, shading, clear = lighting(scene)
        bad = dark + bright
        lost = 0.0 if bad <= 0.02 else 1.0 if box.color is None else bad
        sure &= clear and abs(visible - needed(box, behind, lost)) > 4 / shares.count
        if visible < needed(box, behind, lost):
            return Verdict(Cause.TOO_BRIGHT if bright > dark else Cause.TOO_DARK, shading, 0.0, visible, sure)
    return Verdict(Cause.NONE, None, 0.0, visible, sure)


# Limits


def limit(scene: Scene) -> Verdict:
    camera, box, margins = scene.camera, scene.box, []
    X_CB = inverse(scene.X_WC) @ scene.X_WB
    corners = [X_CB[:3, :3] @ (np.array(signs) * box.size / 2) + X_CB[:3, 3] for signs in SIGNS]
    low, high = min(p[2] for p in corners), max(p[2] for p in corners)

    def fails(by: float) -> bool:
        margins.append(abs(by))
        return not by <= 0

    def found(cause: Cause, by: float, side: str | None = None) -> Verdict:
        return Verdict(cause, side, by, sure=min(margins) > 1e-7)

    if fails(-low) or low == 0:
        return found(Cause.BEHIND, -low)
    if fails(camera.near - low):
        return found(Cause.TOO_NEAR, camera.near - low)
    if fails(high - camera.far):
        return found(Cause.TOO_FAR, high - camera.far)
    shown = [in_lens(camera, p) for p in corners]
    pixels = [pixel(camera, p) for p in corners]
    out = [
        max(-0.5 - u for u, _ in pixels),
        max(u - camera.width + 0.5 for u, _ in pixels),
        max(-0.5 - v for _, v in pixels),
        max(v - camera.height + 0.5 for _, v in pixels),
    ]
    outside = fails(max(out))
    if box.limits.allows_truncation and outside and all(shown):
        outside = fails(box.limits.min_visible - inside_share(camera, pixels))
    if outside or not all(shown):
        return found(Cause.OUT_OF_IMAGE, max(max(out), 0.0), SIDES[out.index(max(out))])
    distance = float(np.linalg.norm(X_CB[:3, 3]))
    if fails(box.limits.distance[0] - distance):
        return found(Cause.DETECTOR_NEAR, box.limits.distance[0] - distance)
    if fails(distance - box.limits.distance[1]):
        return found(Cause.DETECTOR_FAR, distance - box.limits.distance[1])
    angle = 0.0
    if box.normal is not None:
        angle = acos(max(-1.0, min(1.0, float(-(X_CB[:3, :3] @ box.normal) @ X_CB[:3, 3]) / distance)))
    if fails(angle - box.limits.max_incidence):
        return found(Cause.OBLIQUE, angle - box.limits.max_incidence)
    small = float(box.limits.smallest(camera, np.array([angle]))[0]) - sqrt(area(outline(pixels)))
    return found(Cause.TOO_SMALL, small) if fails(small) else found(Cause.NONE, 0.0)


def in_lens(camera: Camera, p: Array) -> bool:
    return camera.distortion_model == "none" or hypot(p[0] / p[2], p[1] / p[2]) <= monotonic_radius(camera)


def pixel(camera: Camera, p: Array) -> tuple[float, float]:
    """By the formulas of OpenCV and of ROS; what the lens does not show, as if it did not bend."""
    x, y = p[0] / p[2], p[1] / p[2]
    r = hypot(x, y)
    if in_lens(camera, p) and camera.distortion_model == "equidistant" and r > 0:
        angle = atan(r)
        bent = angle * (1 + sum(k * angle ** (2 * n + 2) for n, k in enumerate(camera.distortion)))
        x, y = x * bent / r, y * bent / r
    elif in_lens(camera, p) and camera.distortion_model in ("plumb_bob", "rational_polynomial"):
        k1, k2, p1, p2, k3, k4, k5, k6 = [*camera.distortion, 0, 0, 0][:8]
        f = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        x, y = (
            x * f + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2),
            y * f + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y,
        )
    u, v, _ = camera.matrix @ (x, y, 1.0)
    return float(u), float(v)


def outline(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The corners of the convex hull in order: after each comes the one with none to its right (Jarvis 1973)."""
    start = min(points)
    hull = [start]
    while True:
        a, b = hull[-1], next(p for p in points if p != hull[-1])
        for c in points:
            turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            if turn < 0 or (turn == 0 and hypot(c[0] - a[0], c[1] - a[1]) > hypot(b[0] - a[0], b[1] - a[1])):
                b = c
        if b == start or len(hull) > len(points):
            return hull
        hull.append(b)


def area(polygon: Sequence[tuple[float, float]]) -> float:
    pairs = zip(polygon, [*polygon[1:], *polygon[:1]], strict=True)
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs)) / 2


def inside_share(camera: Camera, pixels: Sequence[tuple[float, float]]) -> float:
    """The share of the image of a box that the edges of the camera's image leave."""
    hull = [np.array([*p, 0.0]) for p in outline(pixels)]
    w, h = camera.width - 0.5, camera.height - 0.5
    sides = [((-1, 0, 0), 0.5), ((1, 0, 0), w), ((0, -1, 0), 0.5), ((0, 1, 0), h)]
    rest = cut(hull, [(np.array(n, dtype=float), o) for n, o in sides])
    return area([(p[0], p[1]) for p in rest]) / area([(p[0], p[1]) for p in hull])


# The view hull


def half_spaces(points: Array) -> list[tuple[Array, float]]:
    """Every plane through three points with all others on one side, as (n, o): n . p <= o."""
    found = []
    for a, b, c in combinations(points, 3):
        n = np.cross(b - a, c - a)
        length = np.linalg.norm(n)
        if length < 1e-12:
            continue
        n = n / length
        heights = points @ n - a @ n
        if heights.max() < 1e-10:
            found.append((n, float(a @ n)))
        elif heights.min() > -1e-10:
            found.append((-n, float(-a @ n)))
    return found


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


def hull_of(scene: Scene) -> list[tuple[Array, float]]:
    half, middle = scene.shrunk
    return half_spaces(np.vstack([transform(scene.X_WB, middle + np.array(SIGNS) * half), scene.X_WC[:3, 3]]))


def reach(scene: Scene, solid: Solid) -> tuple[bool, bool]:
    """Whether a solid reaches into the view hull, and whether that is sure."""
    eye, triangles = scene.X_WC[:3, 3], scene.triangles(solid)
    hull, full = hull_of(scene), not isinstance(solid.part.shape, Mesh)
    around = full and solid.contains(transform(inverse(scene.X[solid.part.parent]), eye[None])[0])

    def meets(grown: float, scale: float = 1.0) -> bool:
        spaces, center = [(n, o + grown) for n, o in hull], triangles.reshape(-1, 3).mean(axis=0)
        return around or any(cut(list(t), spaces) for t in near(center + scale * (triangles - center), spaces))

    found = meets(0.0)
    is_round = full and len(triangles) > 12
    return found, found == meets(-CLOSE, 0.98 if is_round else 1.0) == meets(CLOSE)


def first(scene: Scene, hit: Sequence[Solid]) -> tuple[str, bool]:
    """The solid first on the ray to the centre, else the one nearest in the hull; and whether that is sure."""
    eye = scene.X_WC[:3, 3]
    along = [ray_hit(eye, scene.X_WB[:3, 3] - eye, scene.triangles(one)) for one in hit]
    if min(along) > 1:
        spaces = hull_of(scene)
        pieces = [[cut(list(t), spaces) for t in near(scene.triangles(one), spaces)] for one in hit]
        along = [min((polygon_distance(eye, p) for p in own if p), default=inf) for own in pieces]
    order = np.argsort(along, kind="stable")
    rivals = [along[k] for k in order[1:] if hit[k].name != hit[order[0]].name]
    return hit[order[0]].name, min(rivals, default=inf) > along[order[0]] + 1e-7 and abs(along[order[0]] - 1) > 1e-9


def ray_hit(start: Array, ray: Array, triangles: Array) -> float:
    """The least positive factor of a ray at which it meets a triangle (Moeller and Trumbore 1997)."""
    a, first, second = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across, over = np.cross(ray, second), np.cross(start - a, first)
    volume = (first * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = ((start - a) * across).sum(axis=1) / volume, over @ ray / volume
        t = (second * over).sum(axis=1) / volume
        return float(t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)].min(initial=inf))


def polygon_distance(p: Array, polygon: Sequence[Array]) -> float:
    """By Frank and Wolfe's steps to the nearest point of a convex set; the corners are few."""
    corners = np.array(polygon)
    weights = np.full(len(corners), 1 / len(corners))
    for _ in range(3000):  # away steps make the convergence linear
        point = weights @ corners
        slope = corners @ (point - p)
        to, off = int(slope.argmin()), int(np.where(weights > 0, slope, -inf).argmax())
        way, most = np.zeros(len(corners)), weights[off]
        way[to], way[off] = 1.0, -1.0
        step = way @ corners
        if to == off or step @ step < 1e-24:
            break
        share = min(most, max(0.0, -float((point - p) @ step) / float(step @ step)))
        if share <= 0:
            break
        weights = weights + share * way
    return float(np.linalg.norm(weights @ corners - p))


# Shares


class View:
    """The rays from an eye to a box: 64 rows, turned and shifted as docs/how/visibility.md says."""

    def __init__(self, X_WC: Array, X_WB: Array, half: Array, middle: Array) -> None:
        self.eye = X_WC[:3, 3]
        self.spaces = half_spaces(np.vstack([transform(X_WB, middle + np.array(SIGNS) * half), self.eye]))
        corners = transform(inverse(X_WC) @ X_WB, middle + np.array(SIGNS) * half)
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
        start = transform(inverse(X_WB), self.eye[None])[0] - middle
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.stack([(s * half - start) / (rays @ X_WB[:3, :3]) for s in (-1, 1)])
        enter, leave = np.nanmax(sides.min(axis=0), axis=1), np.nanmin(sides.max(axis=0), axis=1)
        self.rays, self.leave = rays[enter < leave], leave[enter < leave]
        self.count = max(1, len(self.rays))

    def depths(self, triangles: Array) -> Array:
        """At which factor each ray first meets a triangle before it leaves the box, infinite where it does not."""
        found = np.full(len(self.rays), inf)
        for a, b, c in near(triangles, self.spaces):
            across = np.cross(self.rays, c - a)
            volume, over = across @ (b - a), np.cross(self.eye - a, b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v, t = across @ (self.eye - a) / volume, self.rays @ over / volume, ((c - a) @ over) / volume
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < self.leave)
            found[met] = np.minimum(found[met], t[met])
        return found

    def visible(self, solids: Sequence[Array]) -> float:
        free = np.ones(len(self.rays), dtype=bool)
        for triangles in solids:
            free &= np.isinf(self.depths(triangles))
        return float(free.sum() / self.count)


def largest(scene: Scene, view: View, solids: Sequence[Solid]) -> tuple[str | None, bool]:
    """The part that alone hides most; and whether that is sure."""
    names = sorted({one.name for one in solids})
    seen = [view.visible([scene.triangles(one) for one in solids if one.name == name]) for name in names]
    if not seen or min(seen) == 1.0:
        return None, not seen
    order = np.argsort(seen, kind="stable")
    return names[order[0]], len(order) == 1 or seen[order[1]] - seen[order[0]] > 4 / view.count


def parts(scene: Scene) -> dict[str, tuple[float, float]]:
    """Of each part, the share of the box's rays on which it is the first, and on which it is the only one."""
    view, names = View(scene.X_WC, scene.X_WB, *scene.shrunk), sorted({one.name for one in scene.opaque})
    depths = np.array(
        [view.depths(np.concatenate([scene.triangles(s) for s in scene.opaque if s.name == n])) for n in names]
    ).reshape(len(names), -1)
    blocked, owner = np.isfinite(depths), depths.argmin(axis=0) if names else np.zeros(0)
    some = blocked.any(axis=0)
    return {
        name: (
            float((some & (owner == k)).sum() / view.count),
            float((blocked[k] & (blocked.sum(axis=0) == 1)).sum() / view.count),
        )
        for k, name in enumerate(names)
    }


# Background and light


def needed(box: SoughtBox, behind: float, lost: float) -> float:
    least = box.limits.min_visible
    return max(least, (min(least, 0.5) + behind) / max(1 - lost, 1e-9)) if behind > 0 or lost > 0 else least


def background(scene: Scene) -> tuple[float, str | None]:
    """The share of the box before something that looks alike, and the solid with most of it."""
    own = {scene.box.seeks}
    scenery = [s for s in scene.solids if s.color is not None and not {s.part.parent, s.part.name} & own]
    alike = [look_alike(scene.box.color, one.color) for one in scenery]
    if not any(alike):
        return 0.0, None
    (half, middle), X_WC, eye = scene.shrunk, scene.X_WC, scene.X_WC[:3, 3]
    corners = transform(inverse(X_WC) @ scene.X_WB, middle + np.array(SIGNS) * half)
    image = corners[:, :2] / corners[:, 2:]
    steps, low, size = (np.arange(BEHIND_RAYS) + 0.5) / BEHIND_RAYS, image.min(axis=0), np.ptp(image, axis=0)
    inside, hits = 0, [0] * len(scenery)
    for x, y in product(steps, steps):
        ray = X_WC[:3, :3] @ np.array([low[0] + x * size[0], low[1] + y * size[1], 1.0])
        ray = ray / np.linalg.norm(ray)
        start = transform(inverse(scene.X_WB), eye[None])[0] - middle
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = ((s * half - start) / (ray @ scene.X_WB[:3, :3]) for s in (-1, 1))
        leave = float(np.nanmin(np.fmax(a, b)))
        if not (np.nanmax(np.fmin(a, b)) < leave and leave > 0):
            continue
        inside += 1
        along = [ray_hit(eye + (leave - 1e-3) * ray, ray, scene.triangles(one)) for one in scenery]
        if min(along) < inf:
            hits[int(np.argmin(along))] += 1
    share = sum(n for n, same in zip(hits, alike, strict=True) if same) / max(inside, 1)
    most = max(range(len(scenery)), key=lambda k: hits[k] * alike[k])
    return share, scenery[most].name if share > 0 else None


def lighting(scene: Scene) -> tuple[float, float, str | None, bool]:
    """Shares of what is seen of the box that are too dark and too bright; what lights or shades it; whether sure."""
    box, (half, middle), eye = scene.box, scene.shrunk, scene.X_WC[:3, 3]
    least, most = MARKER if box.limits.kind == "aruco" else brightness_of(box.color) if box.color else ANY_BRIGHTNESS
    least, most = least / scene.camera.brightness, most / scene.camera.brightness
    total, dark, bright, sure = 0.0, 0.0, 0.0, True
    light_sums, worst, worst_plate = dict.fromkeys(scene.lights, 0.0), 0.0, None
    for axis, sign in product(range(3), (-1.0, 1.0)):
        normal = sign * np.eye(3)[axis]
        center = transform(scene.X_WB, (middle + normal * half)[None])[0]
        out, way = scene.X_WB[:3, :3] @ normal, eye - center
        weight = float(np.delete(half, axis).prod() * max(way @ out, 0.0) / np.linalg.norm(way) ** 3)
        if weight <= 0:
            continue
        strength, reached, plates = {}, {}, {}
        ambient = sum(light.intensity for light in scene.lights.values() if light.is_ambient)
        for name, light in scene.lights.items():
            if light.is_ambient:
                strength[name], reached[name] = light.intensity, 1.0
                continue
            forward, distance, arrives = light.heading, np.inf, light.intensity
            if light.position is not None:  # a lamp, weaker with the square of the distance
                distance = max(float(np.linalg.norm(np.subtract(light.position, center))), 1e-6)
                forward = np.subtract(center, light.position) / distance
                arrives = light.intensity / distance**2 if forward @ light.heading >= np.cos(light.half_beam) else 0.0
            strength[name], reached[name] = float(arrives * max(-forward @ out, 0.0)), 1.0
            across = np.cross(forward, [0, 0, 1] if abs(forward[2]) < 0.9 else [1, 0, 0])
            across = across / np.linalg.norm(across)
            X_WL = np.eye(4)
            X_WL[:3] = np.stack(
                [across, np.cross(forward, across), forward, center - min(distance, 1000.0) * forward], axis=1
            )
            thin = np.where(normal != 0, 1e-4, half)
            if distance > 2 * np.linalg.norm(half):
                plates[name] = View(X_WL, scene.X_WB, thin, middle + normal * (half + 1e-4))
        full = sum(strength.values())
        if full >= least and (ambient < least or full > most):
            for name, plate in plates.items():
                if strength[name] > 1e-3:
                    reached[name] = plate.visible([scene.triangles(one) for one in scene.opaque])
        face_dark = face_bright = 0.0
        shining = [name for name, light in scene.lights.items() if not light.is_ambient]
        for on in product((False, True), repeat=len(shining)):
            chance = float(np.prod([reached[n] if lit else 1 - reached[n] for n, lit in zip(shining, on, strict=True)]))
            level = ambient + sum(strength[n] for n, lit in zip(shining, on, strict=True) if lit)
            sure &= chance == 0 or (abs(level - least) > 1e-9 and abs(level - most) > 1e-9)
            face_dark, face_bright = face_dark + chance * (level < least), face_bright + chance * (level > most)
        total, dark, bright = total + weight, dark + weight * face_dark, bright + weight * face_bright
        for name in scene.lights:
            light_sums[name] += strength[name] * reached[name] * weight
            missing = strength[name] * (1 - reached[name]) * weight
            if missing > worst:
                sure &= worst == 0 or missing > 1.2 * worst
                worst, worst_plate = missing, plates[name]
    dark, bright = dark / total, bright / total
    sure &= abs(dark + bright - 0.02) > 0.005 and (dark == 0 or bright == 0 or abs(dark - bright) > 0.01)
    if bright > dark:
        return dark, bright, max(light_sums, key=lambda name: light_sums[name]), sure
    by, clear = largest(scene, worst_plate, scene.opaque) if worst_plate is not None else (None, True)
    return dark, bright, by, sure and clear
