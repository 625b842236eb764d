"""The ways of the candidates of all tasks, with the samples in which mounts are judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, box_corners, transform
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


def judged(cell: Cell, task: str, candidate: Candidate, scene: Rehearsal, every: int = EVERY) -> JudgedWay:
    """A way with its first samples: they do not depend on cameras."""
    samples = first_samples(Adaptive(), scene.stage, Observer((), cell.observer.solids), scene.targets)
    piece = samples.piece
    ends = (np.diff(piece, prepend=-1) != 0) | (np.diff(piece, append=-1) != 0)
    number = np.arange(len(samples)) - np.maximum.accumulate(np.where(ends, np.arange(len(samples)), 0))
    rows = np.flatnonzero(ends | (number % every == 0))
    return JudgedWay(scene, Samples(piece[rows], samples.t[rows]), task=task, candidate=candidate)


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
    """The fastest way with the first grip: the only one that a candidate has without a choice of ways."""
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
