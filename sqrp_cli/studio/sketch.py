"""The coverage of one motion while a hand moves something: a verdict at fixed times, and only of what has moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np

from sqrp_cli.figures import Qualities
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.analysis_shown import verdict_shown
from sqrp_cli.show.documents.explanation import Verdict
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.study.sampling import FixedStep, first_samples
from sqrp_cli.study.timeline import PlannedMotion, SampledMotion, Timeline, observation_of
from sqrp_cli.study.whole_analysis import mean_quality

SHORTEST, MOST = 0.1, 250  # least time between the instants of a sketch [s], and about how many there are at most
_UNASKED: Any = None  # in place of whether an atom is covered, where no formula asks
_COLUMNS = ("cause", "by", "figure", "visible")  # of verdicts, each with a column for every camera
Matrix = tuple[tuple[BoxVerdicts, ...], ...]  # per target and box, the verdicts of cameras


@dataclass(frozen=True, kw_only=True)
class CoverageShown(Qualities):
    """What cameras see at instants of a motion."""

    t: list[float]
    """The instants [s]."""
    covered: list[bool | None]
    """Of the whole state; null where nothing is asked."""
    verdicts: list[Verdict]
    """Each different one once."""
    atoms: Mapping[str, Mapping[str, Any]]
    """By atom: `covered` at each instant, null where no formula asks, and `cameras`, by name which verdict at each."""
    blind: float
    """For how long the state is not covered [s]."""


@dataclass(frozen=True, eq=False)
class Sketch(SampledMotion):
    """A motion, with what every camera sees of it at fixed times."""

    cell: Cell

    @classmethod
    def of(cls, cell: Cell, planned: PlannedMotion) -> Sketch:
        """The sketch of a motion in a cell."""
        step = FixedStep(max(SHORTEST, planned.motion.time / MOST))
        return cls(planned, first_samples(step, planned.stage, cell.observer, planned.targets), cell)

    @cached_property
    def matrix(self) -> Matrix:
        """The verdicts of all cameras of its own cell."""
        return self.cell.observer.verdicts(self.planned.targets, self.states, shares=False)

    def seen_by(self, cell: Cell, camera: str | None = None) -> CoverageShown:
        """What the cameras of a cell see. camera: the only one that is not as in the sketch's own cell."""
        cameras, targets = cell.observer.cameras, self.planned.targets
        names = [one.name for one in cameras]
        matrix = self.matrix
        if camera is not None:
            at, merged = np.array(names) == camera, list[list[BoxVerdicts]]()
            observer = replace(cell.observer, cameras=(cameras[names.index(camera)],))
            for boxes, alone in zip(matrix, observer.verdicts(targets, self.states, shares=False), strict=True):
                merged.append([])
                for box, new in zip(boxes, alone, strict=True):
                    columns = {name: np.where(at, getattr(new, name), getattr(box, name)) for name in _COLUMNS}
                    merged[-1].append(BoxVerdicts(**columns))
            matrix = tuple(map(tuple, merged))
        elif cell is not self.cell:
            matrix = cell.observer.verdicts(targets, self.states, shares=False)
        observation = observation_of(matrix, targets, self.required)
        timeline = Timeline(self.planned, self.samples, observation)
        table: dict[Verdict, int] = {}
        atoms = {}
        for column, (target, boxes) in enumerate(zip(targets, matrix, strict=True)):
            covered = np.where(self.required[:, column], observation.covered[:, column], _UNASKED).tolist()
            called = [box.name if len(boxes) > 1 else None for box in target.boxes]
            # Each different verdict once, by one number of all that makes it: columns are sorted ten times as slowly.
            first, box_of = first_failing(boxes, np.arange(len(self.samples)))
            by = np.where(first.cause == Cause.NONE, 0, first.by).astype(np.int64)
            keys = (first.cause * (by.max(initial=0) + 2) + by + 1) * len(boxes) + box_of
            _, at, place = np.unique(keys, return_index=True, return_inverse=True)
            indices = []
            for row, eye in zip(*(one.tolist() for one in np.unravel_index(at, keys.shape)), strict=True):
                verdict = verdict_shown(cell.observer, first, row, eye, called[box_of[row, eye]])
                indices.append(table.setdefault(verdict, len(table)))
            rows = np.array(indices)[place.reshape(keys.shape)].T.tolist()
            atoms[str(target.atom)] = {"covered": covered, "cameras": dict(zip(names, rows, strict=True))}
        qualities, lost = timeline.qualities, observation.blind
        return CoverageShown(
            t=self.samples.t.tolist(),
            covered=np.where(timeline.monitored, timeline.covered, _UNASKED).tolist(),
            verdicts=list(table),
            atoms=atoms,
            q_avg=qualities.q_avg,
            q_eoi=qualities.q_eoi,
            blind=float(self.samples.gaps[lost[1:] & lost[:-1]].sum()),
        )


def joined(sketches: Sequence[Sketch], parts: Sequence[CoverageShown]) -> CoverageShown:
    """What is seen of the steps of a task, which follow each other without a pause; atoms are called as pages do."""
    if len(parts) == 1:
        return parts[0]
    motions = [sketch.planned for sketch in sketches]
    starts = accumulate((sketch.planned.motion.time for sketch in sketches[:-1]), initial=0.0)
    verdicts: list[Verdict] = []
    atoms: dict[str, Mapping[str, Any]] = {}
    before, count = 0, sum(len(part.t) for part in parts)
    for number, part in enumerate(parts, 1):
        after = count - before - len(part.t)
        for atom, shown in part.atoms.items():
            cameras = {
                name: [0] * before + [len(verdicts) + row for row in rows] + [0] * after
                for name, rows in shown["cameras"].items()
            }
            covered = [None] * before + shown["covered"] + [None] * after
            atoms[f"{number}.{atom}"] = {"covered": covered, "cameras": cameras}
        verdicts += part.verdicts
        before += len(part.t)
    return CoverageShown(
        t=[start + t for start, part in zip(starts, parts, strict=True) for t in part.t],
        covered=[value for part in parts for value in part.covered],
        verdicts=verdicts,
        atoms=atoms,
        q_avg=mean_quality([(part.q_avg, planned.T) for part, planned in zip(parts, motions, strict=True)]),
        q_eoi=mean_quality([(part.q_eoi, planned.T_eoi) for part, planned in zip(parts, motions, strict=True)]),
        blind=sum(part.blind for part in parts),
    )
