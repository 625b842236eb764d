"""What scoring finds, said once: the records that `--json` prints, and that tables, pages and files for CI read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any, Literal

from sqrp_cli.document import LEFT_OUT, Document, Record, WorkspaceDocument, how_many, live
from sqrp_cli.figures import FIGURE_NAMES, Qualities, shown_figure
from sqrp_cli.files.source import LeafValue
from sqrp_cli.logic.formula_time import TimeInterval
from sqrp_cli.records import dataclass
from sqrp_cli.skill.settings import NOTHING_SPECIAL
from sqrp_cli.study.result import CandidateResult

WORKSPACE = "workspace"  # the role of the workspace file itself
CHANGES_SHOWN = 4  # most changes of a workspace in a sentence


@dataclass(frozen=True)
class Change(Record):
    """A difference between two versions of a workspace."""

    file: str
    """The role of the file that changed, such as `workspace`, `robot.urdf` or `skills.pickup.yaml`."""
    field: str | None
    """The field in it; None if only the whole content can be compared."""
    before: LeafValue
    """The value, or for a whole file the first digits of its digest; None if there is no such field or file."""
    now: LeafValue
    """See `before`."""

    def __str__(self) -> str:
        what = "content" if self.field is None else self.field
        where = what if self.file == WORKSPACE else f"{self.file} {what}"
        if self.before is None:
            return f"{where} = {self.now} is new"
        return f"{where} = {self.before} is gone" if self.now is None else f"{where}: {self.before} -> {self.now}"


def listed(changes: Sequence[Change]) -> str:
    """The first changes, and the number of others."""
    more = len(changes) - CHANGES_SHOWN
    return ", ".join(map(str, changes[:CHANGES_SHOWN])) + (f" and {more} more" if more > 0 else "")


@dataclass(frozen=True)
class LostView(Record):
    """A stretch of time [s] in which a literal is no longer covered, because a camera no longer sees it."""

    literal: str
    """What is to be seen, such as `hold(g4)`."""
    camera: str
    """The camera that used to see it."""
    start: float
    """From the start of the present motion [s]."""
    end: float
    """From the start of the present motion [s]."""
    why: str
    """The commonest cause, in a few words."""
    says: str = ""
    """The literal in words, such as `the tool holds g4`; empty where it is not known."""

    def __str__(self) -> str:
        when = TimeInterval(self.start, self.end).when
        return f"camera `{self.camera}` no longer sees whether {self.says or self.literal} {when}: {self.why}"


Metric = Literal["feasible", "q_eoi", "q_avg", "time", "delay"]
METRICS: tuple[Metric, ...] = ("q_eoi", "q_avg", "time", "delay")  # those with a figure


@dataclass(frozen=True)
class Shift(Record):
    """A figure that got better or worse; values in 0..1 or s, None if undefined or infeasible."""

    metric: Metric
    """Which figure; `delay` is the longest time that a fault may remain unnoticed, null where it may for ever."""
    before: float | None
    """In the baseline; of `feasible`, 1 or 0."""
    now: float | None
    """At present; of `feasible`, 1 or 0."""
    worse: bool
    """Whether it got worse."""

    def __str__(self) -> str:
        if self.metric == "feasible":
            return "can no longer be done" if self.worse else "can be done now"
        quality = self.metric in ("q_eoi", "q_avg")
        if not quality and self.now is None:
            return "a fault may never be noticed any more"
        if not quality and self.before is None:
            return f"no fault goes unnoticed any more: each is noticed after {self.now:.2f} s at the latest"
        old, new = (shown_figure(self.metric, figure) for figure in (self.before, self.now))
        if old == new:  # figures that differ never look alike
            old, new = (shown_figure(self.metric, figure, 2) for figure in (self.before, self.now))
        name = {"time": "its time", "delay": "the longest time until a fault is noticed"}.get(self.metric)
        verb = "fell" if self.worse is quality else "rose"
        return f"{name or FIGURE_NAMES[self.metric]} {verb} from {old} to {new}"


@dataclass(frozen=True)
class WayChange(Record):
    """How the best candidate for a choice of objects changed."""

    way: str
    """The objects, such as `g1 tray`."""
    candidate_before: str
    """Name of the best candidate in the baseline."""
    candidate: str
    """Name of the best candidate now."""
    shifts: tuple[Shift, ...]
    """The figures that got better or worse."""
    lost: tuple[LostView, ...] = ()
    """What cameras no longer see, the longest first; empty unless something got worse on the same way as before, as
    times of different motions do not correspond."""
    reason: str = ""
    """Why it can no longer be done."""
    choice_before: str | None = None
    """The way behind the figures of the baseline, such as `left, flipped`; null if it does not say it."""
    choice: str | None = None
    """The way behind the figures now; null if it is infeasible."""

    @property
    def another_way(self) -> bool:
        """Whether the robot moves in another way than before, as far as the baseline says how it did."""
        known = self.choice is not None and self.choice_before is not None
        return self.candidate != self.candidate_before or (known and self.choice != self.choice_before)

    @property
    def worse(self) -> bool:
        """Whether anything got worse."""
        return any(shift.worse for shift in self.shifts)

    @property
    def severity(self) -> float:
        """Largest change for the worse: a difference of Q, or the share by which a time grew; 0 if none."""
        worst = 0.0
        for one in self.shifts:
            if one.worse and one.before is not None and one.now is not None:
                scale = one.before if one.metric in ("time", "delay") and one.before > 0 else 1.0
                worst = max(worst, abs(one.now - one.before) / scale)
        return worst

    def __str__(self) -> str:
        shown = [shift for shift in self.shifts if shift.worse] or list(self.shifts)
        parts = [", ".join(map(str, shown))]
        if len(shown) < len(self.shifts):
            parts[0] += ", but " + ", ".join(str(shift) for shift in self.shifts if not shift.worse)
        if self.another_way:
            pairs = ((self.candidate, self.choice), (self.candidate_before, self.choice_before))
            now, before = (
                str(choice)
                if self.candidate == self.candidate_before
                else candidate + ("" if choice in (None, NOTHING_SPECIAL) else f", {choice}")
                for candidate, choice in pairs
            )
            parts.append(f"{self.way} now goes another way: {now} instead of {before}")
        if self.reason:
            parts.append(self.reason)
        if self.lost:
            more = len(self.lost) - 1
            parts.append(f"{self.lost[0]}" + (f" ({more} more such stretch{'es' if more > 1 else ''})" if more else ""))
        return f"{self.way}: {'; '.join(parts)}"


@dataclass(frozen=True)
class Comparison(Record):
    """How a task compares with its baseline."""

    verdict: Literal["regressed", "improved", "unchanged", "new"]
    """Regressed if anything got worse; new if the baseline does not have the task."""
    ways: tuple[WayChange, ...] = ()
    """Those that changed, the worst first."""
    gone: tuple[str, ...] = ()
    """Ways of doing it that no longer exist."""


@dataclass(frozen=True, eq=False)
class TaskScore(Record):
    """The score of a task in a workspace, compared with its baseline."""

    workspace: str
    """Its name, with as much of its path as makes it unique."""
    task: str | None
    """Null where the workspace itself cannot be used."""
    status: Literal["passed", "failed", "error"]
    """Failed if the task is not good enough or got worse; error if it cannot be ranked."""
    reasons: tuple[str, ...]
    """What is not good enough or got worse, or what the error is, in a sentence each."""
    best: CandidateResult | None = None
    """The first in the ranking; null if none is feasible."""
    baseline: Comparison | None = None
    """What changed since the baseline; null without a baseline, or after an error."""
    assumed: str = ""
    """What its times assume of detectors and cameras, in words; empty where nothing is assumed."""
    ways: Mapping[str, CandidateResult] = live(factory=dict)
    """The best candidate for every choice of objects, by `way_name`; infeasible where none of them is feasible."""
    request: Any = live()
    """The `ScoreRequest` of its first candidate, from which those of its ways are made."""

    @property
    def named(self) -> str:
        """Workspace and task, for display."""
        return self.workspace if self.task is None else f"{self.workspace}, {self.task}"


@dataclass(frozen=True)
class VanishedTask(Record):
    """A task that exists only in the baseline."""

    workspace: str
    """Its name."""
    task: str
    """As the baseline has it."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scorecard(Document):
    """A scoring run: every task, what changed since a baseline or another version, and whether it passed.

    The same bytes wherever it is computed.
    """

    VIEW = "sqrp_cli.show.terminal.search_tables:print_scorecard"

    document: Literal["score", "diff"] = "score"
    results: tuple[TaskScore, ...]
    """One for each task, and for each workspace that cannot be used."""
    changes: Mapping[str, tuple[Change, ...]] = field(default_factory=dict)
    """By workspace, since the baseline; those without any are left out."""
    vanished: tuple[VanishedTask, ...] = ()
    """Tasks that exist only in the baseline."""
    may_vanish: bool = False
    """Whether that is no failure."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """The baseline's name of each workspace that it knows by another one, by its name now."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before everything was scored."""
    unfinished: int | None = field(default=None, metadata=LEFT_OUT)
    """If so, how many results are missing."""
    passed: bool = False
    """Whether every task passed and none is missing; a vanished one is, unless that is allowed. Found by itself."""

    def __post_init__(self) -> None:
        complete = (self.may_vanish or not self.vanished) and not self.interrupted
        object.__setattr__(self, "passed", complete and all(one.status == "passed" for one in self.results))

    def count(self, status: str) -> int:
        """How many results have a status."""
        return sum(one.status == status for one in self.results)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.count('passed')} of {how_many(self.results, 'task')} passed{cut}"


