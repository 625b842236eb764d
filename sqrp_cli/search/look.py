"""Cheap looks at fixed samples of a motion: whether a wish can be met with one camera elsewhere.

A look never says that a wish is met, only that it cannot be: at a sample something is not seen that the wish needs.
What passes is decided by the exact timeline of the same motion; its uncovered samples make the next looks sharper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, Indices, Mask, box_corners, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.search.goal import Goal
from sqrp_cli.sight.observer import sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.assessment import Study
from sqrp_cli.study.stage import Samples, states_of
from sqrp_cli.study.timeline import Timeline
from sqrp_cli.study.whole_study import WholeStudy
from sqrp_cli.task.pieces import fault_intervals

MOST_SAMPLES = 64
"""Samples of the first look; counterexamples come on top."""

_FIRST, _GROWTH = 1, 3
"""Views of each pose that are tested for occlusion at once: few at first, then so many times more."""


@dataclass(frozen=True, eq=False)
class WishedSamples:
    """Samples of a candidate's motion that a wish is about, with what each camera sees in them now.

    Of several steps, those of one come after those of the other.
    """

    cell: Cell
    study: WholeStudy
    wish: Goal
    samples: tuple[Samples, ...]
    """Of each step; m of them in all."""

    @classmethod
    def of(cls, cell: Cell, study: WholeStudy, wish: Goal) -> WishedSamples:
        """The samples of a study that the wish is about, thinned."""
        of_steps = []
        for step in study.steps:
            samples = step.timeline.samples
            of_steps.append(samples.some(_thinned(samples, np.flatnonzero(_wished(step, samples, wish)))))
        return cls(cell, study, wish, tuple(of_steps))

    def with_failures(self, timelines: Sequence[Timeline]) -> WishedSamples:
        """With samples at which other timelines of the same motions, one of each step, are not covered, thinned."""
        of_steps = []
        for step, samples, timeline in zip(self.study.steps, self.samples, timelines, strict=True):
            lost = _wished(step, timeline.samples, self.wish) & ~timeline.covered
            found = timeline.samples.some(_thinned(timeline.samples, np.flatnonzero(lost), MOST_SAMPLES // 4))
            known = set(zip(samples.piece.tolist(), samples.t.tolist(), strict=True))
            pairs = zip(found.piece.tolist(), found.t.tolist(), strict=True)
            added = found.some(np.array([pair not in known for pair in pairs], dtype=bool))
            of_steps.append(samples.joined(added, samples.merge_order(added)))
        return replace(self, samples=tuple(of_steps))

    @property
    def count(self) -> int:
        """M."""
        return sum(map(len, self.samples))

    @cached_property
    def states(self) -> SceneStates:
        """Where everything is in the samples."""
        return states_of([step.stage for step in self.study.steps], self.samples)

    @cached_property
    def targets(self) -> tuple[Target, ...]:
        """The targets of all steps, a of them."""
        return tuple(target for step in self.study.steps for target in step.targets)

    @cached_property
    def required(self) -> Mask:
        """Whether a state holds the target's atom, shape (m, a)."""
        required = np.zeros((self.count, len(self.targets)), dtype=bool)
        for step, samples, rows, columns in self._blocks:
            required[rows, columns] = step.stage.requires(step.targets, samples)
        return required

    @cached_property
    def sees(self) -> Mask:
        """Whether each camera sees each target, shape (m, a, c); false in the other steps than its own."""
        own = [np.arange(self.count)[rows] for step, _, rows, _ in self._blocks for _ in step.targets]
        matrix = self.cell.observer.verdicts(self.targets, self.states, rows=own, shares=False)
        sees = np.zeros((self.count, len(self.targets), len(self.cell.observer.cameras)), dtype=bool)
        for column, (rows, boxes) in enumerate(zip(own, matrix, strict=True)):
            sees[rows, column] = sees_all(boxes)
        return sees

    @cached_property
    def _blocks(self) -> list[tuple[Study, Samples, slice, slice]]:
        """Each step with its samples, and which of all samples and targets are its own."""
        row = column = 0
        blocks = []
        for step, samples in zip(self.study.steps, self.samples, strict=True):
            rows, columns = slice(row, row + len(samples)), slice(column, column + len(step.targets))
            blocks.append((step, samples, rows, columns))
            row, column = rows.stop, columns.stop
        return blocks

    def possible(self, covered: Mask) -> Mask:
        """Whether the wish may be met if these samples are covered, shape (p, m); shape (p,).

        Between a covered and an uncovered sample all may be covered, so figures are bounds. Times are not looked at.
        """
        good = np.ones(len(covered), dtype=bool)
        for least, T, steps in self._qualities:
            either = covered[:, 1:] | covered[:, :-1]
            good &= either @ steps >= (least - 1e-9) * T
            if least >= 1.0:
                weighty = np.zeros(self.count, dtype=bool)
                weighty[1:] |= steps > 0
                weighty[:-1] |= steps > 0
                good &= covered[:, weighty].all(axis=1)
        for inside, t, unknown in self._fault_rows:  # a bound from below of the longest time without cover
            seen = covered[:, inside] | unknown
            blind, since = np.zeros(len(seen)), np.full(len(seen), np.nan)
            for column, now in enumerate(t.tolist()):
                since = np.where(seen[:, column], np.nan, np.where(np.isnan(since), now, since))
                blind = np.fmax(blind, now - since)
            good &= blind <= (self.wish.delay or 0.0) + 1e-9
        return good

    @cached_property
    def _qualities(self) -> list[tuple[float, float, Array]]:
        """For each quality of the wish: its least value, the time that counts, and the step after each sample."""
        monitored, interesting = [np.zeros(0)], [np.zeros(0)]
        for step, samples in zip(self.study.steps, self.samples, strict=True):
            after = np.append(samples.steps, 0.0)[: len(samples)]
            monitored.append(after)
            interesting.append(np.where(step.stage.of_interest(samples), after, 0.0))
        timelines, found = [step.timeline for step in self.study.steps], []
        if self.wish.q_eoi is not None:
            T_eoi = sum(timeline.T_eoi for timeline in timelines)
            found.append((self.wish.q_eoi, T_eoi, np.concatenate(interesting)[:-1]))
        if self.wish.q_avg is not None:
            T = sum(timeline.T for timeline in timelines)
            found.append((self.wish.q_avg, T, np.concatenate(monitored)[:-1]))
        return found

    @cached_property
    def _fault_rows(self) -> list[tuple[Indices, Array, Mask]]:
        """For each fault, if the wish is about delays: the r samples in which it may happen, and their times, (r,).

        And those whose state needs other literals, too, so that nothing follows from it about the fault, shape (r,).
        """
        found = []
        for step, samples, rows, columns in self._blocks if self.wish.delay is not None else ():
            for fault, own in step.timeline.faults.items():
                inside = np.flatnonzero(_inside(step, fault, samples))
                others = [columns.start + column for column in range(len(step.targets)) if column not in own]
                at = rows.start + inside
                unknown: Mask = np.any(self.required[np.ix_(at, others)], axis=1)
                found += [(at, samples.t[inside], unknown)] if len(at) else []
        return found


