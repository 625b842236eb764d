"""Whether the arm, its tool and what it holds stay clear of themselves and of the cell, also between samples.

Two solids are proven apart over a stretch of a path when their distance in the middle of the stretch exceeds how far
they can move against each other within it. Stretches over which they are not are halved, until a contact is found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, inverse, pose, transform
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision_body import Body, Placement, body_distance, distance_within, placement_at
from sqrp_cli.programming.motion.motion_bound import MotionBound
from sqrp_cli.programming.solids import load_solid
from sqrp_cli.trajectory import Path, Trajectory

CLEARANCE = 1e-3
"""Distance that the arm keeps from everything [m]; from fixed objects the workspace's padding comes on top."""

RESOLUTION = 0.5e-3
"""Two solids that may come closer than the clearance while they move by less than this [m] count as touching."""

FIRST_STRETCH = 0.08
"""Motion of the arm's outermost point within half of each stretch that a check begins with [m]."""

FIRST_LOOK = 9
"""Places along a path that `PlacedScene.is_free` looks at before it proves anything."""

Pairs = frozenset[tuple[str, str]]
"""Pairs of names of links or objects, each in alphabetical order."""

Indices = NDArray[np.intp]


def pair(first: str, second: str) -> tuple[str, str]:
    """Two names in alphabetical order."""
    return (first, second) if first < second else (second, first)


@dataclass(frozen=True)
class Contact:
    """Two things that come closer than the clearance (or could, by less than `RESOLUTION` of motion).

    first, second: names of links or objects, the outer one of the arm first. s: where on the path, in [0, 1].
    clearance: distance that they have to keep [m].
    """

    first: str
    second: str
    s: float = 0.0
    clearance: float = CLEARANCE

    def __str__(self) -> str:
        if self.clearance > CLEARANCE:
            return f"{self.first} comes closer to {self.second} than {self.clearance:.3g} m"
        return f"{self.first} hits {self.second}"


class CollisionScene:
    """The solids of robot, tool and objects; `placed` puts the objects where they are at one moment."""

    def __init__(
        self,
        model: RobotModel,
        objects: Iterable[SceneObject],
        disabled_pairs: Iterable[tuple[str, str]] = (),
        padding: float = 0.0,
    ) -> None:
        """Load every solid.

        disabled_pairs: pairs of links that are not checked, beside those that are fixed to each other or neighbours
        across one joint. padding: extra clearance from fixed objects [m]. Raises InputError for an unusable mesh.
        """
        self.model = model
        self.bound = MotionBound(model)
        objects = tuple(objects)
        self.bodies = tuple(Body.of(load_solid(part)) for part in model.parts)
        self.object_bodies = {thing.name: tuple(Body.of(load_solid(part)) for part in thing.parts) for thing in objects}
        self.clearance = {thing.name: CLEARANCE + (padding if thing.fixed else 0.0) for thing in objects}
        skipped = {pair(*names) for names in (*disabled_pairs, *model.adjacent_pairs)}
        depth = self.bound.depth
        self.self_pairs = tuple(
            (i, j) if depth[a.name] < depth[b.name] else (j, i)
            for i, a in enumerate(self.bodies)
            for j, b in enumerate(self.bodies[:i])
            if depth[a.name] != depth[b.name] and pair(a.name, b.name) not in skipped
        )

    def placed(self, world: World, allowed: Pairs = frozenset()) -> PlacedScene:
        """The scene with every object where `world` has it; contacts of `allowed` pairs do not count.

        The held object moves with the tool and may touch it. Objects of unknown pose are left out.
        """
        return PlacedScene(self, world, allowed)

    def supports(self, name: str, X_WO: Array, world: World) -> frozenset[str]:
        """Names of the objects that carry object `name` at `X_WO`: those it touches, but not once raised a little."""
        raised = pose(position=(0.0, 0.0, 3 * CLEARANCE)) @ X_WO
        others = [(other, X_WB) for other, X_WB in world.X_WO.items() if other not in (name, world.held)]
        return frozenset(
            other
            for other, X_WB in others
            if self._touch(name, X_WO, other, X_WB) and not self._touch(name, raised, other, X_WB)
        )

    def _touch(self, first: str, X_WA: Array, second: str, X_WB: Array) -> bool:
        return any(
            distance_within(a.geometry, placement_at(X_WA @ a.X_PG), b.geometry, placement_at(X_WB @ b.X_PG), CLEARANCE)
            is not None
            for a in self.object_bodies[first]
            for b in self.object_bodies[second]
            if _may_touch(a, X_WA, b, X_WB)
        )


