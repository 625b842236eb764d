"""What a page plays: a candidate's motion as predicted, or a run with what images showed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Literal

from sqrp_cli.document import Pose, Record
from sqrp_cli.figures import Qualities, falls_short
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.explanation import CandidateStudy, Formula, Sample, Span
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_study import mean_qualities, worst_seen

NOT = "not "
"""How a negated literal begins."""


@dataclass(frozen=True, kw_only=True)
class PlayedStep(Span, Qualities):
    """A step of a task of several, by its number and task, and when it is done [s]."""

    verdict: str
    """Where it is blind, why, and what would help."""
    seen_worst: bool
    """Whether it is the one that is seen worst; false where all are seen all the time."""


@dataclass(frozen=True, kw_only=True)
class PlayedCandidate(CandidateStudy):
    """A candidate without redundant data: corners of boxes, and poses of objects that never move.

    Of several steps, names of primitives, literals and faults begin with the number of the step, such as
    `2.hold(peg1)`, and times count from the start of the first.
    """

    still: Mapping[str, Pose]
    """Objects that never move, in the world."""
    played: tuple[PlayedStep, ...]
    """Of a task of several steps: each; else empty."""

    @classmethod
    def of_candidate(cls, study: CandidateStudy, played: tuple[PlayedStep, ...] = ()) -> PlayedCandidate:
        """What a page needs of a candidate."""
        first = study.samples[0].objects if study.samples else {}
        still = {name: X for name, X in first.items() if all(s.objects.get(name) == X for s in study.samples)}
        slim = {**vars(study), "samples": [_slim(sample, still) for sample in study.samples]}
        return cls(**slim, still=still, played=played)

    @classmethod
    def of_steps(cls, figures: CandidateResult, steps: Sequence[CandidateStudy]) -> PlayedCandidate:
        """What a page needs of a candidate of several steps, which follow each other without a pause."""
        starts = list(accumulate((step.time or 0.0 for step in steps), initial=0.0))
        shifts = [_Shift(f"{number}.", start) for number, start in enumerate(starts[:-1], 1)]
        pairs = list(zip(shifts, steps, strict=True))
        joined = CandidateStudy(
            **vars(figures),
            sampling=steps[0].sampling,
            primitives=[shift.span(one) for shift, step in pairs for one in step.primitives],
            formulas=[shift.formula(one) for shift, step in pairs for one in step.formulas],
            cameras=steps[0].cameras,
            without_camera={
                name: mean_qualities([step.without_camera[name] for step in steps], steps)
                for name in steps[0].without_camera
            },
            recovery=None,
            sights={},  # pages show none
            targets={shift.literal(name): one for shift, step in pairs for name, one in step.targets.items()},
            samples=[shift.sample(one) for shift, step in pairs for one in step.samples],
            hidden=[replace(one, literal=shift.literal(one.literal)) for shift, step in pairs for one in step.hidden],
            to_move=[],  # what to move is a matter of each step
        )
        return cls.of_candidate(joined, tuple(_played(figures, steps, starts)))


def _played(figures: CandidateResult, steps: Sequence[CandidateStudy], starts: Sequence[float]) -> Iterator[PlayedStep]:
    """The steps with their times; starts: of each, and the end of the last."""
    worst = worst_seen(steps)
    qualities = (steps[worst].q_eoi, steps[worst].q_avg)
    loses = any(quality is not None and falls_short(quality, 1.0) for quality in qualities)
    for index, (step, known) in enumerate(zip(steps, figures.steps or (), strict=True)):
        yield PlayedStep(
            name=f"{index + 1}: {known.task}",
            start=starts[index],
            end=starts[index + 1],
            q_eoi=step.q_eoi,
            q_avg=step.q_avg,
            verdict=step.verdict,
            seen_worst=index == worst and loses,
        )


@dataclass(frozen=True)
class _Shift:
    """Names and times of a step among several."""

    prefix: str
    start: float
    """When the step begins [s]."""

    def literal(self, name: str) -> str:
        """The name of a literal of the step."""
        negated = name.startswith(NOT)
        return f"{NOT if negated else ''}{self.prefix}{name.removeprefix(NOT)}"

    def span(self, span: Span) -> Span:
        """A primitive action of the step."""
        name = self.prefix + span.name
        return replace(span, name=name, start=self.start + span.start, end=self.start + span.end)

    def formula(self, formula: Formula) -> Formula:
        """A formula of the step."""
        return replace(
            formula,
            start=self.start + formula.start,
            end=self.start + formula.end,
            literals=list(map(self.literal, formula.literals)),
            fault=None if formula.fault is None else self.prefix + formula.fault,
        )

    def sample(self, sample: Sample) -> Sample:
        """An instant of the step."""
        literals = {self.literal(name): literal for name, literal in sample.literals.items()}
        return replace(sample, t=self.start + sample.t, literals=literals)


def _slim(sample: Sample, still: Mapping[str, Pose]) -> Sample:
    literals = {
        name: replace(literal, boxes=[replace(box, corners=None) for box in literal.boxes])
        for name, literal in sample.literals.items()
    }
    return replace(
        sample, objects={name: X for name, X in sample.objects.items() if name not in still}, literals=literals
    )


@dataclass(frozen=True, kw_only=True)
class Shown(Record):
    """What images showed of a literal."""

    covered: bool
    """Whether the images showed if it is true."""
    kind: str
    """`shown_true`, `shown_false`, or a word for nothing."""
    cause: None = None
    """Always null: images do not say why."""
    by: None = None
    """Always null."""


@dataclass(frozen=True, kw_only=True)
class ShownLiteral(Shown):
    """What the images of a time showed of a literal, of all cameras together and of each."""

    boxes: list[None]
    """Always empty: images count for all boxes together."""
    cameras: Mapping[str, Shown]
    """What the image of each camera showed, by the camera's name."""
    really: bool | None
    """The value in the simulation at that time."""


