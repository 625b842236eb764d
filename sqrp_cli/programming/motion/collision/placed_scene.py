"""Continuous collision checks of the arm, its tool and the held object, against themselves and the cell.

Two solids are proven apart over a stretch of a path if their distance in its middle exceeds a bound of their relative
motion within it. Other stretches are halved until a contact is found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import Contact, NamePairs, body_distance, pair
from sqrp_cli.programming.motion.collision.motion_bound import LowBodies, MotionBound, finger_steps
from sqrp_cli.programming.motion.collision.placed_bodies import BodyPairs, PlacedBodies
from sqrp_cli.trajectory import JointPath, Trajectory

FIRST_STRETCH = 0.08
"""Motion of the arm's outermost point within half of each initial stretch [m]."""

RESOLUTION = 0.5e-3
"""Two solids that may violate the clearance within a motion of less than this [m] count as touching."""

WORTH_PROVING = 8
"""Least number of distances of low bodies that justifies a proof; fewer are computed faster."""

FIRST_LOOK = 9
"""Positions along a path that `PlacedScene.is_free` checks before the proof."""


class PlacedScene:
    """A collision scene with every object in its place."""

    def __init__(
        self,
        model: RobotModel,
        bound: MotionBound,
        low: LowBodies,
        bodies: PlacedBodies,
        pairs: BodyPairs,
        fingers: Array,
    ) -> None:
        """low: those of the robot's bodies. pairs: of bodies that must not touch. fingers: their joints, shape (f,)."""
        self.bound = bound
        self._model, self._low, self._bodies, self._pairs, self._fingers = model, low, bodies, pairs, fingers

    def allowing(self, allowed: NamePairs) -> PlacedScene:
        """The same scene, in which contacts of these pairs of names do not count."""
        pairs = self._pairs.without(allowed, self._bodies)
        return PlacedScene(self._model, self.bound, self._low, self._bodies, pairs, self._fingers)

    def check(self, q: Array) -> Contact | None:
        """A contact at joint positions q, shape (n,), or None when everything keeps its clearance."""
        return self.check_all(q[None])[0]

    def check_all(self, q: Array) -> tuple[Contact | None, ...]:
        """A contact, or None, at each of m joint positions, shape (m, n); of several, that of the last pair."""
        found: dict[int, Contact] = {}
        for near in self._near(self._still(q), backwards=True, settled=found.__contains__):
            found[near.stretch] = near.contact
        return tuple(found.get(k) for k in range(len(q)))

    def touching_pairs(self, q: Array) -> tuple[NamePairs, ...]:
        """All pairs of names that touch at each of m joint positions, shape (m, n)."""
        found: list[set[tuple[str, str]]] = [set() for _ in q]
        for near in self._near(self._still(q)):
            found[near.stretch].add(pair(near.contact.first, near.contact.second))
        return tuple(map(frozenset, found))

    def is_free(self, path: JointPath, spare: float = RESOLUTION) -> bool:
        """Whether a path keeps every clearance at all times, as `check_path` proves; blocked ones are found sooner.

        spare: what the proof may require beyond the clearance [m]; a larger value is faster.
        """
        samples = np.linspace(0.0, 1.0, FIRST_LOOK)
        touching = next(self._near(self._still(path.positions(samples), samples)), None)
        return touching is None and self.check_path(path, spare) is None

    def check_fingers(self, q: Array, fingers: Array) -> Contact | None:
        """The first contact while the fingers move evenly to positions (f,) and the arm stands at q, shape (n,).

        The fingers are checked at steps of at most `RESOLUTION`.
        """
        share = np.linspace(0.0, 1.0, 1 + finger_steps(self._model, self._fingers, fingers, RESOLUTION))
        positions = self._fingers + share[:, None] * (fingers - self._fingers)
        near = self._near(self._still(np.concatenate([np.tile(q, (len(share), 1)), positions], axis=1), share))
        return next((found.contact for found in near), None)

    def check_motion(self, trajectory: Trajectory) -> Contact | None:
        """The first contact along a motion; None proves that there is none at any time. See `check_path`."""
        return self.check_path(trajectory.path)

    def check_path(self, path: JointPath, resolution: float = RESOLUTION) -> Contact | None:
        """The first contact along a path; None proves that there is none, not only at samples.

        None: all pairs keep their clearance everywhere. A contact: there a pair is closer than its clearance plus
        `resolution` [m]; the path keeps the clearance up to there.
        """
        return self.check_paths([path], resolution)[0]

    def check_paths(self, paths: Sequence[JointPath], resolution: float = RESOLUTION) -> list[Contact | None]:
        """As `check_path` of each of several paths, which is faster together."""
        if not paths:
            return []
        courses = [_Course(path, path.derivative_bounds()) for path in paths]
        first: list[Contact | None] = [None] * len(paths)
        until = np.full(len(paths), np.inf)
        stretches = Stretches.along(courses, self.bound.radii, len(self._pairs.inner))
        while len(stretches.s):
            open_ones = []
            for near in self._near(stretches, resolution, settled=stretches.beyond(until)):
                if near.bound >= resolution:
                    open_ones.append(near.combination)
                course = stretches.course[near.stretch]
                if near.touches and near.contact.s < until[course]:
                    first[course], until[course] = near.contact, near.contact.s
            if not open_ones:
                break
            stretches = stretches.halved(courses, np.array(open_ones), until)
        return first

    def _still(self, q: Array, s: Array | None = None) -> Stretches:
        return Stretches.still(q, len(self._pairs.inner), s)

    def _near(
        self,
        stretches: Stretches,
        resolution: float = RESOLUTION,
        *,
        backwards: bool = False,
        settled: Callable[[int], bool] = lambda _: False,
    ) -> Iterator[_Near]:
        """The combinations that are not proven apart over their stretch, in order or backwards.

        settled: whether no further combination of a stretch is needed.
        """
        X_WF = self._model.frame_poses(self._model.with_fingers(stretches.q, self._fingers))
        close, bound = self._close(stretches, X_WF, resolution)
        if backwards:
            close, bound = close[::-1], bound[::-1]
        bodies, (stretch, pairs) = self._bodies, stretches.split(close)
        inner, outer, clearance = self._pairs.inner[pairs], self._pairs.outer[pairs], self._pairs.clearance[pairs]
        placements = (bodies.placements(X_WF, stretch, body) for body in (outer, inner))
        columns = (values.tolist() for values in (close, stretch, outer, inner, bound, clearance))
        for k, at, i, j, moved, kept, X_1, X_2 in zip(*columns, *placements, strict=True):
            if settled(at):
                continue
            first, second = bodies.bodies[i], bodies.bodies[j]
            distance = body_distance(first, X_1, second, X_2, kept, kept + moved)
            if distance is not None:
                contact = Contact(first.name, second.name, float(stretches.s[at]), kept)
                yield _Near(
                    combination=k,
                    stretch=at,
                    bound=moved,
                    touches=distance <= kept or moved < resolution,
                    contact=contact,
                )

    def _close(self, stretches: Stretches, X_WF: Array, resolution: float) -> tuple[Indices, Array]:
        """The combinations that culling does not prove apart, (k,), and bounds of their motion [m], (k,).

        X_WF: frames in the middle of the stretches, (m, N + 1, 4, 4).
        """
        bodies, pairs = self._bodies, self._pairs
        centers, moving = bodies.world_centers(X_WF), bodies.moving
        spheres = centers[:, moving], bodies.radius[moving], bodies.depth[moving]
        motion = self.bound.between(X_WF, stretches.variation, *spheres, bodies.rods)
        close, bound = self._spheres_meet(stretches, centers, motion)
        stretch, near = stretches.split(close)
        gap = bodies.gap(X_WF, stretch, pairs.boxed[near], pairs.covered[near])
        kept = np.flatnonzero(gap < bound + pairs.clearance[near])
        kept = kept[~self._stay_off(stretches, X_WF, close[kept], resolution)]
        return close[kept], bound[kept]

    def _spheres_meet(self, stretches: Stretches, centers: Array, motion: Array) -> tuple[Indices, Array]:
        """The open combinations whose spheres could meet, (k,), and bounds of their motion [m], (k,).

        centers: of the spheres, (m, S, 3). motion: as of `MotionBound.between`, for those that move.
        """
        inner, outer, mover, reach = self._pairs.inner, self._pairs.outer, self._pairs.mover, self._pairs.reach
        depth, inner_mover = self._bodies.depth[inner], self._pairs.inner_mover
        of_rods = np.pad(motion[..., -1], ((0, 0), (0, 1))) if self._bodies.rods else None  # the last one rests
        if stretches.open is None:
            between = centers.take(inner, axis=1) - centers.take(outer, axis=1)
            bound = motion[:, mover, depth]
            bound = (bound if of_rods is None else bound + of_rods[:, inner_mover]).ravel()
            combinations, reach = np.arange(len(bound)), np.tile(reach, len(centers))
        else:
            combinations, (at, pair) = stretches.open, stretches.split(stretches.open)
            between = centers[at, inner[pair]] - centers[at, outer[pair]]
            bound, reach = motion[at, mover[pair], depth[pair]], reach[pair]
            bound = bound if of_rods is None else bound + of_rods[at, inner_mover[pair]]
        reach = reach + bound
        between = between.reshape(-1, 3)
        close = np.flatnonzero(np.einsum("ki,ki->k", between, between) < reach * reach)
        return combinations[close], bound[close]

    def _stay_off(self, stretches: Stretches, X_WF: Array, chosen: Indices, resolution: float) -> Mask:
        """Whether a low body provably stays clear of a resting one over its whole stretch, for chosen combinations.

        It stays so far away that no part of the stretch can count as a contact.
        """
        stretch, pairs = stretches.split(chosen)
        low = np.flatnonzero(self._pairs.low[pairs] >= 0)
        stays = np.zeros(len(chosen), dtype=bool)
        if len(low) >= WORTH_PROVING:
            pairs, at = pairs[low], stretch[low]
            box = self._pairs.inner[pairs]
            stays[low] = self._low.stay_off(
                X_WF=X_WF[at],
                variation=stretches.variation[at],
                row=self._pairs.low[pairs],
                X_WB=self._bodies.X_FB[box],
                half=self._bodies.half[box],
                margin=self._pairs.clearance[pairs] + resolution,
            )
        return stays


