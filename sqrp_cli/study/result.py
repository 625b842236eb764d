"""What is found of candidates, said once: the records that ranking sorts, `--json` prints, tables and pages read.

SI units, radians, shares in 0..1. Nothing here computes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal, get_args

from sqrp_cli.document import LEFT_OUT, Record, TaskDocument, how_many, live
from sqrp_cli.figures import NO_FIGURES, Figures, Qualities
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import CauseLabel, HidingPart, Reason

if TYPE_CHECKING:
    from pathlib import Path

    from sqrp_cli.task.candidate import Candidate
else:  # no file has it
    Candidate = Any

Criterion = Literal["q_eoi", "q_avg", "time", "delay", "expected_time"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)
NOTHING_MISSING = "Everything that must be seen is seen"  # What the verdict says of a candidate without a blind spot


@dataclass(frozen=True, kw_only=True)
class WayFigures(Qualities):
    """One way of doing what a candidate says."""

    parameters: Mapping[str, float | str]
    """Those of the candidate, with a value for each that it leaves free."""
    vias: Mapping[str, list[list[float]]]
    """By the name of a joint move, the joint positions that it bends around, in the order of the arm's joints; direct
    moves have none [rad or m]."""
    time: float
    """Duration of the whole motion [s]."""
    delay_worst: float | None
    """The longest time that any fault may remain unnoticed [s]; null without faults, and where one may never be
    noticed."""
    unseen: float | None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
    words: str = ""
    """What it says beyond its candidate, such as `shoulder left, wrist flipped`."""


@dataclass(frozen=True, kw_only=True)
class BlindEnd(Record):
    """An end of a joint move at which the cameras do not cover the state, whatever the path of the move."""

    primitive: str
    """Name of the joint move."""
    at: str
    """The waypoint there."""
    seconds: float
    """How long the state is not covered between there and where the cameras see it first [s]; the whole move, named
    where it begins, if they never do."""


@dataclass(frozen=True, kw_only=True)
class WaysFound(Record):
    """The ways of doing what a candidate says."""

    tried: int
    """How many there are, by all that the candidate leaves free."""
    feasible: int
    """How many of them can be done, within `--max-time` if that is given."""
    pareto: tuple[WayFigures, ...]
    """The way that the candidate's own figures are about, then the others that are Pareto-optimal in q_eoi, q_avg and
    time, the best first."""
    blind_ends: tuple[BlindEnd, ...] = ()
    """The ends of joint moves that no path can make seen, of the first way; empty if all paths have to be direct."""


@dataclass(frozen=True, kw_only=True)
class PhaseSeen(Record):
    """A phase of a recorded episode, and how much is seen in it."""

    name: str
    """approach, grasp, carry, release or retreat; around a second grasp `approach2` and so on."""
    start: float
    """From the start of the episode [s]."""
    end: float
    """From the start of the episode [s]."""
    seen: float | None
    """Share of its time in which all is seen that must be, in 0..1; null where nothing must."""

    def __str__(self) -> str:
        return f"{self.name} {'-' if self.seen is None else f'{100 * self.seen:.1f} %'}"


@dataclass(frozen=True, kw_only=True)
class FreeView(Record):
    """A stretch of time in which cameras see all that must be seen."""

    start: float
    """From the start of the motion [s]."""
    end: float
    """From the start of the motion [s]."""
    cameras: tuple[str, ...]
    """Each sees all of it, by itself."""


@dataclass(frozen=True, kw_only=True)
class FreeViews(Record):
    """Whether free views of a motion are long enough for an image and its transfer, and what would make one so."""

    needed: float
    """How long one has to be [s]."""
    longest: Mapping[str, float]
    """Of each camera, how long its longest one is, whether that is enough or not [s]."""
    wait: FreeView | None
    """Where none is long enough: the free view that comes nearest; null where there is none at any instant."""
    words: str
    """What is to be done, in a sentence."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateResult(Figures):
    """What is found of one candidate; of an infeasible one no figures.

    Its words are those of `pipeline.described`: they are empty before something is to be shown. Fields made with `live`
    are known only in the process that assessed it.
    """

    parameters: Mapping[str, float | str] = field(default_factory=dict)
    """Objects and motion parameters by name; of a step those of the way behind the figures."""
    feasible: bool
    """Whether the robot can do it; of a step: after the steps before it."""
    rank: int | None = None
    """Place in the ranking from 1; null if it is infeasible."""
    reasons: tuple[str, ...] = ()
    """Why it is infeasible, most useful first."""
    pareto: bool = False
    """Whether no other candidate is at least as good in q_avg, q_eoi and time, and better in one."""
    verdict: str = ""
    """Where it is blind, why, and what would help, in one or two sentences."""
    ways: WaysFound | None = None
    """The ways in which it can be done; its own figures are those of the first. Null where that was not asked for."""
    q_expected: float | None = field(default=None, metadata=LEFT_OUT)
    """How likely images show all that must be seen, mean over T; left out where no detector has a curve."""
    phases: tuple[PhaseSeen, ...] = field(default=(), metadata=LEFT_OUT)
    """Of an episode of a recording."""
    name: str = ""
    """What sets it apart among the candidates of its task, such as `g1 lift=200mm`."""
    objects: Mapping[str, str] = field(default_factory=dict)
    """The object of each parameter that stands for one."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """The value of each other parameter in words, with its unit."""
    choice: str = ""
    """What the way behind the figures says beyond the candidate, such as `shoulder left, wrist flipped`."""
    happens: Mapping[str, str] = field(default_factory=dict)
    """What happens at each fault, such as `it slips while it is lifted`, by the fault's name."""
    retried: tuple[str, ...] = ()
    """The faults after which the robot tries again."""
    remarks: tuple[str, ...] = ()
    """Detours and speeds that are not reached, such as `a1 goes around wall` and `a4 reaches 3.4 of 5 cm/s`."""
    why: tuple[str, ...] = field(default=(), metadata=LEFT_OUT)
    """The reasons, where an action is called by what it does; left out if it is feasible."""
    task: str | None = field(default=None, metadata=LEFT_OUT)
    """Of a step: the skill and its objects."""
    steps: tuple[CandidateResult, ...] = field(default=(), metadata=LEFT_OUT)
    """Of a task of several steps: each that was looked at. Names of parameters and faults of the whole begin with the
    step's number."""

    blind_spot: str = live("")
    """The part of the verdict that says where it is blind and why, without a full stop."""
    remedy: str = live("")
    """The part that says what would help; empty where nothing is known to."""
    candidate: Candidate = live()
    best_way: Candidate | None = live()
    """The way behind the figures, if the candidate leaves something free."""
    error: float | None = live()
    """Bound on the error of Q from bisection, in 0..1."""
    largest_gap: float | None = live()
    """Between samples, see `Timeline.largest_gap` [s]."""
    outside: tuple[tuple[int, int], ...] = live(())
    """The temporal operators that are never checked, see `grounding.formulas_outside`."""
    recalibrated: tuple[Qualities, ...] = live(())
    """The qualities for random camera poses, if requested."""

    @property
    def why_late(self) -> str:
        """What takes so long until the fault that is noticed last is noticed, in a few words; empty without faults."""
        latest = max(self.faults.values(), key=lambda one: (one.unseen, one.delay_worst or 0.0), default=None)
        return "" if latest is None or latest.why is None else latest.why.words

    def happening(self, fault: str) -> str:
        """What happens at a fault, in words."""
        return self.happens.get(fault, f"`{fault}` happens")

    @property
    def worst_phase(self) -> str:
        """The phase of a recorded episode in which least is seen, with its share; empty if it has none."""
        known = [one for one in self.phases if one.seen is not None]
        return str(min(known, key=lambda one: one.seen or 0.0)) if known else ""

    @property
    def way(self) -> Candidate:
        """The way that has these figures: the candidate itself if it leaves nothing free."""
        return self.best_way or self.candidate

    @classmethod
    def infeasible(
        cls, candidate: Candidate, reasons: tuple[str, ...], verdict: str = "", ways: WaysFound | None = None
    ) -> CandidateResult:
        """The result of a candidate that cannot be done."""
        return cls(candidate=candidate, feasible=False, reasons=reasons, verdict=verdict, ways=ways, **vars(NO_FIGURES))

    @property
    def brief(self) -> str:
        """Its name and quality."""
        if not self.feasible:
            return f"{self.name}, cannot be done"
        return self.name if self.q_eoi is None else f"{self.name}, critical time seen {100 * self.q_eoi:.1f} %"

    @property
    def has_choice(self) -> bool:
        """Whether there is more than one way of doing it."""
        return self.ways is not None and self.ways.tried > 1


