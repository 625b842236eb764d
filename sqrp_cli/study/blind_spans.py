"""Why each camera does not see each target: at a sample, in total, and over time; and when it sees all at once.

`Coverage` is a record of it to store and compare.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from math import ceil
from typing import Annotated, cast

import numpy as np
from pydantic import Field, PlainSerializer

from sqrp_cli.figures import Seconds
from sqrp_cli.files.entries import FileRecord, SerializedAs
from sqrp_cli.geometry import Array, Indices
from sqrp_cli.logic.formula_time import TimeInterval, merge
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import Cause, CauseLabel, Reason
from sqrp_cli.sight.observer import first_failing, sees_all
from sqrp_cli.skill.target_box import fact_words
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.result import FreeView, FreeViews, UnseenTime
from sqrp_cli.study.verdict import stretches


def cause_totals(cell: Cell, analysis: Analysis) -> tuple[UnseenTime, ...]:
    """Totals of every literal, camera and cause, the longest first within each literal."""
    required = analysis.timeline.observation.required
    each = (_totals(cell, analysis, column, np.flatnonzero(rows)) for column, rows in enumerate(required.T))
    return tuple(total for totals in each for total in totals)


def _totals(
    cell: Cell, analysis: Analysis, column: int, rows: Indices, phase: str | None = None
) -> Sequence[UnseenTime]:
    """For how long each camera does not see a target at some samples, for each cause, the longest first.

    column: of the target. phase: in which they are, if that counts; then not for each box.
    """
    target, boxes = analysis.planned.targets[column], analysis.timeline.observation.full_matrix[column]
    weights, sums = sample_weights(analysis)[rows], defaultdict[tuple[int, ...], float](float)
    first, box_of = first_failing(boxes, rows)
    each_box = phase is None and len(target.boxes) > 1
    camera, at = np.nonzero(first.cause.T != Cause.NONE)
    kinds = np.stack([camera, *(one[at, camera] for one in (first.cause, first.by, box_of * each_box))], axis=1)
    for kind, weight in zip(kinds.tolist(), weights[at].tolist(), strict=True):
        sums[tuple(kind)] += weight
    found = [
        UnseenTime(
            literal=str(target.atom),
            camera=cell.observer.cameras[index].name,
            cause=cast("CauseLabel", Cause(cause).label),
            by=cell.observer.by_name(Cause(cause), by),
            seconds=seconds,
            box=target.boxes[box].name if each_box else None,
            phase=phase,
        )
        for (index, cause, by, box), seconds in sums.items()
        if seconds > 0
    ]
    return sorted(found, key=lambda total: -total.seconds)


ByPhase = Mapping[str, Mapping[str, Mapping[str, float]]]  # A share for each phase, by the name of a camera, by atom


def coverage_by_phase(cell: Cell, analysis: Analysis) -> tuple[ByPhase, tuple[UnseenTime, ...]]:
    """How much of each phase every camera sees each target, as far as it must be seen, and what it does not for.

    The second has for each phase, camera and target the cause that takes most of the time.
    """
    timeline, cameras = analysis.timeline, [camera.name for camera in cell.observer.cameras]
    weights, observation = sample_weights(analysis), timeline.observation
    phase = np.array([piece.primitive for piece in timeline.planned.stage.pieces])[timeline.samples.piece]
    shares: dict[str, dict[str, dict[str, float]]] = {}
    causes = list[UnseenTime]()
    for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
        of_cameras, sees = shares.setdefault(str(target.atom), {name: {} for name in cameras}), sees_all(boxes)
        for number, one in enumerate(analysis.planned.motion.primitives):
            rows = np.flatnonzero(observation.required[:, column] & (phase == number))
            if total := float(weights[rows].sum()):
                worst = {why.camera: why for why in _totals(cell, analysis, column, rows, one.name)[::-1]}
                causes += [worst[name] for name in cameras if name in worst]
                for name, seen in zip(cameras, sees[rows].T, strict=True):
                    of_cameras[name][one.name] = float(weights[rows][seen].sum() / total)
    return shares, tuple(causes)


def free_views(cell: Cell, analysis: Analysis, needed: float) -> tuple[tuple[FreeView, ...], FreeViews]:
    """The free views of a motion that are long enough, in order of time, and what is to be said of all.

    The verdicts of every camera are known; needed: how long one has to be [s]. A free view begins with the first and
    ends with the last of neighbouring samples in which the camera sees all that the state requires; changes between
    samples are located as the sampling says.
    """
    timeline = analysis.timeline
    t, observation = timeline.samples.t, timeline.observation
    sees = np.array([sees_all(boxes) for boxes in observation.full_matrix])  # (targets, m, cameras)
    free = (sees | ~observation.required.T[:, :, None]).all(axis=0) & timeline.monitored[:, None]
    each = [
        FreeView(start=float(t[rows[0]]), end=float(t[rows[-1]]), cameras=(camera.name,))
        for index, camera in enumerate(cell.observer.cameras)
        for rows in stretches(free[:, index])
    ]
    lasts = {one: one.end - one.start for one in each}
    enough = sorted((one for one in each if lasts[one] >= needed - 1e-9), key=lambda one: (one.start, one.cameras))
    longest = dict.fromkeys((camera.name for camera in cell.observer.cameras), 0.0)
    longest |= {one.cameras[0]: lasts[one] for one in sorted(each, key=lasts.__getitem__)}
    nearest = None if enough else max(each, key=lambda one: (lasts[one], -one.start), default=None)
    need = f"{1000 * needed:.0f} ms"
    times = len(merge(TimeInterval(one.start, one.end) for one in enough))  # of one camera after the other or several
    words = f"{times} time{'s' * (times != 1)} all that must be seen is in free view of a camera for {need}."
    if nearest is not None:
        missing = ceil(1000 * (needed - lasts[nearest]) - 1e-6)  # rounded, it might be too short
        wait = f"wait {missing} ms at {0.5 * (nearest.start + nearest.end):.3f} s"
        words = f"Never for {need}; to open a window, {wait}, in view of camera `{nearest.cameras[0]}`."
    elif not enough:
        words = f"Never for {need}: at no instant does one camera see all at once, so no wait helps; see advise."
    return tuple(enough), FreeViews(needed=needed, longest=longest, wait=nearest, words=words)


def sample_weights(analysis: Analysis) -> Array:
    """Weight of each sample in time [s], shape (m,); they add up to the duration of the motion."""
    gaps = analysis.timeline.samples.gaps
    weights: Array = 0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps))
    return weights


_Ends = Annotated[
    TimeInterval,
    SerializedAs(
        tuple[Seconds, Seconds], lambda ends: TimeInterval(*ends), lambda one: (round(one.start, 3), round(one.end, 3))
    ),
]
"""A file has start and end of a stretch, to 1 ms."""

BlindSpan = Annotated[
    tuple[TimeInterval, Reason],
    SerializedAs(
        tuple[Seconds, Seconds, CauseLabel, str | None],
        lambda said: (TimeInterval(*said[:2]), Reason(cause=said[2], by=said[3])),
        lambda span: (round(span[0].start, 3), round(span[0].end, 3), span[1].cause, span[1].by),
    ),
]
"""A stretch of time in which a camera does not see a target for one cause.

