"""The least change of one camera that meets a wish while the motion stays as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sqrp_cli.geometry import Array, Mask, inverse, read_only, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.programming.advice.aiming import Aim, CameraRoom, looking_at
from sqrp_cli.programming.advice.camera_moves import LENS_STEP, LENS_STRIDE, CameraMove, Lens, placed, whole
from sqrp_cli.programming.advice.change import Margin, ProposedChange
from sqrp_cli.programming.advice.least import LeastSearch, least_beyond, shells
from sqrp_cli.programming.advice.look import CameraLook, WishedSamples
from sqrp_cli.programming.advice.question import Met, Near, finely_met, seen_by
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.quality import interest_quality
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.coverage.timeline import Timeline, observe
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.whole_study import WholeStudy, mean_quality

_MARGIN_STEPS = 60
"""Steps in which margins of poses are searched."""

_WIDER = tuple(range(5, 305, 15))
"""By how many more steps of the view a lens is tried for its margin."""

MOST_MORE = {"m": 0.3, "rad": np.radians(30)}
"""A margin is not searched beyond the size itself and this."""

_ROOM = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""Distances by which a further camera may be off [m] that are tried."""

_DISTANCES = (0.5, 0.75, 1.0, 1.35, 1.8)
"""Distances of a further camera from what it must see [m]."""

_DIRECTIONS = 90
"""Directions, over the upper half, in which a further camera may be."""

_PLACES_DECIDED = 12
"""Places of a further camera that are decided, at most."""

_COMPARED_POSES = 400
"""Poses that are compared where none meets the wish, to name what comes nearest."""


@dataclass(frozen=True, eq=False)
class Base:
    """A candidate as it is now: what all changes of cameras start from."""

    cell: Cell
    study: WholeStudy
    """With the verdicts of every camera."""
    wish: Wish
    sampling: Sampling
    room: CameraRoom
    seed: int

    @cached_property
    def scene(self) -> WishedSamples:
        """Its first samples."""
        return WishedSamples.of(self.cell, self.study, self.wish)

    def observed(self, change: ProposedChange) -> WholeStudy:
        """The same motion with a changed camera."""
        return seen_by(change.in_cell(self.cell), self.study, self.sampling)

    def finely_met(self, change: ProposedChange) -> bool:
        """Whether the wish is met with a changed camera as every command samples it."""
        return finely_met(self.wish, change.in_cell(self.cell), self.study, self.sampling)

    def failure(self, change: ProposedChange) -> Sequence[Timeline] | None:
        """The events of interest of each step with a changed camera, if they miss a wish that is about nothing else.

        That takes a fraction of the whole motion's time. None: they do not, or the wish is about more.
        """
        if not self.wish.only_events:
            return None
        observer = change.in_cell(self.cell).observer
        timelines = [step.timeline for step in self.study.steps]
        seen: list[tuple[float | None, float | None]] = [(1.0, timeline.T_eoi) for timeline in timelines]  # at most
        for number, step in enumerate(self.study.steps):
            if not timelines[number].T_eoi:
                continue
            timelines[number] = _events_seen(step, self._events[number], observer, self.sampling)
            seen[number] = (interest_quality(timelines[number]), timelines[number].T_eoi)
            if (mean_quality(seen) or 0.0) < (self.wish.q_eoi or 0.0):
                return timelines
        return None

    @cached_property
    def _events(self) -> list[Stage]:
        """The events of interest of each step."""
        return [
            Stage(step.stage.model, step.motion, [one for one in step.stage.pieces if one.of_interest], step.world.X_WO)
            for step in self.study.steps
        ]


def _events_seen(step: Study, events: Stage, observer: Observer, sampling: Sampling) -> Timeline:
    """The timeline of a step's events of interest as cameras see them, in terms of all of its pieces."""
    which = np.array([number for number, piece in enumerate(step.stage.pieces) if piece.of_interest])
    timeline = observe(replace(step, stage=events, faults={}), observer, sampling, full=False)
    samples = Samples(which[timeline.samples.piece], timeline.samples.t)
    return replace(timeline, pieces=step.stage.pieces, samples=samples)


