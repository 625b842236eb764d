"""The least change of one camera that meets a wish while the motion stays as it is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Mask, inverse, read_only, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.camera_moves import CameraMove, Lens, whole
from sqrp_cli.programming.advice.change import Change, Margin
from sqrp_cli.programming.advice.effects import seen_by
from sqrp_cli.programming.advice.least import Search, shells
from sqrp_cli.programming.advice.look import Look, Scene
from sqrp_cli.programming.advice.room import CameraRoom
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import Timeline
from sqrp_cli.programming.coverage.verdict import HELP, NOTHING_MISSING, verdict

_MARGIN_STEPS = 300
"""Steps in which margins are searched."""

MOST_MORE = {"m": 0.3, "rad": np.radians(30)}
"""A margin is not searched beyond the size itself and this."""

_COMPARED_POSES = 400
"""Poses that are compared where none meets the wish, to name what comes nearest."""


@dataclass(frozen=True, eq=False)
class Base:
    """A candidate as it is now: what all changes of cameras start from."""

    cell: Cell
    study: Study
    """With the verdicts of every camera."""
    wish: Wish
    sampling: Sampling
    room: CameraRoom
    seed: int

    @cached_property
    def scene(self) -> Scene:
        """Its first samples."""
        return Scene.of(self.cell, self.study, self.wish)

    def observed(self, change: Change) -> Study:
        """The same motion with a changed camera."""
        return seen_by(change.in_cell(self.cell), self.study, self.sampling)

    def limit(self, change: Change, found: Study) -> str:
        """Which limit stands in the way of a changed candidate, in a sentence."""
        said = verdict(change.in_cell(self.cell), found)
        slow = "so long take a frame and the latency of the camera that sees it"
        return slow if said == NOTHING_MISSING else said.split(HELP)[0]


class Met(NamedTuple):
    """A change that meets the wish."""

    change: Change
    found: Assessment
    """The candidate with it."""


class Near(NamedTuple):
    """A change that comes near."""

    change: Change
    study: Study
    """The candidate with it."""


@dataclass(eq=False)
class CameraSearch:
    """Looks for changes of one camera; what it learns about one kind makes the others faster."""

    base: Base
    camera: Camera
    aim: Aim
    index: int | None
    """Of the camera in the cell; None if it would be a further one."""
    _scene: Scene = field(init=False)
    _look: Look = field(init=False)

    def __post_init__(self) -> None:
        self._sharpen(self.base.scene)

    @property
    def hopeful(self) -> bool:
        """Whether this camera alone may meet the wish from anywhere, however it looks."""
        return self._look.hopeful

    @property
    def middle(self) -> Aim | None:
        """An aim at the middle of what this camera must see, if there is anything."""
        if self._look.camera is None:
            return None
        corners = self._look.camera.corners.reshape(-1, 3)
        point = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        X_FW = inverse(self.base.scene.states.X_WF[self.camera.frame][0])
        return replace(self.aim, point=read_only(whole(transform(X_FW, point[None])[0])))

    def anywhere(self, move: CameraMove, reach: float) -> Met | None:
        """A small change of a kind that meets the wish; None if none was found as far as `reach`."""
        return self._met(move, self._search(move, reach).anywhere())

    def within(self, move: CameraMove, size: float) -> Met | None:
        """A change that meets the wish if any point of the move's grid does up to a size."""
        return self._met(move, self._search(move, size).within(size))

    def _search(self, move: CameraMove, reach: float) -> Search:
        return Search(
            test=lambda vectors: self._passes(move, vectors),
            decide=lambda vector: self.decide(move.change(vector)) is not None,
            dimension=move.dimension,
            step=move.step,
            reach=reach,
            seed=self.base.seed,
        )

    def _met(self, move: CameraMove, vector: Array | None) -> Met | None:
        if vector is None:
            return None
        change = move.change(vector)
        found = self.decide(change)
        return None if found is None else Met(change, found)

    def least_lens(self) -> Met | None:
        """The least change of the field of view that meets the wish."""
        lens = Lens(self.camera, self.aim)
        for difference in lens.views.tolist():
            change = lens.change(difference)
            if change.camera is not None and self._lens_passes(change.camera):
                found = self.decide(change)
                if found is not None:
                    return Met(change, found)
        return None

    def decide(self, change: Change) -> Assessment | None:
        """The candidate's figures with a change if they meet the wish, from the exact timeline."""
        if change.camera is None or not self._free(change.camera.X_FC[None])[0]:
            return None
        study = self.base.observed(change)
        found = study.assessment("")
        if self.base.wish.met(found):
            return found
        self._learn(study.timeline)
        return None

    def margin(self, move: CameraMove, change: Change) -> Margin:
        """How much less and how much more of a change along the same direction meets the wish."""
        vector = np.array(change.values)
        size = float(np.linalg.norm(vector))
        most = size + MOST_MORE[change.unit]
        lengths = np.linspace(0.0, most, _MARGIN_STEPS)
        passes = self._passes(move, lengths[:, None] * vector / size)
        above, below = lengths[(lengths > size)], lengths[lengths < size][::-1]
        more = self._unbroken(move, vector / size, above, passes[lengths > size], size)
        less = self._unbroken(move, vector / size, below, passes[lengths < size][::-1], size)
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

    def _unbroken(self, move: CameraMove, unit: Array, lengths: Array, passes: Mask, size: float) -> float:
        """The last of some lengths, going away from `size`, up to which all pass, and which is confirmed exactly."""
        count = int(np.argmin(np.append(passes, False)))
        while count:
            change = move.change(lengths[count - 1] * unit)
            if change.size and self.decide(change) is not None:
                return float(lengths[count - 1])
            count //= 2
        return size

    def _passes(self, move: CameraMove, vectors: Array) -> Mask:
        poses = move.poses(vectors)
        passes = self._look.passes(poses)
        rows = np.flatnonzero(passes)
        passes[rows] = self._free(poses[rows])
        return passes

    def _lens_passes(self, camera: Camera) -> bool:
        return bool(Look(self._scene, camera, self.index).passes(camera.X_FC[None])[0])

    def _free(self, X_FC: Array) -> Mask:
        """Whether the camera may be there; one that moves with the robot goes wherever its link does."""
        if self.camera.frame != WORLD:
            return np.ones(len(X_FC), dtype=bool)
        still = np.linalg.norm(X_FC[:, :3, 3] - self.camera.X_FC[:3, 3], axis=1) < 1e-9
        present = None if self.index is None else self.camera.X_FC[:3, 3]
        free = self.base.room.free(X_FC[:, :3, 3], present)
        stays: Mask = still & (self.index is not None)
        return np.logical_or(free, stays)

    def _learn(self, timeline: Timeline) -> None:
        sharper = self._scene.with_failures(timeline)
        if len(sharper.samples) > len(self._scene.samples):
            self._sharpen(sharper)

    def _sharpen(self, scene: Scene) -> None:
        self._scene, self._look = scene, Look(scene, self.camera, self.index)
