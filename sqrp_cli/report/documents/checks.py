"""`check` and `rules`: findings about a workspace and candidates of a task, and what each finding means."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sqrp_cli.report.documents.document import Document, Record

if TYPE_CHECKING:
    from sqrp_cli.checks.dependency_check import Feasibility
    from sqrp_cli.errors import Problem
    from sqrp_cli.programming.suggestion import SuggestedStep


@dataclass(frozen=True, kw_only=True)
class ReportedProblem(Record):
    """Something that is wrong or doubtful in the input."""

    code: str
    severity: Literal["error", "warning"]
    file: str | None
    line: int | None
    """From 1."""
    column: int | None
    message: str

    @classmethod
    def of(cls, problem: Problem) -> ReportedProblem:
        """A problem as a finding."""
        place = problem.place
        return cls(
            code=problem.code,
            severity=problem.severity,
            file=None if place is None else str(place.file),
            line=None if place is None else place.line,
            column=None if place is None else place.column,
            message=problem.message,
        )


@dataclass(frozen=True, kw_only=True)
class PlannedStep(Record):
    """A step that has to be done first, in its best way."""

    action: str
    feasible: bool
    q_avg: float | None
    q_eoi: float | None
    reasons: list[str]

    @classmethod
    def of(cls, step: SuggestedStep) -> PlannedStep:
        """A step of a suggestion."""
        return cls(
            action=step.action,
            feasible=step.feasible,
            q_avg=None if step.assessment is None else step.assessment.q_avg,
            q_eoi=None if step.assessment is None else step.assessment.q_eoi,
            reasons=list(step.reasons),
        )


@dataclass(frozen=True, kw_only=True)
class CheckedCandidate(Record):
    """Whether a candidate can be done."""

    parameters: Mapping[str, float | str]
    feasible: bool
    reasons: list[str]
    plan: list[PlannedStep] | None
    """What has to be done first; empty if nothing, null if no plan was found."""
    planning: str
    """How planning ended."""

    @classmethod
    def of(cls, found: Feasibility) -> CheckedCandidate:
        """What was found about a candidate."""
        steps = found.suggestion.steps
        return cls(
            parameters=found.candidate.parameters,
            feasible=found.feasible,
            reasons=list(found.reasons),
            plan=None if steps is None else [PlannedStep.of(step) for step in steps],
            planning=found.suggestion.outcome,
        )


@dataclass(frozen=True, kw_only=True)
class CheckDocument(Document):
    """What `sqrp check` finds."""

    workspace: str
    task: str | None
    candidates: list[CheckedCandidate]
    problems: list[ReportedProblem]

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


if TYPE_CHECKING:
    from sqrp_cli.checks.registry import Rule


@dataclass(frozen=True, kw_only=True)
class RuleEntry(Record):
    """What is known about one kind of finding."""

    code: str
    """As in `problems[].code`."""
    subject: str
    severity: list[Literal["error", "warning"]]
    """Both, where it depends on the case."""
    meaning: str
    why: str
    file: str | None
    """The file of the examples; null if they are command lines or descriptions."""
    passes: str
    """An example without the finding."""
    fails: str
    """An example with it."""

    @classmethod
    def of(cls, rule: Rule) -> RuleEntry:
        """A rule of the registry."""
        return cls(
            code=rule.code,
            subject=rule.subject,
            severity=[name for name in ("error", "warning") if name in rule.severity],
            meaning=rule.meaning,
            why=rule.why,
            file=rule.file,
            passes=rule.passes,
            fails=rule.fails,
        )


@dataclass(frozen=True, kw_only=True)
class RulesDocument(Document):
    """What can be found, or one finding of it."""

    rules: list[RuleEntry]

    @classmethod
    def of(cls, rules: Iterable[Rule]) -> RulesDocument:
        """Rules of the registry."""
        return cls(rules=[RuleEntry.of(rule) for rule in rules])
