"""What is judged and what may be chosen: ways with samples, and the cameras at each place with each lens that fits.

A place may be in the way: of the robot, of anything solid, of another camera, or of its sight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, box_corners, inverse, pose, read_only, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import SAME, AimsEntry, LensChoice, Spot
from sqrp_cli.programming.advice.aiming import looking_at, touched
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.sampling import Adaptive, first_samples
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.coverage.timeline import Rehearsal, SampledScene
from sqrp_cli.programming.ranking import compared_time
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.task import Candidate

EVERY = 3
"""Of the adaptive samples, which no target or link moves more than 1 cm between, every so many-th is judged."""

MOST_WAYS = 6
"""Most ways of a candidate to choose from."""


class Items(NamedTuple):
    """What has to be seen of a way: n pairs of a sample and a target, by index."""

    sample: Indices
    """Shape (n,)."""
    target: Indices
    """Shape (n,)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JudgedWay(SampledScene):
    """A way of a candidate with the samples in which mounts are judged."""

    task: str
    """As it was asked for."""
    candidate: Candidate
    """As a person chooses it."""

    @property
    def name(self) -> str:
        """The task and its candidate."""
        return f"{self.task}: {self.candidate.name}"

    @cached_property
    def items(self) -> Items:
        """What has to be seen in the samples."""
        return Items(*np.nonzero(self.required))

    @cached_property
    def needed(self) -> Indices:
        """How many cameras must see each item, shape (n,)."""
        return np.array([target.cameras for target in self.scene.targets], dtype=np.int64)[self.items.target]

    def with_samples(self, more: Samples) -> JudgedWay:
        """With further samples."""
        return replace(self, samples=self.samples.joined(more, self.samples.merge_order(more)))

    @property
    def points(self) -> Array:
        """Corners of all that has to be seen, in the world, shape (p, 3) [m]."""
        found = []
        for column, target in enumerate(self.scene.targets):
            rows = np.flatnonzero(self.required[:, column])
            for box in target.boxes:
                poses = self.states.box_poses(box)
                poses = poses if len(poses) == 1 else poses[rows]
                found.append(transform(poses, box_corners(box.size)).reshape(-1, 3))
        return np.concatenate(found) if found else np.zeros((0, 3))


def judged(cell: Cell, task: str, candidate: Candidate, scene: Rehearsal) -> JudgedWay:
    """A way with some of its first samples."""
    samples = _first_samples(cell, scene)
    ends = samples.ends
    number = np.arange(len(samples)) - np.maximum.accumulate(np.where(ends, np.arange(len(samples)), 0))
    rows = np.flatnonzero(ends | (number % EVERY == 0))
    return JudgedWay(scene, samples.some(rows), task=task, candidate=candidate)


def _first_samples(cell: Cell, scene: Rehearsal) -> Samples:
    """The first samples of a way, which do not depend on cameras."""
    return first_samples(Adaptive(), scene.stage, Observer((), cell.observer.solids), scene.targets)


def varied(scenes: Sequence[Rehearsal]) -> list[Rehearsal]:
    """Some of the ways of a candidate: the fastest, that of the first grip, then that of each other branch of the arm.

    That of the first grip is there so that a choice among them is never worse than without a choice of ways.
    """
    ordered = sorted(scenes, key=lambda scene: compared_time(scene.motion.time))
    branches: dict[str, Rehearsal] = {}
    for scene in ordered:
        branches.setdefault(repr(sorted(scene.candidate.branch.items())), scene)
    return list(dict.fromkeys([ordered[0], of_first_grip(scenes), *branches.values()]))[:MOST_WAYS]


def of_first_grip(scenes: Sequence[Rehearsal]) -> Rehearsal:
    """The way with `--ways fastest`: the only one that a candidate has without a choice of ways."""
    ordered = sorted(scenes, key=lambda scene: compared_time(scene.motion.time))
    return next(scene for scene in ordered if _grip(scene) == _grip(scenes[0]))


def _grip(scene: Rehearsal) -> dict[str, float | str]:
    """What a way has chosen besides the branch."""
    way = scene.candidate
    return {name: value for name, value in way.parameters.items() if name not in way.branch}


def middle_of(ways: Sequence[JudgedWay]) -> Array:
    """The middle of all that has to be seen in some ways, in whole millimetres, shape (3,) [m]."""
    points = np.concatenate([way.points for way in ways])
    if not len(points):
        return np.zeros(3)
    middle: Array = np.round(0.5 * (points.min(axis=0) + points.max(axis=0)), 3) + 0.0
    return middle


AT_TARGETS = AimsEntry(targets="middle")
"""The aims of a mount that states none."""


@dataclass(frozen=True, eq=False)
class View:
    """A pose of a camera at a place."""

    spot: int
    """Index of the place."""
    X_FC: Array
    """Pose of the optical frame in the frame that carries it, shape (4, 4)."""
    at: Array | None
    """The point that it looks at, in that frame, if its aim says one, shape (3,)."""
    up: Array
    """What is up in the image then, shape (3,)."""


@dataclass(frozen=True, eq=False)
class Installation:
    """A camera somewhere on its mount."""

    spot: Spot
    view: View
    lens: LensChoice

    def camera(self, name: str) -> Camera:
        """The camera there."""
        return completed(Camera, self.lens, self.lens.intrinsics, name=name, frame=self.spot.frame, X_FC=self.view.X_FC)


@dataclass(frozen=True)
class Option:
    """A camera that may be chosen, by index."""

    view: int
    lens: int


