"""`explain`: a candidate with all data from which its figures can be recomputed, and what it asks for over time.

Nothing here computes: `documents.analysis_shown` makes these records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from sqrp_cli.document import LEFT_OUT, Pose, Record, TaskDocument, how_many, live
from sqrp_cli.figures import Qualities
from sqrp_cli.logic.image_time import Window
from sqrp_cli.logic.literal import NOT
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import HidingPart, Reason
from sqrp_cli.study.result import CandidateResult, FreeView, FreeViews, HiddenTarget, SamplingDone, UnseenTime

if TYPE_CHECKING:
    from sqrp_cli.camera.camera import Camera
    from sqrp_cli.study.pipeline import Explained
else:  # no file has it
    Explained = Any


@dataclass(frozen=True, kw_only=True)
class Span(Record):
    """A primitive action and when it is done [s]."""

    name: str
    """As in the skill."""
    start: float
    """From the start of the motion [s]."""
    end: float
    """From the start of the motion [s]."""
    does: str | None = field(default=None, metadata=LEFT_OUT)
    """What it does, in a word or two."""


@dataclass(frozen=True, kw_only=True)
class Formula(Record):
    """A temporal operator with its interval [s]."""

    text: str
    """The operator with its body, about the objects of the candidate."""
    operator: str
    """`always` or `eventually`."""
    start: float
    """Start of the closed interval, from the start of the motion [s]."""
    end: float
    """Its end, from the start of the motion [s]."""
    literals: list[str]
    """What must be seen throughout the interval: literals of the body outside deeper temporal operators."""
    fault: str | None
    """The fault that the formula describes, if any."""


@dataclass(frozen=True, kw_only=True)
class CameraTiming(Record):
    """When a camera has images."""

    rate: float
    """Images per second [Hz]."""
    latency: float
    """From exposure to the image being available [s]."""

    @classmethod
    def of(cls, camera: Camera) -> CameraTiming:
        """That of a camera."""
        return cls(rate=camera.rate, latency=camera.lag)


@dataclass(frozen=True, kw_only=True)
class RecoveryTimes(Record):
    """Time to stop and move back to the start, from given instants; linear in between."""

    t: list[float]
    """Instants at which the robot is to stop, from the start of the motion [s]."""
    duration: list[float]
    """From each of them until the robot is back at the start [s]."""


@dataclass(frozen=True, kw_only=True)
class ExplainedBox(Record):
    """A box: where to look, and what for."""

    name: str
    """As in the skill."""
    detector: str
    """Name of the detector in the workspace that looks for it."""
    normal: tuple[float, ...] | None
    """Unit vector in the box's own axes, away from the surface."""
    encloses: tuple[str, ...]
    """What is transparent to this box."""
    min_visible: float
    """Least share of the box that must be seen, in 0..1, from its detector."""
    frame: str
    """What the box moves with: `world`, a link or an object; `OBJECT@start` stays where the object was at the start."""
    size: tuple[float, ...]
    """Full extents [m]."""
    pose: Pose
    """Of the box in `frame`."""


@dataclass(frozen=True, kw_only=True)
class TargetBoxes(Record):
    """What decides a literal."""

    k: int
    """Cameras that must each see all boxes."""
    says: str
    """What the literal says without `not`, in words, such as `the tool holds g1`."""
    boxes: list[ExplainedBox]
    """Where to look; all of them decide the literal together."""


@dataclass(frozen=True, kw_only=True)
class SightOnset(Record):
    """From when on images show a fault that happens at a time x, at points in order; linear in between."""

    x: list[float]
    """When it happens [s]."""
    shown: list[float]
    """From when on images surely show it [s]."""
    usual: list[float]
    """From when on they usually show it [s]."""


@dataclass(frozen=True, kw_only=True)
class FaultSight(Record):
    """When images show a fault."""

    windows: list[Window]
    """In which they show it; those of cameras of one rate and latency in order, apart from each other."""
    onsets: list[SightOnset]
    """Of each interval in which it may happen."""


@dataclass(frozen=True, kw_only=True)
class Verdict(Reason):
    """Whether a camera covers all boxes of a target."""

    covered: bool
    """Whether no limit fails."""


@dataclass(frozen=True, kw_only=True)
class BoxSight(Record):
    """What the curve of a detector says of a box in an image, and what from."""

    probability: float
    """That the detector sees it, in 0..1; 0 where it fails a limit that the curve does not replace."""
    pixels: float | None
    """Its size in the image: square root of its area [pixels]; null where the probability is 0 by such a limit."""
    incidence: float | None
    """Angle between its normal and the direction to the camera [rad]; 0 without a normal."""
    distance: float | None
    """From the camera to its centre [m]."""
    visible: float | None
    """Share of its silhouette that nothing hides, in 0..1."""
    blur: float | None
    """How far its centre moves in the image while the shutter is open [pixels]."""


@dataclass(frozen=True, kw_only=True)
class BoxVerdict(Verdict):
    """Whether a camera covers a box."""

    visible: float | None
    """Visible share of the box's silhouette; null if an earlier limit failed."""
    hidden_by: Sequence[HidingPart] | None = field(default=None, metadata=LEFT_OUT)
    """Of a hidden box: what every part hides, the largest share first. The shares add up to 1 - `visible`."""
    sight: BoxSight | None = field(default=None, metadata=LEFT_OUT)
    """How likely its detector sees it; left out where the detector has no curve."""


@dataclass(frozen=True, kw_only=True)
class BoxCoverage(Record):
    """A box at an instant."""

    corners: list[list[float]] | None = field(default=None, metadata=LEFT_OUT)
    """The 8 corners in the world [m], x slowest, z fastest."""
    cameras: Mapping[str, BoxVerdict]
    """The verdict of each camera, by its name."""