@dataclass(frozen=True, eq=False, kw_only=True)
class ScoredVariant(Qualities):
    """A variant of a workspace, with means over the choices of objects that can be done, each by its best candidate.

    Figures are null where a variant cannot be scored, or one is undefined for all.
    """

    rank: int = 0
    """Place from 1."""
    values: Mapping[str, str]
    """Values that differ from the workspace as it is, by path."""
    choices: int = 0
    """Choices of objects of every task."""
    feasible: int = 0
    """Feasible ones among them; the figures are means over these."""
    time: float | None = None
    """Mean duration of the motion [s]."""
    delay: float | None = None
    """Mean of the longest time that a fault may remain unnoticed [s]; null where there is none, or one may never be
    noticed."""
    unseen: float | None = None
    """Mean of the largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
    results: tuple[TaskScore, ...]
    """One for each task."""
    findings: Any = live()
    """Its `Scorecard`."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Sweep(WorkspaceDocument):
    """The variants of a workspace, the best first. The unchanged workspace is one of them.

    Of equally good ones the unchanged workspace comes first, else the one with most margin, see `sweep.most_margin`;
    the others are in the order of their values.
    """

    VIEW = "sqrp_cli.show.terminal.search_tables:print_variants"

    document: Literal["score --vary"] = "score --vary"
    variants: tuple[ScoredVariant, ...]
    """The best first."""
    best: Mapping[str, str] = field(default_factory=dict)
    """The `values` of the best variant; empty if that is the workspace as it is."""
    equals: int = 1
    """Variants that are as good as the best; it has the most room around it."""
    file: str
    """The workspace file, from here."""
    patch: str | None = None
    """The file that was written."""
    passed: bool = False
    """Whether every task of the best variant passed."""
    interrupted: bool = live(False)
    best_patch: str = live("")
    """A unified diff from the workspace file to the best variant; empty if nothing is better."""