@dataclass(frozen=True, kw_only=True)
class UnseenTime(Reason):
    """For how long a cause keeps a camera from seeing a literal while it must be seen."""

    cause: CauseLabel
    """The first limit that fails."""
    literal: str
    """Without `not`."""
    camera: str
    """Its name."""
    seconds: float
    """Each sample counts for half of the time to its neighbours in its piece [s]."""
    phase: str | None = field(default=None, metadata=LEFT_OUT)
    """Of a recorded episode, if it is about one phase."""


@dataclass(frozen=True, kw_only=True)
class HiddenTarget(Record):
    """What hides a target from a camera, on average over the time for which it does."""

    literal: str
    """Without `not`: a literal and its negation have one target."""
    camera: str
    """Its name."""
    seconds: float
    """For how long the first box that the camera does not see is a hidden one [s]."""
    hidden: float
    """Share of that box's silhouette that is hidden, in 0..1: the sum of the shares of `parts`."""
    parts: tuple[HidingPart, ...]
    """The largest share first."""


@dataclass(frozen=True, kw_only=True)
class SamplingDone(Record):
    """How the motions were sampled."""

    mode: Literal["adaptive", "samples", "dt"]
    """How instants were chosen: adaptively, a number per primitive action, or at equal steps of time."""
    samples: int | None = field(default=None, metadata=LEFT_OUT)
    """Instants per primitive."""
    dt: float | None = field(default=None, metadata=LEFT_OUT)
    """Time between instants [s]."""
    tolerance: float | None = field(default=None, metadata=LEFT_OUT)
    """Error of Q that sampling may leave."""
    max_motion: float | None = field(default=None, metadata=LEFT_OUT)
    """How far anything moves between two instants [m]."""
    error: float | None
    """Largest remaining error of Q."""
    max_gap: float | None
    """Largest time between two instants at which something must be seen while something moves [s]. No gain or loss of
    sight that lasts as long is missed; shorter ones may be."""