@dataclass(frozen=True, kw_only=True)
class LiteralCoverage(Record):
    """A literal at an instant."""

    covered: bool
    """Whether enough cameras cover all its boxes."""
    boxes: list[BoxCoverage]
    """In the order of `targets[LITERAL].boxes`."""
    cameras: Mapping[str, Verdict]
    """The verdict of each camera on all boxes, by its name: that on the first box it does not cover."""
    expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show it; left out where no detector has a curve."""


@dataclass(frozen=True, kw_only=True)
class Sample(Record):
    """An instant. At a change there are two samples of equal t, before and after it."""

    t: float
    """From the start of the motion [s]; twice where literals, the held object or the motion law change."""
    q: Mapping[str, float]
    """Position of every movable joint [rad or m]."""
    objects: Mapping[str, Pose]
    """In the world."""
    held: str | None
    """The object in the tool; null if there is none."""
    covered: bool | None
    """Null where no formula requires anything."""
    event: bool
    """Whether it lies in an event of interest."""
    literals: Mapping[str, LiteralCoverage]
    """What formulas require to be seen at this instant, by literal."""
    expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show all of them; left out where none is required, or no detector has a curve."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ExplainedCandidate(CandidateResult):
    """A candidate over time; of an infeasible one the lists are empty."""

    sampling: SamplingDone | None = None
    """How the motion was sampled; null if the candidate is infeasible."""
    primitives: Sequence[Span] = ()
    """In the order in which they are done."""
    formulas: Sequence[Formula] = ()
    """One entry for each temporal operator of the skill's formulas."""
    cameras: Mapping[str, CameraTiming] = field(default_factory=dict)
    """By the camera's name."""
    without_camera: Mapping[str, Qualities] = field(default_factory=dict)
    """The qualities if this camera fails."""
    recovery: RecoveryTimes | None = None
    """How long a stop and the way back take; null if the candidate is infeasible."""
    sights: Mapping[str, FaultSight] = field(default_factory=dict)
    """When images show each fault, by its name."""
    targets: Mapping[str, TargetBoxes] = field(default_factory=dict)
    """By literal, for every literal of `formulas`."""
    samples: Sequence[Sample] = ()
    """The sampled instants in the order of time."""
    unseen_times: Sequence[UnseenTime] = ()
    """Why each camera does not see each literal, the longest time first within each literal."""
    coverage: Mapping[str, Mapping[str, Mapping[str, float]]] | None = field(default=None, metadata=LEFT_OUT)
    """Of a recorded episode: by literal, camera and phase, the share of the time in which the camera sees it, in 0..1,
    as far as it must be seen then."""
    coverage_causes: Sequence[UnseenTime] = field(default=(), metadata=LEFT_OUT)
    """What takes most of the time in which it does not."""
    windows: Sequence[FreeView] | None = field(default=None, metadata=LEFT_OUT)
    """With `--windows`: those that are long enough."""
    free_views: FreeViews | None = field(default=None, metadata=LEFT_OUT)
    """With `--windows`: of all of them."""
    hidden: Sequence[HiddenTarget] = ()
    """Who is in the way: of each literal, from each camera that it is hidden from."""
    to_move: Sequence[HidingPart] = ()
    """Objects in the way that the task does not handle, the largest `alone` first: the one to move first. Shares are of
    all that is hidden, from any camera, while too few see the target. Empty if only the robot is in the way."""
    assumed: str = ""
    """What delays assume of the cameras, in words; empty where all state their latency."""

    @property
    def says(self) -> Mapping[str, str]:
        """What each atom says, in words."""
        return {name.removeprefix(NOT): target.says for name, target in self.targets.items()}

    def found_of(self, atom: str) -> list[LiteralCoverage | None]:
        """What is found of an atom in each sample; None where neither it nor its negation must be seen."""
        return [one.literals.get(atom) or one.literals.get(f"{NOT}{atom}") for one in self.samples]


@dataclass(frozen=True, kw_only=True, repr=False)
class Explanation(ExplainedCandidate, TaskDocument):
    """What `sqrp explain` finds about one candidate.

    Of a task of several steps it is about one step; `rank` and `pareto` are those of all steps together.
    """

    VIEW = "sqrp_cli.show.terminal.timeline_chart:print_explanation"

    document: Literal["explain"] = "explain"
    task: str
    """As it was asked for."""
    step: int | None = field(default=None, metadata=LEFT_OUT)
    """Which step, from 1: of a task of several, or of a program."""
    of_steps: int | None = field(default=None, metadata=LEFT_OUT)
    """How many steps there are."""
    whole: str | None = field(default=None, metadata=LEFT_OUT)
    """The name of the candidate of all steps; left out in a program, which has no ranking."""

    explained: Explained | None = live()
    """With the analysis behind it."""
    ranking: Sequence[CandidateResult] = live(())
    """All candidates of the task, best first."""

    __repr__ = TaskDocument.__repr__

    @property
    def candidates(self) -> tuple[Explanation]:
        """The only one, as `ExplainedAll` has several."""
        return (self,)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.task} in {self.workspace}: {super().brief}"


@dataclass(frozen=True, kw_only=True, repr=False)
class ExplainedAll(TaskDocument):
    """What `sqrp explain --all` finds."""

    VIEW = "sqrp_cli.show.terminal.timeline_chart:print_comparison"

    document: Literal["explain --all"] = "explain --all"
    candidates: list[ExplainedCandidate]
    """The requested candidates, best first, infeasible ones last."""

    explained: Sequence[Explained] = live(())
    """With the analyses behind them."""
    ranking: Sequence[CandidateResult] = live(())
    """All candidates of the task, best first."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.task} in {self.workspace}: {how_many(self.candidates, 'candidate')}"
