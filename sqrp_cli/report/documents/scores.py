"""`score` and `diff`: every task of every workspace, and what changed since a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from sqrp_cli.document import LEFT_OUT, Document, Record, WorkspaceDocument
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.programming.pipeline import described
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.scoring.baselines.baseline import VanishedTask
from sqrp_cli.scoring.baselines.changes import Change
from sqrp_cli.scoring.baselines.comparison import Comparison, Shift, Verdict, WayChange
from sqrp_cli.scoring.score import Status
from sqrp_cli.scoring.scorecard import ComparedScore, Scorecard
from sqrp_cli.scoring.sweep import Sweep


@dataclass(frozen=True, kw_only=True)
class LostView(Record):
    """A stretch of time [s] in which a camera no longer covers a literal."""

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


@dataclass(frozen=True, kw_only=True)
class ChangedWay(Record):
    """How the best candidate for a choice of objects changed."""

    way: str
    """The objects, such as `g1 tray`."""
    candidate_before: str
    """Name of the best candidate in the baseline."""
    candidate: str
    """Name of the best candidate now."""
    choice_before: str | None
    """The way behind the figures of the baseline, such as `left, flipped`; null if it does not say it."""
    choice: str | None
    """The way behind the figures now; null if it is infeasible."""
    shifts: list[Shift]
    """The figures that got better or worse."""
    lost: list[LostView]
    """What cameras no longer see, the longest first; empty unless something got worse on the same way as before."""

    @classmethod
    def of(cls, change: WayChange) -> ChangedWay:
        """A change as a record."""
        return completed(
            cls,
            change,
            candidate_before=change.before,
            candidate=change.now,
            shifts=list(change.shifts),
            lost=[completed(LostView, loss.stretch, loss) for loss in change.losses],
        )


@dataclass(frozen=True, kw_only=True)
class ComparedTask(Record):
    """How a task compares with its baseline."""

    verdict: Verdict
    """Regressed if anything got worse; new if the baseline does not have the task."""
    ways: list[ChangedWay]
    """Those that changed, the worst first."""
    gone: list[str]
    """Ways of doing it that no longer exist."""

    @classmethod
    def of(cls, comparison: Comparison) -> ComparedTask:
        """A comparison as a record."""
        ways = [ChangedWay.of(change) for change in comparison.ways]
        return completed(cls, comparison, ways=ways, gone=list(comparison.gone))


@dataclass(frozen=True, kw_only=True)
class TaskResult(Record):
    """A task of a workspace."""

    workspace: str
    """Its name, with as much of its path as makes it unique."""
    task: str | None
    """Null where the workspace itself cannot be used."""
    status: Status
    """Failed if the task is not good enough or got worse; error if it cannot be ranked."""
    best: CandidateResult | None
    """The first in the ranking; null if none is feasible."""
    reasons: list[str]
    """What is not good enough or got worse, or what the error is, in a sentence each."""
    baseline: ComparedTask | None
    """What changed since the baseline; null without a baseline, or after an error."""

    @classmethod
    def of(cls, result: ComparedScore) -> TaskResult:
        """One task of one workspace."""
        score = result.score
        return completed(
            cls,
            score,
            best=None if score.best is None else described(score.best),
            reasons=list(score.reasons),
            baseline=None if result.comparison is None else ComparedTask.of(result.comparison),
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class ScoreDocument(Document):
    """What `sqrp score` and `sqrp diff` find; the same bytes wherever it is computed."""

    document: Literal["score", "diff"] = "score"
    results: list[TaskResult]
    """One for each task, and for each workspace that cannot be used."""
    changes: Mapping[str, list[Change]]
    """By workspace, since the baseline."""
    vanished: tuple[VanishedTask, ...]
    """Tasks that exist only in the baseline."""
    renamed: Mapping[str, str]
    """The baseline's name of each workspace that it knows by another one, by its name now."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before everything was scored."""
    unfinished: int | None = field(default=None, metadata=LEFT_OUT)
    """If so, how many results are missing."""
    passed: bool
    """Whether every task passed and none is missing; a vanished one is, unless that is allowed."""

    @classmethod
    def of(cls, findings: Scorecard) -> ScoreDocument:
        """Every result."""
        return completed(
            cls,
            findings,
            results=[TaskResult.of(result) for result in findings.results],
            changes={name: list(changes) for name, changes in findings.changes.items() if changes},
            interrupted=findings.interrupted or None,
            unfinished=findings.unfinished if findings.interrupted else None,
        )


@dataclass(frozen=True, kw_only=True)
class VariantResult(Record):
    """A variant of a workspace, with means over the choices of objects that can be done."""

    rank: int
    """Place from 1."""
    values: Mapping[str, str]
    """Values that differ from the workspace as it is, by path."""
    choices: int
    """Choices of objects of every task."""
    feasible: int
    """Feasible ones among them; the figures are means over these."""
    q_eoi: float | None
    """Mean Q_eoi in 0..1; null where it is undefined for all."""
    q_avg: float | None
    """Mean Q_avg in 0..1; null where it is undefined for all."""
    time: float | None
    """Mean duration of the motion [s]; null if no choice is feasible."""
    delay: float | None
    """Mean of the longest time that a fault may remain unnoticed [s]; null where there is none, or one may never be
    noticed."""
    unseen: float | None
    """Mean of the largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
    results: list[TaskResult]
    """One for each task."""


@dataclass(frozen=True, kw_only=True, repr=False)
class VaryDocument(WorkspaceDocument):
    """What `sqrp score --vary` finds."""

    document: Literal["score --vary"] = "score --vary"
    variants: list[VariantResult]
    """The best first."""
    best: Mapping[str, str]
    """The `values` of the best variant; empty if that is the workspace as it is."""
    equals: int
    """Variants that are as good as the best; it has the most room around it."""
    patch: str | None
    """The file that was written."""
    passed: bool
    """Whether every task of the best variant passed."""

    @classmethod
    def of(cls, sweep: Sweep, workspace: str, patch: str | None) -> VaryDocument:
        """Every variant with the scores of its tasks."""
        return cls(
            workspace=workspace,
            variants=[
                completed(
                    VariantResult,
                    scored,
                    rank=rank,
                    values=dict(scored.variant.values),
                    results=[replace(TaskResult.of(result), workspace=workspace) for result in scored.findings.results],
                )
                for rank, scored in enumerate(sweep.variants, 1)
            ],
            best=dict(sweep.best.variant.values),
            equals=sweep.equals,
            patch=patch,
            passed=sweep.best.findings.passed,
        )