@dataclass(frozen=True)
class _Near:
    """A combination of stretch and pair that is not proven apart."""

    combination: int
    """Its number; see `Stretches`."""
    stretch: int
    bound: float
    """How far the pair can move against each other from the middle of the stretch [m]."""
    touches: bool
    """Whether it counts as a contact."""
    contact: Contact
    """The contact that it would be."""


class Halves(NamedTuple):
    """Stretches of a path, m of them, shape (m,) each."""

    middles: Array
    lengths: Array
    """Half of each stretch."""


class StretchesOfPairs(NamedTuple):
    """Combinations of a stretch and a pair of solids, by index, shape (n,) each."""

    stretch: Indices
    pair: Indices


@dataclass(frozen=True, eq=False)
class _Course:
    """A path with bounds of the slopes of its joints over each of its pieces, shape (p, n)."""

    path: JointPath
    slopes: Array

    def stretches(self, radii: Array) -> Halves:
        """Stretches with at most twice `FIRST_STRETCH` of motion, m of them.

        radii: sizes of the joints' motions, (n,).
        """
        middles, halves, breaks = [], [], self.path.breaks
        motions = (self.slopes @ radii) * (breaks[1:] - breaks[:-1])
        for motion, start, end in zip(motions.tolist(), breaks[:-1], breaks[1:], strict=True):
            count = max(1, int(np.ceil(motion / (2 * FIRST_STRETCH))))
            half = (end - start) / (2 * count)
            middles.append(start + half * (2 * np.arange(count) + 1))
            halves.append(np.full(count, half))
        return Halves(np.concatenate(middles), np.concatenate(halves))

    def variation(self, s: Array, half: Array) -> Array:
        """Largest change of each joint from its position at s, within `half` of s, shape (m, n)."""
        slopes, breaks = self.slopes, self.path.breaks
        if len(slopes) > 1:
            slopes = slopes[np.clip(np.searchsorted(breaks, s) - 1, 0, len(slopes) - 1)]
        return slopes * half[:, None]


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of some paths as their middles, with the pairs of bodies that are still open over each."""

    course: Indices
    """Which path each stretch belongs to, in ascending order, shape (m,)."""
    s: Array
    half: Array
    """Middle and half length of each stretch, shape (m,); in ascending order along each path."""
    q: Array
    """Joint positions in the middle, shape (m, n)."""
    variation: Array
    """Largest change of each joint from there within the stretch, shape (m, n)."""
    pairs: int
    """How many pairs there are. The combination of stretch k with pair p has the number k * pairs + p."""
    open: Indices | None
    """The open combinations in ascending order; None if all are."""

    @staticmethod
    def still(q: Array, pairs: int, s: Array | None = None) -> Stretches:
        """Joint positions (m, n) without motion, with all pairs open; s: where on a path they are, (m,)."""
        still = np.zeros(len(q))
        return Stretches(
            course=np.zeros(len(q), dtype=np.intp),
            s=still if s is None else s,
            half=still,
            q=q,
            variation=np.zeros_like(q),
            pairs=pairs,
            open=None,
        )

    @staticmethod
    def along(courses: Sequence[_Course], radii: Array, pairs: int) -> Stretches:
        """The whole of some paths, with all pairs open; see `_Course.stretches`."""
        middles, halves = zip(*(course.stretches(radii) for course in courses), strict=True)
        course = np.repeat(np.arange(len(courses)), [len(s) for s in middles])
        return _stretches(courses, course, np.concatenate(middles), np.concatenate(halves), pairs, None)

    def split(self, combinations: Indices) -> StretchesOfPairs:
        """Stretch and pair of each combination."""
        return StretchesOfPairs(*np.divmod(combinations, max(self.pairs, 1)))

    def beyond(self, until: Array) -> Callable[[int], bool]:
        """Whether a stretch comes after `until` of its path; later changes of the array count."""
        s, course = self.s.tolist(), self.course.tolist()
        return lambda at: bool(s[at] > until[course[at]])

    def halved(self, courses: Sequence[_Course], open_ones: Indices, until: Array) -> Stretches:
        """Both halves of every stretch with one of the open combinations that begins before `until` of its path."""
        stretch, pair = self.split(open_ones)
        early = (self.s - self.half)[stretch] < until[self.course[stretch]]
        kept, stretch = np.unique(stretch[early], return_inverse=True)
        quarter = self.half[kept] / 2
        s = np.stack([self.s[kept] - quarter, self.s[kept] + quarter], axis=1).ravel()
        first = 2 * stretch * self.pairs + pair[early]
        both = np.sort(np.concatenate([first, first + self.pairs]))
        return _stretches(courses, self.course[kept].repeat(2), s, quarter.repeat(2), self.pairs, both)


def _stretches(
    courses: Sequence[_Course], course: Indices, s: Array, half: Array, pairs: int, open_ones: Indices | None
) -> Stretches:
    """Stretches of some paths by their middles and half lengths."""
    ends = np.searchsorted(course, np.arange(len(courses) + 1)).tolist()
    rows = [(one, slice(first, last)) for one, (first, last) in zip(courses, pairwise(ends), strict=True)]
    return Stretches(
        course=course,
        s=s,
        half=half,
        q=np.concatenate([one.path.positions(s[row]) for one, row in rows]),
        variation=np.concatenate([one.variation(s[row], half[row]) for one, row in rows]),
        pairs=pairs,
        open=open_ones,
    )
