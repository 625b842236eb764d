"""What a page plays of a candidate: its motion as predicted, nothing said twice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate

from sqrp_cli.document import Pose
from sqrp_cli.figures import Qualities, falls_short
from sqrp_cli.files.entries import from_fields
from sqrp_cli.logic.literal import NOT
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.explanation import ExplainedCandidate, Span
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_analysis import mean_qualities, worst_seen


@dataclass(frozen=True, kw_only=True)
class PlayedStep(Span, Qualities):
    """A step of a task of several, by its number and task, and when it is done [s]."""

    verdict: str
    """Where it is blind, why, and what would help."""
    seen_worst: bool
    """Whether it is the one that is seen worst; false where all are seen all the time."""


@dataclass(frozen=True, kw_only=True)
class PlayedCandidate(ExplainedCandidate):
    """A candidate without redundant data: corners of boxes, and poses of objects that never move.

    Of several steps, names of primitives, literals and faults begin with the number of the step, such as
    `2.hold(peg1)`, and times count from the start of the first.
    """

    still: Mapping[str, Pose]
    """Objects that never move, in the world."""
    played: tuple[PlayedStep, ...]
    """Of a task of several steps: each; else empty."""

    @classmethod
    def of_candidate(cls, analysis: ExplainedCandidate, played: tuple[PlayedStep, ...] = ()) -> PlayedCandidate:
        """What a page needs of a candidate."""
        first = analysis.samples[0].objects if analysis.samples else {}
        still = {name: X for name, X in first.items() if all(s.objects.get(name) == X for s in analysis.samples)}
        samples = []
        for sample in analysis.samples:
            literals = {
                name: replace(literal, boxes=[replace(box, corners=None) for box in literal.boxes])
                for name, literal in sample.literals.items()
            }
            objects = {name: X for name, X in sample.objects.items() if name not in still}
            samples.append(replace(sample, objects=objects, literals=literals))
        return cls(**{**vars(analysis), "samples": samples}, still=still, played=played)

    @classmethod
    def of_steps(cls, figures: CandidateResult, steps: Sequence[ExplainedCandidate]) -> PlayedCandidate:
        """What a page needs of a candidate of several steps, which follow each other without a pause."""
        starts = [*accumulate((step.time or 0.0 for step in steps), initial=0.0)]
        parts = [_later(step, f"{number}.", starts[number - 1]) for number, step in enumerate(steps, 1)]
        joined = ExplainedCandidate(
            **vars(figures),
            sampling=steps[0].sampling,
            primitives=[one for part in parts for one in part.primitives],
            formulas=[one for part in parts for one in part.formulas],
            cameras=steps[0].cameras,
            without_camera={
                name: mean_qualities((step.without_camera[name], step.t_total, step.t_eoi) for step in steps)
                for name in steps[0].without_camera
            },
            targets={name: one for part in parts for name, one in part.targets.items()},
            samples=[one for part in parts for one in part.samples],
            hidden=[one for part in parts for one in part.hidden],
        )
        worst, played = worst_seen(steps), []
        loses = any(q is not None and falls_short(q, 1.0) for q in (steps[worst].q_eoi, steps[worst].q_avg))
        for index, (step, known) in enumerate(zip(steps, figures.steps or (), strict=True)):
            span = {"name": f"{index + 1}: {known.task}", "start": starts[index], "end": starts[index + 1]}
            played.append(from_fields(PlayedStep, step, **span, seen_worst=index == worst and loses))
        return cls.of_candidate(joined, tuple(played))


def _later(step: ExplainedCandidate, prefix: str, start: float) -> ExplainedCandidate:
    """A step that begins later [s], with a prefix to its names: what pages show of it beside its figures."""

    def named(literal: str) -> str:
        return f"{NOT * literal.startswith(NOT)}{prefix}{literal.removeprefix(NOT)}"

    formulas, samples = [], []
    for one in step.formulas:
        fault, literals = None if one.fault is None else prefix + one.fault, list(map(named, one.literals))
        formulas.append(replace(one, start=start + one.start, end=start + one.end, literals=literals, fault=fault))
    for sample in step.samples:
        seen = {named(name): shown for name, shown in sample.literals.items()}
        samples.append(replace(sample, t=start + sample.t, literals=seen))
    return replace(
        step,
        primitives=[
            replace(one, name=prefix + one.name, start=start + one.start, end=start + one.end)
            for one in step.primitives
        ],
        formulas=formulas,
        targets={named(name): replace(one, says=f"{prefix} {one.says}") for name, one in step.targets.items()},
        samples=samples,
        hidden=[replace(one, literal=named(one.literal)) for one in step.hidden],
    )