A file has start and end, the cause and what is in the way.
"""


@dataclass(frozen=True)
class TargetCoverage(FileRecord):
    """The coverage of an atom's target."""

    needed: Annotated[int, Field(ge=1)]
    """Number of cameras that must see it."""
    required: tuple[_Ends, ...]
    """When it must be observable."""
    blind: Mapping[str, tuple[BlindSpan, ...]]
    """Per camera, in order of time and without overlap, when it does not see the required target."""
    says: str = ""
    """The atom in words."""

    def seen_by(self, camera: str) -> tuple[TimeInterval, ...]:
        """When a camera sees it; never if there is no such camera."""
        if camera not in self.blind:
            return ()
        return difference(self.required, [stretch for stretch, _ in self.blind[camera]])

    @property
    def covered(self) -> tuple[TimeInterval, ...]:
        """When enough cameras see it."""
        seen = [self.seen_by(camera) for camera in self.blind]
        edges = sorted({edge for some in (self.required, *seen) for s in some for edge in (s.start, s.end)})
        parts = []
        for start, end in pairwise(edges):
            t = 0.5 * (start + end)
            asked, *sees = (any(one.start <= t <= one.end for one in some) for some in (self.required, *seen))
            if asked and sum(sees) >= self.needed:
                parts.append(TimeInterval(start, end))
        return merge(parts)