class CameraLook:
    """What one camera must see in a scene, because the others do not, and which of its poses can."""

    def __init__(self, scene: WishedSamples, camera: Camera, index: int | None) -> None:
        """index: of the camera among those of the cell; None if it would be a further one."""
        others = scene.sees if index is None else np.delete(scene.sees, index, axis=2)
        count, needed = others.sum(axis=2), np.array([target.cameras for target in scene.targets])
        wanted = scene.required & (count == needed - 1)
        self._scene = scene
        self._hopeless: Mask = (scene.required & (count < needed - 1)).any(axis=1)
        self._camera = camera
        self._row, self._target = np.nonzero(wanted & ~self._hopeless[:, None])
        # By their bits, reversed: so early ones are spread over all.
        width = max(1, (len(self._row) - 1).bit_length())
        spread = sorted(range(len(self._row)), key=lambda number: int(f"{number:0{width}b}"[::-1], 2))
        self._order = np.array(spread, dtype=np.int64)
        self._failures = np.zeros(len(self._row), dtype=np.int64)

    @property
    def corners(self) -> Array:
        """Corners in the world of all boxes that the camera must see, shape (n, 3); none if there are no boxes."""
        found, states = [np.empty((0, 3))], self._scene.states
        for row, target in zip(self._row.tolist(), self._target.tolist(), strict=True):
            for box in self._scene.targets[target].boxes:
                X_WB = states.box_poses(box)
                found.append(transform(X_WB[row if len(X_WB) > 1 else 0], box_corners(box.size)))
        return np.concatenate(found)

    @property
    def hopeful(self) -> bool:
        """Whether any pose of the camera may meet the wish."""
        return bool(self._scene.possible(~self._hopeless[None])[0])

    def passes(self, X_FC: Array) -> Mask:
        """Which of p poses of the camera, shape (p, 4, 4), may meet the wish."""
        sees = self._seen(X_FC, limits_only=True)
        open_ones = np.flatnonzero(self._scene.possible(self._covered(sees)))
        done, count = 0, _FIRST
        while len(open_ones) and done < len(self._order):
            chosen = self._order[done : done + count]
            asked = np.zeros((len(open_ones), len(self._row)), dtype=bool)
            asked[:, chosen] = sees[np.ix_(open_ones, chosen)]
            failed = asked & ~self._seen(X_FC[open_ones], asked)
            sees[open_ones] &= ~failed
            self._failures += failed.sum(axis=0)  # those that fail often come first from now on
            open_ones = open_ones[self._scene.possible(self._covered(sees[open_ones]))]
            done, count = done + count, _GROWTH * count
        self._order = self._order[np.argsort(-self._failures[self._order], kind="stable")]
        passed = np.zeros(len(X_FC), dtype=bool)
        passed[open_ones] = True
        return passed

    def quality(self, X_FC: Array) -> Array:
        """Share of the samples that are covered, for each of p poses (p, 4, 4), to compare poses that do not pass."""
        quality: Array = self._covered(self._seen(X_FC)).mean(axis=1)
        return quality

    def _seen(self, X_FC: Array, asked: Mask | None = None, *, limits_only: bool = False) -> Mask:
        """Whether the camera sees, from each of p poses (p, 4, 4), each target that it must see in a sample, (p, n)."""
        scene = self._scene
        items = scene.targets, scene.states, self._row, self._target
        (found,) = scene.cell.observer.seen_from([self._camera], X_FC, *items, asked=asked, limits_only=limits_only)
        seen: Mask = found
        return seen

    def _covered(self, sees: Mask) -> Mask:
        """Whether each sample is covered, shape (p, m)."""
        covered = np.tile(~self._hopeless, (len(sees), 1))
        begins = np.flatnonzero(np.diff(self._row, prepend=-1))
        if len(begins):
            covered[:, self._row[begins]] &= np.logical_and.reduceat(sees, begins, axis=1)
        return covered


def _wished(study: Study, samples: Samples, wish: Goal) -> Mask:
    """Which samples a wish is about."""
    wished = np.zeros(len(samples), dtype=bool)
    if wish.q_avg is not None:
        wished |= np.array([bool(piece.literals) for piece in study.stage.pieces])[samples.piece]
    if wish.q_eoi is not None:
        wished |= study.stage.of_interest(samples)
    for fault in study.timeline.faults if wish.delay is not None else ():
        wished |= _inside(study, fault, samples)
    return wished


def _inside(study: Study, fault: str, samples: Samples) -> Mask:
    inside = np.zeros(len(samples), dtype=bool)
    for stretch in fault_intervals(study.formulas, fault):
        inside |= (samples.t >= stretch.start) & (samples.t <= stretch.end)
    return inside


def _thinned(samples: Samples, rows: Indices, most: int = MOST_SAMPLES) -> Indices:
    """So many of the rows at most, evenly in time, with the ends of every piece."""
    if len(rows) <= most:
        return rows
    some = samples.some(rows)
    even = np.searchsorted(some.t, np.linspace(some.t[0], some.t[-1], most), side="right") - 1
    thinned: Indices = rows[np.unique(np.concatenate([np.flatnonzero(some.ends), even]))]
    return thinned
