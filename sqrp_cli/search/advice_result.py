"""What `advise` finds, said once: the records that the search makes, `--json` prints, tables and pages read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sqrp_cli.document import LEFT_OUT, Record, TaskDocument, live
from sqrp_cli.errors import InputError, bad_option
from sqrp_cli.figures import FIGURE_NAMES, LATE, AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.records import dataclass
from sqrp_cli.search.goal import MOTION, Goal, Kind
from sqrp_cli.study.ranking import rank

if TYPE_CHECKING:
    from sqrp_cli.study.result import CandidateResult
else:  # no file has them
    CandidateResult = Any


@dataclass(frozen=True, kw_only=True)
class Margin(Record):
    """How much less and more of a change, in the same direction, still meets the goal, in its unit."""

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


_COMPARED = (("q_eoi", 1.0, 1e-3), ("q_avg", 1.0, 1e-3), ("time", -1.0, 0.01), ("latest", -1.0, 0.01))
"""Figures that are compared, whether more is better, and what counts as a difference, as in rankings and sweeps."""


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
    def of(cls, task: str, candidates: Sequence[tuple[CandidateResult, CandidateResult]]) -> TaskEffect:
        """The effect on candidates, each without and with the change."""
        firsts, changed = [], []
        for some in zip(*candidates, strict=True):
            ranking = rank(some, "q_eoi")
            firsts.append(ranking[0].candidate.name if ranking[0].rank is not None else None)
        for before, after in candidates:
            changed_at_all = before.feasible != after.feasible
            worse = ["feasible"] if before.feasible and not after.feasible else []
            for name, sign, step in _COMPARED:
                old, new = getattr(before, name), getattr(after, name)
                if old is not None and new is not None:  # both can be done
                    old, new = (np.round(sign * figure / step) for figure in (old, new))
                    changed_at_all |= bool(old != new)
                    worse += ["delay_worst" if name == "latest" else name] if new < old else []
            if changed_at_all:
                figures = from_fields(AdvisedFigures, before), from_fields(AdvisedFigures, after)
                name = before.candidate.name
                changed.append(
                    ChangedCandidate(candidate=name, before=figures[0], after=figures[1], worse=tuple(worse))
                )
        first_before, first_after = firsts or (None, None)
        return cls(task=task, first_before=first_before, first_after=first_after, candidates=tuple(changed))


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
    """The change as an instruction, such as `move camera `cam1` along -z 10.9 cm, and turn it 5.2 deg`."""

    proposed: Any = live()
    """As `question.ProposedChange`."""
    found: CandidateResult = live()
    """The candidate with it."""


@dataclass(frozen=True, kw_only=True)
class AdviceFound(ChangeFound):
    """A change that meets the goal."""

    margin: Margin | None
    """Null where there is nothing to measure."""
    worse: tuple[str, ...]
    """The tasks of the workspace in which a candidate gets worse in a figure."""
    tasks: tuple[TaskEffect, ...]
    """Every task that it may affect, before and after: of a change of the cell all tasks of the workspace, of a way or
    path the one that was asked for; candidates keep the ways that they have now, `rank` may find others then."""
    patch: str = ""
    """A unified diff of the workspace file; empty where nothing in the file says it."""
    unwritten: str | None = field(default=None, metadata=LEFT_OUT)
    """Why there is no patch."""

    content: Any = live()
    """The workspace file with it, as bytes, or an InputError that says why no file says it."""

    @property
    def costs(self) -> list[str]:
        """What gets worse, task by task, such as `g4 (critical time seen 50.6 points less) in pickup green`.

        What an earlier task says of a candidate is not said again.
        """
        told, costs = set[str](), list[str]()
        for task in self.tasks:
            worse = []
            for one in task.candidates:
                shifts = ["can no longer be done"] if "feasible" in one.worse else []
                for name in (name for name in one.worse if name != "feasible"):
                    old, new = getattr(one.before, name), getattr(one.after, name)
                    match name:
                        case "delay_worst" if new is None:
                            shifts.append("may never be noticed")
                        case "delay_worst":
                            shifts.append(f"noticed up to {new - old:.2f} s later")
                        case "time":
                            shifts.append(f"takes {new - old:.2f} s more")
                        case _:
                            shifts.append(f"{FIGURE_NAMES[name]} {100 * (old - new):.1f} points less")
                words = f"{one.candidate} ({', '.join(shifts)})"
                worse += [words] if shifts and words not in told else []
            told.update(worse)
            costs += [f"{', '.join(worse)} in {task.task}"] if worse else []
        return costs


@dataclass(frozen=True, kw_only=True)
class NearestChange(ChangeFound):
    """A change that does not meet the goal but comes near; as text, the end of a sentence."""

    missing: tuple[str, ...]
    """What is missing, in a few words each."""
    limit: str
    """Which limit stands in the way."""
    nearer: bool
    """Whether it comes nearer to the goal than what it starts from; false where nothing that was tried does."""

    def __str__(self) -> str:
        return f"nearest: {self.words} ({'; '.join(self.missing)})" if self.nearer else "nothing comes nearer"


@dataclass(frozen=True, kw_only=True)
class KindOutcome(Record):
    """What came of a kind of change."""

    kind: Kind
    """What would be changed."""
    found: int = 0
    """How many changes meet the goal, one for each target at most."""
    why: str | None = None
    """Why there is none."""
    nearest: NearestChange | None = None
    """What comes nearest, where something was tried."""

    advice: tuple[AdviceFound, ...] = live(())
    """The changes that meet the goal, the least first."""


@dataclass(frozen=True, kw_only=True, repr=False)
class AdviceDocument(TaskDocument):
    """What `sqrp advise` finds."""

    VIEW = "sqrp_cli.show.terminal.search_tables:print_advice"

    document: Literal["advise"] = "advise"
    want: Goal
    """What is to be met; null where anything will do."""
    candidate: str
    """Name of the candidate that the advice is about."""
    way: Mapping[str, float | str]
    """Parameters of the way from which changes of objects and cameras start."""
    met: bool
    """Whether it meets the goal without any change."""
    before: AdvisedFigures
    """The candidate without any change, as with `--ways first`; in its best way if that misses the goal alone."""
    best: AdvisedFigures | None
    """The candidate without any change in the way that `rank` and `score` take; None if that misses the goal."""
    advice: tuple[AdviceFound, ...] = ()
    """What meets the goal: the motion first, cameras last, of each kind the least change first."""
    kinds: tuple[KindOutcome, ...] = ()
    """What came of each kind."""
    nearest: NearestChange | None = None
    """If nothing meets the goal: what comes nearest."""
    ways: Literal["best", "first"] = "best"
    """Which ways were asked for: with `first`, the motion stays as it is."""
    starts_fastest: bool = True
    """Whether `before` is about the way with `--ways first`."""
    assumed: str = ""
    """What delays assume of the cameras, in words; empty where all state their latency."""
    first: str | None = field(default=None, metadata=LEFT_OUT)
    """What has to be done before, where the precondition of the skill does not hold."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all kinds were searched."""

    question: Any = live()
    """The `question.Question` that it answers."""
    file: Any = live()
    """The workspace file."""

    @property
    def choice(self) -> int:
        """The number of the change to take: the first that costs nothing outside the motion, else the first."""
        return next((n for n, one in enumerate(self.advice, 1) if one.kind in MOTION or not one.worse), 1)

    @property
    def whose_figures(self) -> str:
        """Whose figures they are, where that matters: changes of the cell may let other ways be better."""
        if self.ways == "first" or all(one.kind in MOTION for one in self.advice):
            return ""
        return "After a change, rank may choose another motion; figures then differ."

    @property
    def unnoticed(self) -> str:
        """What it says of a fault that is noticed late, or never, where a goal is met that says nothing of delays."""
        found = self.best or self.before
        if not self.met or self.want.delay is not None or not (found.unseen or (found.delay_worst or 0.0) > LATE):
            return ""
        never = found.delay_worst is None
        return f"But a fault may {'never be noticed' if never else f'be noticed only after {found.delay_worst:.2f} s'}"

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        count = len(self.advice)
        found = "met as it is" if self.met else f"{count} change{'' if count == 1 else 's'} meet{'s' * (count == 1)} it"
        return f"{self.task} in {self.workspace}: {self.want}, {found}"

    def patched(self, number: int) -> bytes:
        """The workspace file with an advice, from 1. Raises InputError for a number that none has, or without patch."""
        if not 1 <= number <= len(self.advice):
            count = len(self.advice)
            expected = f"expected 1 to {count}" if count else "there is none"
            raise bad_option(f"there is no advice {number}; {expected}")
        content: bytes | InputError = self.advice[number - 1].content
        if isinstance(content, InputError):
            raise content
        return content

    def apply(self, number: int = 1) -> None:
        """Write an advice into the workspace file, by its number from 1; comments stay.

        Nothing is written where the file says it already. Raises InputError where it cannot be written, and where the
        file has changed meanwhile; ValueError for advice that was read from a file.
        """
        from sqrp_cli.cell.workspace_file import replace_workspace

        if self.question is None:
            raise ValueError("advice that was read has no workspace to write; search again")
        if (content := self.patched(number)) != self.file.content:
            replace_workspace(self.file, content)