@dataclass(frozen=True)
class Coverage(FileRecord):
    """The coverage of a candidate over time."""

    primitives: Mapping[str, Annotated[Seconds, PlainSerializer(lambda end: round(end, 3))]]
    """When each ends, by name [s]."""
    targets: Mapping[str, TargetCoverage]
    """By atom."""


def coverage_of(cell: Cell, analysis: Analysis) -> Coverage:
    """The coverage in a full analysis.

    Between neighbouring samples of equal verdict that verdict holds; between others the target counts as not seen.
    """
    planned, observation, samples = analysis.planned, analysis.timeline.observation, analysis.timeline.samples
    pieces, objects, targets = planned.stage.pieces, cell.workspace.objects, dict[str, TargetCoverage]()
    for column, (target, boxes) in enumerate(zip(planned.targets, observation.full_matrix, strict=True)):
        rows = np.flatnonzero(observation.required[:, column])
        numbers = dict.fromkeys(samples.piece[rows].tolist())
        required = merge(TimeInterval(pieces[number].start, pieces[number].end) for number in numbers)
        first, _ = first_failing(boxes, rows)
        t, piece, blind = samples.t[rows].tolist(), samples.piece[rows].tolist(), {}
        for index, camera in enumerate(cell.observer.cameras):
            failures, spans = list(zip(first.cause[:, index].tolist(), first.by[:, index].tolist(), strict=True)), []
            for (code, by), group in groupby(range(len(t)), key=failures.__getitem__):
                own = list(group)
                # Around the samples at which it fails, up to the neighbours at which it does not.
                start, end, before, after = t[own[0]], t[own[-1]], own[0] - 1, own[-1] + 1
                if before >= 0 and failures[before][0] == Cause.NONE and piece[before] == piece[own[0]]:
                    start = t[before]
                if after < len(t) and piece[after] == piece[own[-1]]:
                    end = t[after]
                cause = Cause(code)
                if cause is not Cause.NONE and end > start:
                    spans.append(
                        (TimeInterval(start, end), Reason(cause=cause.label, by=cell.observer.by_name(cause, by)))
                    )
            blind[camera.name] = tuple(spans)
        targets[str(target.atom)] = TargetCoverage(
            target.cameras, required, blind, fact_words(str(target.atom), target.boxes, objects)
        )
    return Coverage({primitive.name: primitive.end for primitive in planned.motion.primitives}, targets)


def coverage_of_steps(steps: Sequence[Coverage]) -> Coverage:
    """The coverage over several steps that follow each other without a pause.

    Names of primitives and atoms begin with the number of their step, such as `2.hold(peg1)`.
    """
    primitives: dict[str, float] = {}
    targets: dict[str, TargetCoverage] = {}
    for number, step in enumerate(steps, 1):
        start = max(primitives.values(), default=0.0)
        primitives |= {f"{number}.{name}": start + end for name, end in step.primitives.items()}
        for atom, target in step.targets.items():
            required = tuple(TimeInterval(start + one.start, start + one.end) for one in target.required)
            blind = {
                camera: tuple((TimeInterval(start + one.start, start + one.end), why) for one, why in spans)
                for camera, spans in target.blind.items()
            }
            targets[f"{number}.{atom}"] = TargetCoverage(target.needed, required, blind, target.says)
    return Coverage(primitives, targets)


def difference(stretches: Sequence[TimeInterval], without: Sequence[TimeInterval]) -> tuple[TimeInterval, ...]:
    """The parts of `stretches` outside those `without`; both in order of time and without overlap."""
    parts = []
    for stretch in stretches:
        start = stretch.start
        for hole in without:
            if hole.end <= start or hole.start >= stretch.end:
                continue
            if hole.start > start:
                parts.append(TimeInterval(start, hole.start))
            start = max(start, hole.end)
        if start < stretch.end:
            parts.append(TimeInterval(start, stretch.end))
    return tuple(parts)


def intersection(stretches: Sequence[TimeInterval], others: Sequence[TimeInterval]) -> tuple[TimeInterval, ...]:
    """The parts of `stretches` inside the others."""
    return difference(stretches, difference(stretches, others))
