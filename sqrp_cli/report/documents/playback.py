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
