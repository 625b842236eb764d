"""What a page plays: a candidate's motion as predicted, or a run with what images showed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from sqrp_cli.report.documents.document import Pose, Record
from sqrp_cli.report.documents.explanation import CandidateStudy, Sample, Span


@dataclass(frozen=True, kw_only=True)
class PlayedCandidate(CandidateStudy):
    """A candidate without redundant data: corners of boxes, and poses of objects that never move."""

    still: Mapping[str, Pose]
    """Objects that never move, in the world."""

    @classmethod
    def of_candidate(cls, study: CandidateStudy) -> PlayedCandidate:
        """What a page needs of a candidate."""
        first = study.samples[0].objects if study.samples else {}
        still = {name: X for name, X in first.items() if all(s.objects[name] == X for s in study.samples)}
        slim = {**vars(study), "samples": [_slim(sample, still) for sample in study.samples]}
        return cls(**slim, still=still)


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
    """What images showed of a literal: `shown_true`, `shown_false`, or a word for nothing."""

    covered: bool
    kind: str
    cause: None = None
    by: None = None


@dataclass(frozen=True, kw_only=True)
class ShownLiteral(Shown):
    """What the images of a time showed of a literal, of all cameras together and of each."""

    boxes: list[None]
    cameras: Mapping[str, Shown]
    really: bool | None
    """The value in the simulation at that time."""


@dataclass(frozen=True, kw_only=True)
class ShownInstant(Record):
    """What the images of a time showed; they count until the next ones."""

    t: float
    covered: bool | None
    """Whether they showed every required literal; null where none is required."""
    kind: str
    literals: Mapping[str, ShownLiteral]


@dataclass(frozen=True, kw_only=True)
class EndOfImages(Record):
    """From here on, no images count."""

    t: float
    covered: None = None
    literals: Mapping[str, ShownLiteral]


@dataclass(frozen=True, kw_only=True)
class Mark(Record):
    """A stretch of time [s] that is shown beside the coverage."""

    start: float
    end: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Marks(Record):
    """The stretches of a fault."""

    label: str
    spans: list[Mark]


@dataclass(frozen=True, kw_only=True)
class ShownMoment(Record):
    """A time [s] to look at."""

    t: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Positions(Record):
    """Where everything really was, 25 times per second."""

    t: list[float]
    joints: list[str]
    q: list[list[float]]
    held: list[str | None]
    objects: Mapping[str, list[list[object]]]
    """Per object, the indices at which its pose changes, each with the pose."""


@dataclass(frozen=True, kw_only=True)
class PlayedRun(Record):
    """A run."""

    of_images: bool = True
    time: float
    still: Mapping[str, Pose]
    cameras: Mapping[str, Mapping[str, float]]
    primitives: list[Span]
    formulas: list[None]
    targets: Mapping[str, Mapping[str, list[Mapping[str, object]]]]
    marks: list[Marks]
    moments: list[ShownMoment]
    note: str
    samples: list[ShownInstant | EndOfImages]
    track: Positions | None