def views_of(spots: Sequence[Spot], middle: Array, middles: Sequence[Array]) -> list[View]:
    """The poses at every place. middle: of all that has to be seen, (3,); middles: of what each candidate shows."""
    return [view for index, spot in enumerate(spots) for view in _at(index, spot, middle, middles)]


def options_of(spots: Sequence[Spot], views: Sequence[View], lenses: Sequence[LensChoice]) -> list[Option]:
    """Every pose with every lens that fits its mount."""
    number = {lens.name: index for index, lens in enumerate(lenses)}
    return [Option(index, number[lens.name]) for index, view in enumerate(views) for lens in spots[view.spot].lenses]


def _at(index: int, spot: Spot, middle: Array, middles: Sequence[Array]) -> Iterator[View]:
    aims = spot.entry.aims or AT_TARGETS
    up, eye = np.array(aims.up, dtype=float), spot.position
    points = [np.array(point, dtype=float) for point in aims.at]
    if aims.targets is not None and spot.frame == WORLD:
        points += [middle, *(middles if aims.targets == "each" else ())]
    if aims.cone is not None:
        points += list(np.round(eye + aims.cone.directions(), 6))
    known: list[Array] = []
    for point in points:
        if np.linalg.norm(point - eye) > SAME and not any(np.linalg.norm(point - one) < SAME for one in known):
            known.append(point)
            yield View(index, read_only(looking_at(eye[None], point[None], up)[0]), point, up)
    for one in aims.fixed:
        yield View(index, read_only(pose(one.matrix()[:3, :3], eye)), None, up)


def price_of(spot: Spot, lens: LensChoice) -> float:
    """Of a camera and of mounting it there."""
    return spot.entry.price + lens.price


_TOGETHER = 400_000
"""Places to compare with a solid at once, counted in every state, to bound the memory."""


def blocked(cell: Cell, way: JudgedWay, spots: Sequence[Spot]) -> Mask:
    """Whether the body of a camera at each place touches anything during a motion, shape (spots,).

    What is fixed to the same link as a place is not looked at.
    """
    found = np.zeros(len(spots), dtype=bool)
    states = way.scene.stage.states(_first_samples(cell, way.scene))
    order = sorted(range(len(spots)), key=lambda index: (spots[index].frame, spots[index].entry.body))
    for (frame, body), group in groupby(order, key=lambda index: (spots[index].frame, spots[index].entry.body)):
        rows = np.array(list(group))
        places = np.stack([spots[row].position for row in rows])
        X_FW = inverse(states.X_WF[frame])
        for solid in cell.observer.solids:
            X_FP = X_FW @ states.X_WF[solid.part.parent]
            if frame != WORLD and float(np.ptp(X_FP, axis=0).max()) < 1e-9:
                continue
            step = max(1, _TOGETHER // len(X_FP))
            for start in range(0, len(rows), step):
                here = np.flatnonzero(~found[rows[start : start + step]]) + start
                if len(here):
                    found[rows[here]] = touched(solid, X_FP, places[here], 0.5 * body)
    return found


def pairs_apart(spots: Sequence[Spot]) -> Iterator[tuple[int, int]]:
    """The pairs of places in one frame at which the bodies of two cameras would touch each other."""
    places, radii = np.stack([spot.position for spot in spots]), np.array([0.5 * spot.entry.body for spot in spots])
    frames = np.unique([spot.frame for spot in spots], return_inverse=True)[1]
    for first in range(len(spots) - 1):
        gap = np.linalg.norm(places[first + 1 :] - places[first], axis=1) - radii[first + 1 :] - radii[first]
        for other in np.flatnonzero((gap < -1e-9) & (frames[first + 1 :] == frames[first])).tolist():
            yield first, first + 1 + other


def hidden_by(way: JudgedWay, spot: Spot, other: Spot) -> Mask:
    """Which items of a way a camera at one place may hide from a camera at another place, shape (items,).

    Its body is a ball, and so counts what encloses each box: more than is hidden, never less.
    """
    radius, targets = 0.5 * spot.entry.body, way.scene.targets
    sample, target = way.items
    hidden = np.zeros(len(sample), dtype=bool)
    ball, eye = (_in_world(way, one)[sample if one.frame != WORLD else np.zeros_like(sample)] for one in (spot, other))
    for column, entry in enumerate(targets):
        rows = np.flatnonzero(target == column)
        for box in entry.boxes:
            poses = way.states.box_poses(box)
            center = (poses if len(poses) > 1 else np.repeat(poses, len(way.samples), axis=0))[sample[rows], :3, 3]
            reach = 0.5 * float(np.linalg.norm(box.size))
            axis = center - eye[rows]
            far = np.maximum(np.linalg.norm(axis, axis=1), 1e-9)
            axis /= far[:, None]
            along = np.einsum("ri,ri->r", ball[rows] - eye[rows], axis)
            aside = np.linalg.norm(ball[rows] - eye[rows] - along[:, None] * axis, axis=1)
            width = reach * np.clip(along / far, 0.0, 1.0)
            hidden[rows] |= (along > -radius) & (along < far + reach + radius) & (aside < width + radius)
    return hidden


def _in_world(way: JudgedWay, spot: Spot) -> Array:
    """Where a place is in the world, shape (m, 3) or (1, 3)."""
    X_WF = way.states.X_WF[spot.frame]
    return X_WF[:, :3, :3] @ spot.position + X_WF[:, :3, 3]