@dataclass(frozen=True, kw_only=True)
class ShownInstant(Record):
    """What the images of a time showed; they count until the next ones."""

    t: float
    """When the images were taken [s]."""
    covered: bool | None
    """Whether they showed every required literal; null where none is required."""
    kind: str
    """`known` if they showed every required literal, else `unknown`."""
    literals: Mapping[str, ShownLiteral]
    """What they showed of the required literals, by atom."""


@dataclass(frozen=True, kw_only=True)
class EndOfImages(Record):
    """From here on, no images count."""

    t: float
    """From when on [s]."""
    covered: None = None
    """Always null."""
    literals: Mapping[str, ShownLiteral]
    """Always empty."""


@dataclass(frozen=True, kw_only=True)
class Mark(Record):
    """A stretch of time [s] that is shown beside the coverage."""

    start: float
    """When it begins [s]."""
    end: float
    """When it ends [s]."""
    kind: Literal["unnoticed", "handled"]
    """Whether the fault is not seen yet, or the robot responds to it."""
    text: str
    """What is so meanwhile."""


@dataclass(frozen=True, kw_only=True)
class Marks(Record):
    """The stretches of a fault."""

    label: str
    """The fault, with the number of its step if there are several."""
    spans: list[Mark]
    """In order of time."""


@dataclass(frozen=True, kw_only=True)
class ShownMoment(Record):
    """A time [s] to look at."""

    t: float
    """When it is [s]."""
    text: str
    """What happens then."""


@dataclass(frozen=True, kw_only=True)
class Positions(Record):
    """Where everything really was, 25 times per second."""

    t: list[float]
    """The instants [s]."""
    joints: list[str]
    """Names of all joints."""
    q: list[list[float]]
    """Position of each joint at each instant [rad or m]."""
    held: list[str | None]
    """The object in the tool at each instant; null if there is none."""
    objects: Mapping[str, list[list[object]]]
    """Per object, the indices at which its pose changes, each with the pose."""


@dataclass(frozen=True, kw_only=True)
class PlayedRun(Record):
    """A run."""

    of_images: bool = True
    """Tells a run from a candidate."""
    time: float
    """Simulated [s]."""
    still: Mapping[str, Pose]
    """Always empty: objects are in `track`."""
    cameras: Mapping[str, Mapping[str, float]]
    """An empty entry for each camera, by its name."""
    primitives: list[Span]
    """The primitive actions, and in words what the robot does between them."""
    formulas: list[None]
    """Always empty."""
    targets: Mapping[str, Mapping[str, list[Mapping[str, object]]]]
    """By atom, its `boxes`, each with the times `from` and `to` between which images are searched there [s]."""
    marks: list[Marks]
    """The faults that happened or were seen."""
    moments: list[ShownMoment]
    """Times worth a look, in order."""
    note: str
    """What the playback shows, or why there is none in three dimensions."""
    samples: list[ShownInstant | EndOfImages]
    """What the images of each time showed, in order."""
    track: Positions | None
    """Null if the log does not say where everything was, or the workspace is not at hand."""
