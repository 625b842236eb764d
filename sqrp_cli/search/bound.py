"""From which poses one camera may meet a goal: bounds from a few samples of a motion, in which the kernel looks.

A bound never says that a goal is met, only that it cannot be: at a sample the camera does not see what the others do
not see, either. The exact timeline of the same motion decides what passes, and where that misses the goal, its
uncovered samples make the bound sharper.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, Indices, Mask, box_corners, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.search.goal import Goal
from sqrp_cli.sight.observer import sees_all
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.stage import Samples, states_of
from sqrp_cli.study.timeline import Timeline
from sqrp_cli.task.pieces import fault_intervals

MOST_SAMPLES = 64  # Samples to begin with; those at which an exact timeline fails come on top


class CameraBound:
    """What one camera must see in m samples of a motion of one step or several, because the other cameras do not."""

    def __init__(
        self,
        cell: Cell,
        steps: Sequence[Analysis],
        goal: Goal,
        index: int | None,
        samples: Sequence[Samples] | None = None,
    ) -> None:
        """index: of the camera in the cell; None for a further one. samples: of each step, by default some."""
        self._cell, self._steps, self._goal, self._index = cell, steps, goal, index
        if samples is None:
            every = [(step, step.timeline.samples) for step in steps]
            samples = [some.some(_thinned(some, _about_goal(goal, step, some))) for step, some in every]
        self.samples = tuple(samples)
        self.targets = tuple(target for step in steps for target in step.planned.targets)
        self.states = states_of([step.planned.stage for step in steps], samples)
        self._faults = list[tuple[Indices, Array, Mask]]()
        """Of each: the r samples in which it may happen, their times (r,) [s], and those that tell nothing, (r,)."""
        lost, rows, columns = [], [], []
        of_interest, monitored = [np.zeros(0)], [np.zeros(0)]
        row = column = 0
        for step, some in zip(steps, samples, strict=True):
            required = step.planned.stage.requires(step.planned.targets, some)
            matrix = cell.observer.verdicts(step.planned.targets, step.planned.stage.states(some), shares=False)
            seen = [sees_all(boxes) for boxes in matrix]
            others = np.array([one.sum(axis=1) - (0 if index is None else one[:, index]) for one in seen]).T
            missing = np.array([target.cameras for target in step.planned.targets]) - others.reshape(required.shape)
            lost.append((required & (missing > 1)).any(axis=1))
            own = np.argwhere(required & (missing == 1) & ~lost[-1][:, None])
            rows.append(own[:, 0] + row)
            columns.append(own[:, 1] + column)
            after = np.append(some.gaps, 0.0)[: len(some)]
            monitored.append(after)
            of_interest.append(np.where(step.planned.stage.of_interest(some), after, 0.0))
            for fault, atoms in step.planned.faults.items() if goal.delay is not None else ():
                at = np.flatnonzero(_inside(step, fault, some))
                if len(at):  # where other literals are required, too, nothing follows about this fault
                    unknown = np.asarray(np.delete(required[at], atoms, axis=1).any(axis=1))
                    self._faults.append((at + row, some.t[at], unknown))
            row, column = row + len(some), column + len(step.planned.targets)
        self._hopeless, self._row, self._target = map(np.concatenate, (lost, rows, columns))
        T_eoi, T = (sum(times) for times in zip(*((s.planned.T_eoi, s.planned.T) for s in steps), strict=True))
        parts = ((goal.q_eoi, T_eoi, of_interest), (goal.q_avg, T, monitored))
        self._qualities = [
            (least, time, np.concatenate(weights)[:-1]) for least, time, weights in parts if least is not None
        ]
        self._decisive = np.zeros(row, dtype=bool)  # of these samples every one counts
        for least, _, weight in self._qualities:
            if least >= 1.0:
                self._decisive[1:] |= weight > 0
                self._decisive[:-1] |= weight > 0
        spread = np.argsort(np.arange(len(self._row)) * 0.618 % 1.0, kind="stable")  # so that early ones are all over
        self._row, self._target = self._row[spread], self._target[spread]

    def sharper(self, timelines: Sequence[Timeline]) -> CameraBound:
        """With samples at which other timelines of the same motions, one of each step, are not covered; or itself."""
        joined = []
        for step, samples, timeline in zip(self._steps, self.samples, timelines, strict=True):
            wanted = _about_goal(self._goal, step, timeline.samples)
            lost = wanted[~timeline.covered[wanted]]
            found = timeline.samples.some(_thinned(timeline.samples, lost, MOST_SAMPLES // 4))
            joined.append(samples.with_new(found))
        same = sum(map(len, joined)) == len(self._hopeless)
        return self if same else CameraBound(self._cell, self._steps, self._goal, self._index, joined)

    @property
    def corners(self) -> Array:
        """Corners in the world of all boxes that the camera must see, shape (n, 3); none if there are no boxes."""
        found = [np.empty((0, 3))]
        for column, target in enumerate(self.targets):
            for box in target.boxes:
                X_WB = np.broadcast_to(self.states.box_poses(box), (self.states.count, 4, 4))
                seen_at = X_WB[self._row[self._target == column]]
                found.append(transform(seen_at, box_corners(box.size)).reshape(-1, 3))
        return np.concatenate(found)

    @property
    def hopeful(self) -> bool:
        """Whether the camera alone may meet the goal from any pose."""
        return bool(self._possible(~self._hopeless[None])[0])

    def passes(self, lenses: Sequence[Camera], X_FC: Array) -> Mask:
        """Which of l lenses at p poses of the camera, shape (p, 4, 4), may meet the goal, shape (l p,); l or p is 1."""
        passed = self._possible(self.covered(lenses, X_FC, limits_only=True))
        rows = np.flatnonzero(passed)
        if len(rows):
            some = ([lenses[row] for row in rows.tolist()], X_FC) if len(lenses) > 1 else (lenses, X_FC[rows])
            passed[rows] = self._possible(self.covered(*some))
        return passed

    def covered(self, lenses: Sequence[Camera], X_FC: Array, *, limits_only: bool = False, every: bool = False) -> Mask:
        """Whether each sample is covered with each lens at each pose, shape (l p, m); l or p is 1.

        A pose is given up at the first decisive sample that it does not cover, unless `every` is looked at.
        """
        decisive = None if every else self._decisive[self._row]
        items = self.targets, self.states, self._row, self._target
        sees = self._cell.observer.seen_from(lenses, X_FC, *items, decisive=decisive, limits_only=limits_only)
        covered = np.tile(~self._hopeless, (len(lenses) * len(X_FC), 1))
        pose, item = np.nonzero(~sees.reshape(len(covered), len(self._row)))  # no column where the others see all
        covered[pose, self._row[item]] = False
        return covered

    def _possible(self, covered: Mask) -> Mask:
        """Whether the goal may be met if these samples are covered, shape (p, m); shape (p,).

        Between a covered and an uncovered sample all may be covered, so figures are bounds. Times are not looked at.
        """
        good: Mask = np.asarray(covered[:, self._decisive].all(axis=1))
        for least, whole, weight in self._qualities:
            good &= (covered[:, 1:] | covered[:, :-1]) @ weight >= (least - 1e-9) * whole
        for at, t, unknown in self._faults:  # a bound from below of the longest time without cover
            seen = covered[:, at] | unknown
            begins = ~seen & np.pad(seen, ((0, 0), (1, 0)), constant_values=True)[:, :-1]
            since = np.maximum.accumulate(np.where(begins, t, -np.inf), axis=1)
            good &= np.where(seen, 0.0, t - since).max(axis=1) <= (self._goal.delay or 0.0) + 1e-9
        return good


def _about_goal(goal: Goal, step: Analysis, samples: Samples) -> Indices:
    """The samples that a goal is about."""
    wanted = np.zeros(len(samples), dtype=bool)
    if goal.q_avg is not None:
        wanted |= np.array([bool(piece.literals) for piece in step.planned.stage.pieces])[samples.piece]
    if goal.q_eoi is not None:
        wanted |= step.planned.stage.of_interest(samples)
    for fault in step.planned.faults if goal.delay is not None else ():
        wanted |= _inside(step, fault, samples)
    return np.flatnonzero(wanted)


def _inside(step: Analysis, fault: str, samples: Samples) -> Mask:
    inside = np.zeros(len(samples), dtype=bool)
    for interval in fault_intervals(step.planned.formulas, fault):
        inside |= (samples.t >= interval.start) & (samples.t <= interval.end)
    return inside


def _thinned(samples: Samples, rows: Indices, most: int = MOST_SAMPLES) -> Indices:
    """So many of the rows at most, evenly in time, with the ends of every piece."""
    if len(rows) <= most:
        return rows
    some = samples.some(rows)
    even = np.searchsorted(some.t, np.linspace(some.t[0], some.t[-1], most), side="right") - 1
    thinned: Indices = rows[np.unique(np.concatenate([np.flatnonzero(some.ends), even]))]
    return thinned
