"""`advise`: the least changes that meet a wish."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from sqrp_cli.document import LEFT_OUT, Record, TaskDocument
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.programming.advice.change import MOTION, Advice, EffectOnTask, Kind, Miss, ProposedChange
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.report.sentences import change_in_words


@dataclass(frozen=True, kw_only=True)
class WishedFigures(Record):
    """What is to be met; null where anything will do."""

    q_eoi: float | None
    """Least Q_eoi in 0..1."""
    q_avg: float | None
    """Least Q_avg in 0..1."""
    time: float | None
    """Longest duration of the motion [s]."""
    delay: float | None
    """Longest time until a fault is noticed [s]."""


@dataclass(frozen=True, kw_only=True)
class AdvisedFigures(Record):
    """The figures of a candidate that a wish may be about; null where undefined, and all of an infeasible one."""

    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""
    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    time: float | None
    """Duration of the whole motion [s]."""
    delay_worst: float | None
    """The longest time that any fault may remain unnoticed [s]; null without faults, and where one may never be
    noticed."""
    unseen: float | None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""

    @classmethod
    def of(cls, found: CandidateResult | None) -> AdvisedFigures:
        """The figures of a candidate; None: there is none that can be done."""
        if found is None:
            return cls(q_eoi=None, q_avg=None, time=None, delay_worst=None, unseen=None)
        return completed(cls, found)


@dataclass(frozen=True, kw_only=True)
class ChangeMargin(Record):
    """How much less and more of a change, in the same direction, still meets the wish, in its unit."""

    less: float
    """By how much it may be smaller."""
    more: float
    """By how much it may be larger; not looked at beyond 0.3 m or 30 degrees."""


@dataclass(frozen=True, kw_only=True)
class ChangedCandidate(Record):
    """A candidate whose figures change."""

    candidate: str
    """Its name."""
    before: AdvisedFigures
    """Without the change."""
    after: AdvisedFigures
    """With it."""
    worse: tuple[str, ...]
    """The figures that get worse by as much as rankings tell apart; `feasible` if it can no longer be done."""


@dataclass(frozen=True, kw_only=True)
class TaskEffect(Record):
    """What a change does to a task of the workspace."""

    task: str
    """As the workspace lists it, or as it was asked for."""
    first_before: str | None
    """Name of the candidate that is first without the change; null if none can be done."""
    first_after: str | None
    """The same with the change."""
    candidates: tuple[ChangedCandidate, ...]
    """Those whose figures change, in the order of the task."""

    @classmethod
    def of(cls, effect: EffectOnTask) -> TaskEffect:
        """An effect as a record."""
        before, after = effect.first_before, effect.first_after
        return cls(
            task=effect.task,
            first_before=None if before is None else before.candidate.name,
            first_after=None if after is None else after.candidate.name,
            candidates=tuple(
                ChangedCandidate(
                    candidate=one.before.candidate.name,
                    before=AdvisedFigures.of(one.before),
                    after=AdvisedFigures.of(one.after),
                    worse=one.worse,
                )
                for one in effect.candidates
                if one.changed
            ),
        )


HELD_WAYS = "Figures are of the ways that candidates have now; rank may find others then."
"""What holds of changes of a cell where the motion is free."""


def held_ways(advice: Sequence[AdviceFound], *, fixed: bool) -> str:
    """`HELD_WAYS` if it matters, else nothing. fixed: whether the motion stays as it is."""
    return "" if fixed or all(one.kind in MOTION for one in advice) else HELD_WAYS


def costs(effects: Sequence[TaskEffect]) -> Iterator[str]:
    """What gets worse by a change, task by task, such as `in pickup green: g4 Q_eoi 63.4 % to 12.8 %`.

    What an earlier task says of a candidate is not said again.
    """
    told: set[str] = set()
    for task in effects:
        found = [f"{one.candidate} {', '.join(_shifts(one))}" for one in task.candidates if one.worse]
        worse = [words for words in found if words not in told]
        told.update(worse)
        if worse:
            yield f"in {task.task}: {'; '.join(worse)}"


def _shifts(effect: ChangedCandidate) -> Iterator[str]:
    for name, label, scale, pattern in (
        ("q_eoi", "Q_eoi", 100.0, "{:.1f} %"),
        ("q_avg", "Q_avg", 100.0, "{:.1f} %"),
        ("time", "time", 1.0, "{:.2f} s"),
        ("delay_worst", "seen at worst after", 1.0, "{:.2f} s"),
    ):
        if name in effect.worse:
            old, new = (
                "never" if figures.unseen and name == "delay_worst" else pattern.format(scale * getattr(figures, name))
                for figures in (effect.before, effect.after)
            )
            yield f"{label} {old} to {new}"
    if "feasible" in effect.worse:
        yield "can no longer be done"


@dataclass(frozen=True, kw_only=True)
class ChangeFound(AdvisedFigures):
    """A change, with the figures of the candidate with it, in the way from which the change starts."""

    kind: Kind
    """What is changed."""
    target: str
    """The candidate, object or camera that changes."""
    change: tuple[float, ...] | Mapping[str, float | str]
    """Metres along x, y, z in the frame of the camera or the world; angles to the right and up in the image, or of the
    field of view [rad]; the parameters of a way."""
    size: float
    """How large the change is, in `unit`."""
    unit: str
    """m, rad, or camera for a further one; empty where there is nothing to measure."""
    turn: float
    """Angle between the optical axes before and after it [rad], of a camera that is moved or turned; else 0."""
    words: str
    """The change as an instruction, such as `move cam1 10.9 cm, mostly -z, and turn it 5.2 deg`."""

    @classmethod
    def of_change(cls, change: ProposedChange, found: CandidateResult) -> ChangeFound:
        """A change with what was found."""
        values = change.values if change.parameters is None else dict(change.parameters)
        return completed(cls, found, change, change=values, words=change_in_words(change))


@dataclass(frozen=True, kw_only=True)
class AdviceFound(ChangeFound):
    """A change that meets the wish."""

    margin: ChangeMargin | None
    """Null where there is nothing to measure."""
    worse: tuple[str, ...]
    """The tasks of the workspace in which a candidate gets worse in a figure."""
    tasks: tuple[TaskEffect, ...]
    """Every task that it may affect, before and after: of a change of the cell all tasks of the workspace, of a way or
    path the one that was asked for; candidates keep the ways that they have now, `rank` may find others then."""
    patch: str
    """A unified diff of the workspace file; empty where nothing in the file says it."""
    unwritten: str | None = field(default=None, metadata=LEFT_OUT)
    """Why there is no patch."""

    @classmethod
    def of_advice(cls, advice: Advice, patch: str, unwritten: str | None) -> AdviceFound:
        """An advice as a record."""
        margin = advice.margin
        return completed(
            cls,
            advice,
            ChangeFound.of_change(advice.change, advice.found),
            margin=None if margin is None else completed(ChangeMargin, margin),
            tasks=tuple(map(TaskEffect.of, advice.effects)),
            patch=patch,
            unwritten=unwritten,
        )


@dataclass(frozen=True, kw_only=True)
class NearestChange(ChangeFound):
    """A change that does not meet the wish but comes near."""

    missing: tuple[str, ...]
    """What is missing, in a few words each."""
    limit: str
    """Which limit stands in the way."""
    nearer: bool
    """Whether it comes nearer to the wish than what it starts from; false where nothing that was tried does."""


@dataclass(frozen=True, kw_only=True)
class KindOutcome(Record):
    """What came of a kind of change."""

    kind: Kind
    """What would be changed."""
    found: int
    """How many changes meet the wish, one for each target at most."""
    why: str | None
    """Why there is none."""
    nearest: NearestChange | None
    """What comes nearest, where something was tried."""


def nearest_of(miss: Miss, wish: Wish) -> NearestChange | None:
    """What came nearest of a kind, as a record."""
    if miss.nearest is None or miss.found is None:
        return None
    found = ChangeFound.of_change(miss.nearest, miss.found)
    return completed(NearestChange, miss, found, missing=wish.missed(miss.found))


def nearest_in_words(nearest: NearestChange) -> str:
    """What comes nearest where nothing meets the wish, in a sentence without its full stop."""
    if not nearest.nearer:
        return "Nothing that was tried comes nearer, either"
    return f"To {nearest.words} comes nearest: {'; '.join(nearest.missing)}"


@dataclass(frozen=True, kw_only=True, repr=False)
class AdviceDocument(TaskDocument):
    """What `sqrp advise` finds."""

    document: Literal["advise"] = "advise"
    want: WishedFigures
    """What is to be met."""
    candidate: str
    """Name of the candidate that the advice is about."""
    way: Mapping[str, float | str]
    """Parameters of the way from which changes of objects and cameras start."""
    met: bool
    """Whether it meets the wish without any change."""
    before: AdvisedFigures
    """The candidate without any change, as with `--ways fastest`; in its best way if that misses the wish alone."""
    best: AdvisedFigures | None
    """The candidate without any change in the way that `rank` and `score` take; None if that misses the wish."""
    advice: Sequence[AdviceFound]
    """What meets the wish: the motion first, cameras last, of each kind the least change first."""
    kinds: Sequence[KindOutcome]
    """What came of each kind."""
    nearest: NearestChange | None
    """If nothing meets the wish: what comes nearest."""
    first: str | None = field(default=None, metadata=LEFT_OUT)
    """What has to be done before, where the precondition of the skill does not hold."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all kinds were searched."""