@dataclass(frozen=True, kw_only=True)
class RecalibratedCandidate(Record):
    """Effect of drawn camera poses on a candidate."""

    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    q_avg: list[float] | None
    """Least and most: 5th and 95th percentile of the draws; null where it is undefined."""
    q_eoi: list[float] | None
    """The same within the events of interest."""
    first: int
    """Draws of camera poses in which it is ranked first."""


@dataclass(frozen=True, kw_only=True)
class Recalibrated(Record):
    """Effect of drawn camera poses."""

    position: float
    """Standard deviation of each camera along each axis [m]."""
    rotation: float
    """Standard deviation of each camera about each axis [rad]."""
    seed: int
    """Of the random errors of camera poses."""
    draws: int
    """Number of random sets of camera poses."""
    candidates: tuple[RecalibratedCandidate, ...]
    """The feasible ones, in the order of the task."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Ranking(TaskDocument):
    """The candidates of a task, best first."""

    VIEW = "sqrp_cli.show.terminal.rank_table:print_ranking"

    document: Literal["rank"] = "rank"
    by: Criterion
    """What counts first."""
    sampling: SamplingDone
    """How the motions were sampled; errors and gaps are the largest of all candidates."""
    calibration: Recalibrated | None = field(default=None, metadata=LEFT_OUT)
    """With `--calibration`."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all candidates were finished."""
    of: int
    """How many candidates the task has."""
    ways: Literal["best", "all", "first"] = "best"
    """Which ways were asked for."""
    worst_first: bool = field(default=False, metadata=LEFT_OUT)
    """Whether they stand in the opposite order; ranks stay."""
    assumed: str = ""
    """What delays assume of the cameras, in words; empty where all state their latency."""
    candidates: tuple[CandidateResult, ...]
    """Best first, or worst first, infeasible ones last."""

    session: Any = live()
    """The `Session` that found it."""

    @property
    def feasible(self) -> tuple[CandidateResult, ...]:
        """The candidates that can be done, in their order."""
        return tuple(one for one in self.candidates if one.feasible)

    @property
    def best(self) -> CandidateResult | None:
        """The first candidate of the ranking, None if none is feasible."""
        return next(iter(self.feasible[::-1] if self.worst_first else self.feasible), None)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        first = "none feasible" if self.best is None else f"best {self.best.brief}"
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.task} in {self.workspace}: {how_many(self.candidates, 'candidate')}, {first}{cut}"

    def write(self, path: str | Path, choose: str = "best") -> None:
        """Append a candidate to a program file, which is created if it does not exist.

        A last step of the same task from the same world is replaced. choose: the candidate's name, or `best` for the
        first. Raises InputError where it is infeasible, or does not begin where the program ends; ValueError for a
        ranking that was read from a file.
        """
        if self.session is None:
            raise ValueError("a ranking that was read has no motions to write; rank again")
        self.session.write(self, path, choose)