@dataclass(eq=False)
class CameraSearch:
    """Looks for changes of one camera; what it learns about one kind makes the others faster."""

    base: Base
    camera: Camera
    aim: Aim
    index: int | None
    """Of the camera in the cell; None if it would be a further one."""
    like: str = ""
    """Of a further camera: the one whose lens it has."""
    _scene: WishedSamples = field(init=False)
    _look: CameraLook = field(init=False)

    def __post_init__(self) -> None:
        self._sharpen(self.base.scene)

    @property
    def hopeful(self) -> bool:
        """Whether this camera alone may meet the wish from anywhere, however it looks."""
        return self._look.hopeful

    @property
    def middle(self) -> Aim | None:
        """An aim at the middle of what this camera must see, if there is anything."""
        corners = self._look.corners
        if not len(corners):
            return None
        point = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        X_FW = inverse(self.base.scene.states.X_WF[self.camera.frame][0])
        return replace(self.aim, point=read_only(whole(transform(X_FW, point[None])[0])))

    def anywhere(self, move: CameraMove, reach: float) -> Met | None:
        """A small change of a kind that meets the wish; None if none was found as far as `reach`."""
        return self._met(move, self._search(move, reach).anywhere())

    def within(self, move: CameraMove, size: float) -> Met | None:
        """A change that meets the wish if any point of the move's grid does up to a size."""
        return self._met(move, self._search(move, size).within(size))

    def _search(self, move: CameraMove, reach: float) -> LeastSearch:
        return LeastSearch(
            test=lambda vectors: self._passes(move, vectors),
            decide=lambda vector: self._may(move.change(vector)),
            dimension=move.dimension,
            step=move.step,
            reach=reach,
            seed=self.base.seed,
        )

    def _met(self, move: CameraMove, vector: Array | None) -> Met | None:
        return None if vector is None else self._decided(move.change(vector))

    def _decided(self, change: ProposedChange) -> Met | None:
        found = self.decide(change)
        return None if found is None else Met(change, found)

    def confirmed(self, move: CameraMove, met: Met) -> Met | None:
        """A change, or the least larger one that is found, that meets the wish if sampled as finely as may be."""
        size = met.change.size
        unit = np.array(met.change.values) / size

        def finely(length: float) -> Met | None:
            tried = met if length == size else self._met(move, length * unit)
            return tried if tried is not None and self.base.finely_met(tried.change) else None

        return least_beyond(finely, size, size + MOST_MORE[met.change.unit], 0.1 * move.step)

    def least_lens(self) -> Met | None:
        """The least change of the field of view that meets the wish, from coarse to fine."""
        lens = Lens(self.camera, self.aim)
        for steps in lens.steps(LENS_STRIDE).tolist():
            if self._lens_met(lens, steps) is not None:
                toward = 1 if steps > 0 else -1
                between = range(steps - toward * (LENS_STRIDE - 1), steps + toward, toward)
                tried = (self._lens_met(lens, number) for number in between)
                fine = next((met for met in tried if met is not None and self.base.finely_met(met.change)), None)
                if fine is not None:
                    return fine
        return None

    def lens_margin(self, change: ProposedChange) -> Margin:
        """How much less and how much more of a change of the view meets the wish, in its direction."""
        lens = Lens(self.camera, self.aim)
        steps = round(change.values[0] / LENS_STEP)
        toward = 1 if steps > 0 else -1
        allowed = set(lens.steps().tolist())
        passed = 0
        for more in _WIDER:
            if steps + toward * more not in allowed or not self._lens_passes(lens, steps + toward * more):
                break
            passed = more
        while passed and self._lens_met(lens, steps + toward * passed) is None:
            passed //= 2
        return Margin(less=0.0, more=passed * LENS_STEP)

    def nearest_lens(self) -> Near:
        """The lens with which most of the samples are covered."""
        lens = Lens(self.camera, self.aim)

        def quality(steps: int) -> float:
            look = CameraLook(self._scene, _camera_of(lens.change(steps)), self.index)
            return float(look.quality(self.camera.X_FC[None])[0])

        change = lens.change(max(lens.steps(3 * LENS_STRIDE).tolist(), key=quality))
        return Near(change, self.base.observed(change))

    def _lens_met(self, lens: Lens, steps: int) -> Met | None:
        if steps == 0 or not self._lens_passes(lens, steps):
            return None
        return self._decided(lens.change(steps))

    def decide(self, change: ProposedChange) -> CandidateResult | None:
        """The candidate's figures with a change if they meet the wish, from the exact timeline."""
        if not self._may_be_there(change) or self._fails(change):
            return None
        study = self.base.observed(change)
        found = study.assessment
        if self.base.wish.met(found):
            return found
        self._learn([step.timeline for step in study.steps])
        return None

    def _may(self, change: ProposedChange) -> bool:
        """Whether a change meets the wish, as far as the events of interest show where it is about nothing else."""
        if self.base.wish.only_events:
            return self._may_be_there(change) and not self._fails(change)
        return self.decide(change) is not None

    def _may_be_there(self, change: ProposedChange) -> bool:
        return change.camera is not None and bool(self._free(change.camera.X_FC[None])[0])

    def _fails(self, change: ProposedChange) -> bool:
        """Whether the events of interest show that the wish is missed; learns from them."""
        failure = self.base.failure(change)
        if failure is not None:
            self._learn(failure)
        return failure is not None

    def margin(self, move: CameraMove, change: ProposedChange) -> Margin:
        """How much less and how much more of a change along the same direction meets the wish."""
        vector = np.array(change.values)
        size = float(np.linalg.norm(vector))
        lengths = np.linspace(0.0, size + MOST_MORE[change.unit], _MARGIN_STEPS)
        more = self._unbroken(move, vector / size, lengths[lengths > size], size)
        less = self._unbroken(move, vector / size, lengths[lengths < size][::-1], size)
        return Margin(less=abs(size - less), more=abs(more - size))

    def nearest(self, move: CameraMove) -> Near | None:
        """The change of a kind with which most of the samples are covered."""
        vectors = np.concatenate(list(shells(move.dimension, 4 * move.step, move.reaches[-1])))
        vectors = vectors[:: max(1, len(vectors) // _COMPARED_POSES)]
        poses = move.poses(vectors)
        vectors, poses = vectors[free := self._free(poses)], poses[free]
        if not len(vectors):
            return None
        best = int(np.argmax(self._look.quality(poses)))
        change = move.change(vectors[best])
        return Near(change, self.base.observed(change))

    def further(self) -> Met | None:
        """A place for a further camera from which it meets the wish, with the most room around it."""
        aim = self.middle
        if aim is None:
            return None
        places = aim.point + _dome()
        poses = looking_at(places, np.tile(aim.point, (len(places), 1)), aim.up)
        passes = self._look.passes(poses)
        rows = np.flatnonzero(passes)
        rows = rows[self._free(poses[rows])]
        if not len(rows):
            return None
        apart = np.linalg.norm(places[rows, None] - places[None], axis=2)
        room = np.where(np.isin(np.arange(len(places)), rows), np.inf, apart).min(axis=1)
        for row in rows[np.argsort(-room, kind="stable")][:_PLACES_DECIDED].tolist():
            met = self._decided(self._placed(whole(places[row]), aim))
            if met is not None and self.base.finely_met(met.change):
                return met
        return None

    def room_around(self, change: ProposedChange) -> Margin:
        """By how much a further camera may be off to any side, its aim kept."""
        aim, camera = change.aim, _camera_of(change)
        assert aim is not None  # noqa: S101 - it goes with the camera
        sides = np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)], dtype=float) - 1.0
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        more = 0.0
        for off in _ROOM:
            eyes = camera.X_FC[:3, 3] + off * sides
            poses = looking_at(eyes, np.tile(aim.point, (len(eyes), 1)), aim.up)
            if not (self._look.passes(poses).all() and self._free(poses).all()):
                break
            if any(self.decide(self._placed(eye, aim)) is None for eye in eyes[:: len(eyes) // 6]):
                break
            more = off
        return Margin(less=0.0, more=more)

    def _placed(self, eye: Array, aim: Aim) -> ProposedChange:
        """A further camera at a place (3,)."""
        return placed(self.camera, eye, aim, kind="camera", values=eye, size=1.0, unit="camera", like=self.like)

    def _unbroken(self, move: CameraMove, unit: Array, lengths: Array, size: float) -> float:
        """The last of some lengths, going away from `size`, up to which all pass, and which is confirmed exactly."""
        for patient in (True, True, True, *(False for _ in lengths)):
            passes = self._passes(move, lengths[:, None] * unit)
            count = int(np.argmin(np.append(passes, False)))
            if not count:
                break
            change = move.change(lengths[count - 1] * unit)
            if change.size and self.decide(change) is not None:
                return float(lengths[count - 1])
            lengths = lengths[: count - 1 if patient else count // 2]  # the failure has made the look sharper
        return size

    def _passes(self, move: CameraMove, vectors: Array) -> Mask:
        poses = move.poses(vectors)
        passes = self._look.passes(poses)
        rows = np.flatnonzero(passes)
        passes[rows] = self._free(poses[rows])
        return passes

    def _lens_passes(self, lens: Lens, steps: int) -> bool:
        camera = _camera_of(lens.change(steps))
        return bool(CameraLook(self._scene, camera, self.index).passes(camera.X_FC[None])[0])

    def _free(self, X_FC: Array) -> Mask:
        """Whether the camera may be there; one that moves with the robot goes wherever its link does."""
        if self.camera.frame != WORLD:
            return np.ones(len(X_FC), dtype=bool)
        still = np.linalg.norm(X_FC[:, :3, 3] - self.camera.X_FC[:3, 3], axis=1) < 1e-9
        present = None if self.index is None else self.camera.X_FC[:3, 3]
        free = self.base.room.free(X_FC[:, :3, 3], present)
        stays: Mask = still & (self.index is not None)
        return np.logical_or(free, stays)

    def _learn(self, timelines: Sequence[Timeline]) -> None:
        sharper = self._scene.with_failures(timelines)
        if sharper.count > self._scene.count:
            self._sharpen(sharper)

    def _sharpen(self, scene: WishedSamples) -> None:
        self._scene, self._look = scene, CameraLook(scene, self.camera, self.index)


def _dome() -> Array:
    """Places of a further camera around what it must see, (n, 3) [m]: spirals over upper halves of spheres."""
    number = np.arange(_DIRECTIONS)
    z = 0.02 + 0.96 * (number + 0.5) / _DIRECTIONS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - z * z)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return np.concatenate([distance * directions for distance in _DISTANCES])


def _camera_of(change: ProposedChange) -> Camera:
    assert change.camera is not None  # noqa: S101 - it is about one
    return change.camera