def _may_touch(a: Body, X_WA: Array, b: Body, X_WB: Array) -> bool:
    """Whether the spheres around two bodies come within the clearance."""
    apart = np.linalg.norm(transform(X_WA, a.center[None]) - transform(X_WB, b.center[None]))
    return bool(apart < a.radius + b.radius + CLEARANCE)


def finger_positions(model: RobotModel, world: World) -> Array:
    """Positions of the joints that drive the fingers in a world, shape (f,)."""
    fingers = model.fingers
    return np.array([world.joints[name] for name in fingers.joints])


def finger_steps(model: RobotModel, start: Array, end: Array, step: float) -> int:
    """In how many equal steps the fingers go from start to end, (f,) each, without any point moving by over `step` [m].

    At least 1. Measured at the boxes around the solids, along 33 positions.
    """
    share = np.linspace(0.0, 1.0, 33)[:, None]
    poses = model.link_poses(
        np.concatenate([np.broadcast_to(model.home, (33, len(model.home))), start + share * (end - start)], axis=1)
    )
    corners = [
        transform(poses[part.parent], load_solid(part).corners)
        for part in model.parts
        if part.parent in model.fingers.links
    ]
    longest = max((float(np.linalg.norm(np.diff(c, axis=0), axis=-1).max()) for c in corners), default=0.0)
    return max(1, int(np.ceil(32 * longest / step)))


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Stretches of a path as their middles, with the pairs of bodies that are still open over each.

    s, half: middle and half length of each stretch, shape (m,). q: joint positions in the middle, shape (m, n).
    variation: how far each joint can be from there within the stretch, shape (m, n).
    stretch, pairs: index of stretch and of pair of every open combination, shape (k,), ordered by stretch.
    """

    s: Array
    half: Array
    q: Array
    variation: Array
    stretch: Indices
    pairs: Indices


@dataclass(frozen=True)
class _Near:
    """A combination of stretch and pair that is not proven apart.

    combination: its index. bound: how far the pair can move against each other from the middle of the stretch [m].
    touches: whether that counts as the contact. contact: what it would be.
    """

    combination: int
    stretch: int
    bound: float
    touches: bool
    contact: Contact


class PlacedScene:
    """A collision scene with every object in its place."""

    def __init__(self, scene: CollisionScene, world: World, allowed: Pairs) -> None:
        """As `CollisionScene.placed` says."""
        model, depth_of = scene.model, scene.bound.depth
        self.bound = scene.bound
        self._model, self._fingers = model, finger_positions(model, world)
        bodies = list(scene.bodies)
        links: list[str | None] = [body.name for body in bodies]
        X_CP = [np.eye(4)] * len(bodies)
        moving = [i for i, body in enumerate(bodies) if depth_of[body.name] > 0]
        pairs = [(i, j, CLEARANCE) for i, j in scene.self_pairs]
        for name, X_WO in world.X_WO.items():
            if name == world.held:
                continue
            for body in scene.object_bodies[name]:
                pairs += [(len(bodies), i, scene.clearance[name]) for i in moving]
                bodies.append(body)
                links.append(None)
                X_CP.append(X_WO)
        if world.held is not None and world.X_TO is not None:
            partners = [
                (i, scene.clearance.get(body.name, CLEARANCE))
                for i, body in enumerate(bodies)
                if body.name not in model.hand_links
            ]
            for body in scene.object_bodies[world.held]:
                pairs += [(i, len(bodies), clearance) for i, clearance in partners]
                bodies.append(body)
                links.append(model.tool_frame)
                X_CP.append(world.X_TO)
        pairs = [entry for entry in pairs if pair(bodies[entry[0]].name, bodies[entry[1]].name) not in allowed]
        self._bodies = bodies
        self._carried = [(i, link) for i, link in enumerate(links) if link is not None]
        self._X_CP = np.array(X_CP)
        self._depth = np.array([0 if link is None else depth_of[link] for link in links])
        self._inner = np.array([entry[0] for entry in pairs], dtype=np.intp)
        self._outer = np.array([entry[1] for entry in pairs], dtype=np.intp)
        self._clearance = np.array([entry[2] for entry in pairs])
        self._center = transform(self._X_CP, np.array([body.center for body in bodies])[:, None])
        self._radius = np.array([body.radius for body in bodies])
        self._centers = np.array([body.centers for body in bodies])
        self._radii = np.array([body.radii for body in bodies])
        self._X_CB = self._X_CP @ np.array([body.X_PB for body in bodies])
        self._half = np.array([body.half for body in bodies])
        self._X_CG = self._X_CP @ np.array([body.X_PG for body in bodies])
        large_first = self._radii.max(axis=1)[self._inner] >= self._radii.max(axis=1)[self._outer]
        self._boxed = np.where(large_first, self._inner, self._outer)
        self._covered = np.where(large_first, self._outer, self._inner)

    def check(self, q: Array) -> Contact | None:
        """A contact at joint positions q, shape (n,), or None when everything keeps its clearance."""
        return self.check_all(q[None])[0]

    def check_all(self, q: Array) -> tuple[Contact | None, ...]:
        """A contact, or None, at each of m joint positions, shape (m, n)."""
        still = np.zeros(len(q))
        found = {near.stretch: near.contact for near in self._near(self._all_open(still, still, q, np.zeros_like(q)))}
        return tuple(found.get(k) for k in range(len(q)))

    def touching_pairs(self, q: Array) -> tuple[Pairs, ...]:
        """All pairs of names that touch at each of m joint positions, shape (m, n)."""
        still = np.zeros(len(q))
        found: list[set[tuple[str, str]]] = [set() for _ in q]
        for near in self._near(self._all_open(still, still, q, np.zeros_like(q))):
            found[near.stretch].add(pair(near.contact.first, near.contact.second))
        return tuple(map(frozenset, found))

    def is_free(self, path: Path, spare: float = RESOLUTION) -> bool:
        """Whether a path keeps every clearance at all times, as `check_path` proves; blocked ones are told sooner.

        spare: what the proof may ask for beyond the clearance [m]; more is told sooner.
        """
        samples = np.linspace(0.0, 1.0, FIRST_LOOK)
        still = np.zeros(FIRST_LOOK)
        q = path.positions(samples)
        touching = next(self._near(self._all_open(samples, still, q, np.zeros_like(q))), None)
        return touching is None and self.check_path(path, spare) is None

    def check_fingers(self, q: Array, fingers: Array) -> Contact | None:
        """The first contact while the fingers move evenly to positions (f,) and the arm stands at q, shape (n,).

        The fingers are tried so often that they move by at most `RESOLUTION` in between.
        """
        share = np.linspace(0.0, 1.0, 1 + finger_steps(self._model, self._fingers, fingers, RESOLUTION))
        positions = self._fingers + share[:, None] * (fingers - self._fingers)
        still = np.zeros(len(share))
        q_all = np.concatenate([np.broadcast_to(q, (len(share), len(q))), positions], axis=1)
        near = self._near(self._all_open(share, still, q_all, np.zeros((len(share), len(q)))))
        return next((found.contact for found in near), None)

    def check_motion(self, trajectory: Trajectory) -> Contact | None:
        """The first contact along a motion; None proves that there is none at any time. See `check_path`."""
        return self.check_path(trajectory.path)

    def check_path(self, path: Path, resolution: float = RESOLUTION) -> Contact | None:
        """The first contact along a path; None proves that there is none, not only at samples.

        None: all pairs keep their clearance everywhere. A contact: there a pair is closer than its clearance plus
        `resolution` [m]; the path keeps the clearance up to there.
        """
        slopes = path.derivative_bounds()
        first: Contact | None = None
        s, half = self._first_stretches(path, slopes)
        stretches = self._all_open(s, half, path.positions(s), _variation(path, slopes, s, half))
        while len(stretches.stretch):
            open_ones, seen = [], -1
            for near in self._near(stretches, resolution):
                if first is not None and near.stretch > seen and near.contact.s >= first.s:
                    break
                seen = near.stretch
                if near.bound >= resolution:
                    open_ones.append(near.combination)
                if near.touches and (first is None or near.contact.s < first.s):
                    first = near.contact
            stretches = _halved(path, slopes, stretches, np.array(open_ones, dtype=np.intp), first)
        return first

    def _first_stretches(self, path: Path, slopes: Array) -> tuple[Array, Array]:
        """Middles and half lengths of stretches of at most twice `FIRST_STRETCH` of motion."""
        middles, halves = [], []
        for piece, (start, end) in enumerate(zip(path.breaks[:-1], path.breaks[1:], strict=True)):
            motion = float(slopes[piece] @ self.bound.radii) * (end - start)
            count = max(1, int(np.ceil(motion / (2 * FIRST_STRETCH))))
            half = (end - start) / (2 * count)
            middles.append(start + half * (2 * np.arange(count) + 1))
            halves.append(np.full(count, half))
        return np.concatenate(middles), np.concatenate(halves)

    def _all_open(self, s: Array, half: Array, q: Array, variation: Array) -> _Stretches:
        stretch, pairs = np.divmod(np.arange(len(s) * len(self._inner)), len(self._inner) or 1)
        return _Stretches(s, half, q, variation, stretch, pairs)

    def _near(self, stretches: _Stretches, resolution: float = RESOLUTION) -> Iterator[_Near]:
        """The combinations that are not proven apart over their stretch, in order."""
        carriers = self._model.link_poses(self._model.with_fingers(stretches.q, self._fingers))
        stretch, pairs = stretches.stretch, stretches.pairs
        inner, outer = self._inner[pairs], self._outer[pairs]
        X_WC = np.empty((len(self._bodies), len(stretches.s), 4, 4))
        X_WC[:] = np.eye(4)
        for i, link in self._carried:
            X_WC[i] = carriers[link]
        centers = transform(X_WC, self._center[:, None])[:, :, 0]
        motion = self.bound.between(carriers, stretches.variation, centers, self._radius, self._depth)
        bound = motion[outer, stretch, self._depth[inner]]
        need = bound + self._clearance[pairs]
        apart = np.linalg.norm(centers[inner, stretch] - centers[outer, stretch], axis=1)
        close = np.flatnonzero(apart - self._radius[inner] - self._radius[outer] < need)
        close = close[self._gap(X_WC, stretch[close], pairs[close]) < need[close]]
        placements: dict[tuple[int, int], Placement] = {}

        def placement(body: int, stretch: int) -> Placement:
            if (body, stretch) not in placements:
                placements[body, stretch] = placement_at(X_WC[body, stretch] @ self._X_CG[body])
            return placements[body, stretch]

        columns = (values.tolist() for values in (close, stretch[close], inner[close], outer[close]))
        for k, at, i, j in zip(*columns, strict=True):
            first, second = self._bodies[j], self._bodies[i]
            distance = body_distance(
                first, placement(j, at), second, placement(i, at), float(need[k] - bound[k]), float(need[k])
            )
            if distance is not None:
                touches = distance <= need[k] - bound[k] or bound[k] < resolution
                contact = Contact(first.name, second.name, float(stretches.s[at]), float(self._clearance[pairs[k]]))
                yield _Near(k, at, float(bound[k]), bool(touches), contact)

    def _gap(self, X_WC: Array, stretch: Indices, pairs: Indices) -> Array:
        """A lower bound of the distance [m] of pairs, from a box around one and spheres around the other."""
        boxed, covered = self._boxed[pairs], self._covered[pairs]
        X_WB = X_WC[boxed, stretch] @ self._X_CB[boxed]
        X_WP = X_WC[covered, stretch] @ self._X_CP[covered]
        centers = transform(inverse(X_WB) @ X_WP, self._centers[covered])
        outside = np.maximum(np.abs(centers) - self._half[boxed][:, None], 0.0)
        gap: Array = (np.linalg.norm(outside, axis=-1) - self._radii[covered]).min(axis=-1)
        return gap


def _variation(path: Path, slopes: Array, s: Array, half: Array) -> Array:
    """How far each joint can be from where it is at s, within `half` of s, shape (m, n)."""
    piece = np.clip(np.searchsorted(path.breaks, s) - 1, 0, len(path.breaks) - 2)
    variation: Array = slopes[piece] * half[:, None]
    return variation


def _halved(path: Path, slopes: Array, old: _Stretches, open_ones: Indices, until: Contact | None) -> _Stretches:
    """Both halves of every stretch with an open combination that begins before a contact."""
    if until is not None:
        open_ones = open_ones[(old.s - old.half)[old.stretch[open_ones]] < until.s]
    kept, stretch = np.unique(old.stretch[open_ones], return_inverse=True)
    half = np.repeat(old.half[kept] / 2, 2)
    s = np.repeat(old.s[kept], 2) + half * np.tile([-1.0, 1.0], len(kept))
    both = np.concatenate([2 * stretch, 2 * stretch + 1])
    order = np.argsort(both, kind="stable")
    pairs = np.tile(old.pairs[open_ones], 2)[order]
    return _Stretches(s, half, path.positions(s), _variation(path, slopes, s, half), both[order], pairs)
