"""`check` and `rules`: findings about a workspace and candidates of a task, and what each finding means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sqrp_cli.checks.registry import RuleEntry
from sqrp_cli.document import Document, Record, WorkspaceDocument
from sqrp_cli.figures import Qualities
from sqrp_cli.knowledge.text.entries import completed

if TYPE_CHECKING:
    from sqrp_cli.errors import Problem
    from sqrp_cli.programming.suggestion import Feasibility, SuggestedStep


@dataclass(frozen=True, kw_only=True)
class ReportedProblem(Record):
    """Something that is wrong or doubtful in the input."""

    code: str
    """Name of the kind of finding, such as `unknown-key`; `sqrp rules CODE` explains it."""
    severity: Literal["error", "warning"]
    """Errors make the input unusable, warnings do not."""
    file: str | None
    """Its path; null if it is about no file."""
    line: int | None
    """From 1; null if it is about the whole file."""
    column: int | None
    """From 1; null if it is about the whole line or file."""
    message: str
    """What was found and what was expected, in one sentence."""

    @classmethod
    def of(cls, problem: Problem) -> ReportedProblem:
        """A problem as a finding."""
        place = problem.place
        return completed(
            cls,
            problem,
            file=None if place is None else str(place.file),
            line=None if place is None else place.line,
            column=None if place is None else place.column,
        )


@dataclass(frozen=True, kw_only=True)
class PlannedStep(Qualities):
    """A step of a plan, in its best way."""

    action: str
    """A skill with its objects as planners write it, such as `place(g2, tray)`."""
    feasible: bool
    """Whether it can be done after the steps before it."""
    time: float | None
    """Duration of its motion [s]; null if it is infeasible."""
    reasons: list[str]
    """Why it is infeasible; empty if it is feasible."""

    @classmethod
    def of(cls, step: SuggestedStep) -> PlannedStep:
        """A step of a suggestion."""
        figures = {name: getattr(step.assessment, name, None) for name in ("q_avg", "q_eoi", "time")}
        return completed(cls, step, reasons=list(step.reasons), **figures)


@dataclass(frozen=True, kw_only=True)
class CheckedCandidate(Record):
    """Whether a candidate can be done."""

    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    feasible: bool
    """Whether it can be done at once: its precondition holds, and the robot can make its motion."""
    reasons: list[str]
    """Why it is infeasible, most useful first."""
    time: float | None
    """Duration of its motion, with the first grip that works, in the fastest branch [s]; null if it is infeasible."""
    plan: list[PlannedStep] | None
    """What has to be done first; empty if nothing, null if no plan was found."""
    last: PlannedStep | None
    """The candidate itself, after that; null if nothing has to be done first, or no plan was found. It has no figures
    where more than 20 candidates were asked about."""
    planning: str
    """How planning ended."""

    @classmethod
    def of(cls, found: Feasibility) -> CheckedCandidate:
        """What was found about a candidate."""
        steps, last = found.suggestion.steps, found.suggestion.last
        return completed(
            cls,
            found,
            parameters=found.candidate.parameters,
            reasons=list(found.reasons),
            plan=None if steps is None else [PlannedStep.of(step) for step in steps],
            last=None if last is None else PlannedStep.of(last),
            planning=found.suggestion.outcome,
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class CheckDocument(WorkspaceDocument):
    """What `sqrp check` finds."""

    document: Literal["check"] = "check"
    task: str | None
    """As it was asked for; null if only the workspace was checked."""
    candidates: list[CheckedCandidate]
    """In the order of the task; empty without a task, or if the input has errors."""
    problems: list[ReportedProblem]
    """Errors and warnings about the input."""

    @classmethod
    def of(
        cls, workspace: str, task: str | None, found: Sequence[Feasibility], problems: Sequence[Problem]
    ) -> CheckDocument:
        """Candidates with their verdicts, and the findings about the workspace."""
        return cls(
            workspace=workspace,
            task=task,
            candidates=[CheckedCandidate.of(one) for one in found],
            problems=[ReportedProblem.of(problem) for problem in problems],
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class RulesDocument(Document):
    """What can be found, or one finding of it."""

    VIEW = "sqrp_cli.terminal.check_table:print_rules"

    document: Literal["rules"] = "rules"
    rules: list[RuleEntry]
    """All, subject by subject, or the requested one."""
