"""Why each camera does not see each target: at a sample, in total, and over time.

`Coverage` is a record of it to store and compare.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from typing import Annotated, cast

import numpy as np
from pydantic import Field, PlainSerializer

from sqrp_cli.figures import Seconds
from sqrp_cli.files.entries import FileRecord, SerializedAs
from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import TimeInterval, merge
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import Cause, CauseLabel, Reason
from sqrp_cli.sight.observer import first_failing
from sqrp_cli.skill.target_box import fact_words
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.result import UnseenTime


def cause_totals(cell: Cell, analysis: Analysis) -> tuple[UnseenTime, ...]:
    """Totals of every literal, camera and cause, the longest first within each literal."""
    weights = sample_weights(analysis)
    observation = analysis.timeline.observation
    totals = []
    for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
        rows = np.flatnonzero(observation.required[:, column])
        first, box_of = first_failing(boxes, rows)
        sums: dict[tuple[int, ...], float] = defaultdict(float)
        camera, at = np.nonzero(first.cause.T != Cause.NONE)
        kinds = np.stack([camera, *(values[at, camera] for values in (first.cause, first.by, box_of))], axis=1)
        for kind, weight in zip(kinds.tolist(), weights[rows[at]].tolist(), strict=True):
            sums[tuple(kind)] += weight
        found = [
            UnseenTime(
                literal=str(target.atom),
                camera=cell.observer.cameras[index].name,
                cause=cast("CauseLabel", Cause(cause).label),
                by=cell.observer.by_name(Cause(cause), by),
                seconds=seconds,
                box=target.boxes[box].name if len(target.boxes) > 1 else None,
            )
            for (index, cause, by, box), seconds in sums.items()
            if seconds > 0
        ]
        totals += sorted(found, key=lambda total: -total.seconds)
    return tuple(totals)


ByPhase = Mapping[str, Mapping[str, Mapping[str, float]]]
"""A share for each phase, by the name of a camera, by atom."""


def coverage_by_phase(cell: Cell, analysis: Analysis) -> tuple[ByPhase, tuple[UnseenTime, ...]]:
    """How much of each phase every camera sees each target, as far as it must be seen, and what it does not for.

    The second has for each phase, camera and target the cause that takes most of the time.
    """
    timeline, primitives = analysis.timeline, analysis.planned.motion.primitives
    weights, observation = sample_weights(analysis), timeline.observation
    phase = np.array([piece.primitive for piece in timeline.request.stage.pieces])[timeline.samples.piece]
    shares: dict[str, dict[str, dict[str, float]]] = {}
    causes = list[UnseenTime]()
    for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
        atom = str(target.atom)
        shares[atom] = {camera.name: {} for camera in cell.observer.cameras}
        for number, one in enumerate(primitives):
            rows = np.flatnonzero(observation.required[:, column] & (phase == number))
            if not (total := float(weights[rows].sum())):
                continue
            first, _ = first_failing(boxes, rows)
            for index, camera in enumerate(cell.observer.cameras):
                kinds, which = np.unique(
                    np.stack([first.cause[:, index], first.by[:, index]]), axis=1, return_inverse=True
                )
                lasts, seen = np.bincount(which.ravel(), weights=weights[rows]), kinds[0] == Cause.NONE
                shares[atom][camera.name][one.name] = float(lasts[seen].sum() / total)
                lost = np.where(seen, 0.0, lasts)
                worst = int(lost.argmax())
                if lost[worst] > 0.0:
                    cause = Cause(int(kinds[0, worst]))
                    causes.append(
                        UnseenTime(
                            literal=atom,
                            camera=camera.name,
                            cause=cast("CauseLabel", cause.label),
                            by=cell.observer.by_name(cause, int(kinds[1, worst])),
                            seconds=float(lost[worst]),
                            phase=one.name,
                        )
                    )
    return shares, tuple(causes)


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
    """The atom in words; baselines of earlier versions lack it."""

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
