"""`check` and `rules`: findings about a workspace and candidates of a task, and what each finding means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from sqrp_cli.checks.registry import RuleEntry
from sqrp_cli.document import LEFT_OUT, Document, Record, WorkspaceDocument, how_many, live
from sqrp_cli.errors import Finding
from sqrp_cli.files.entries import from_fields
from sqrp_cli.records import dataclass
from sqrp_cli.search.planned_step import CheckedCandidate, PlannedStep

if TYPE_CHECKING:
    from sqrp_cli.errors import Problem
else:  # no file has them
    Problem = Any


@dataclass(frozen=True, kw_only=True)
class ReportedProblem(Finding, Record):
    """Something that is wrong or doubtful in the input."""

    severity: Literal["error", "warning"]
    """Errors make the input unusable, warnings do not."""
    file: str | None
    """Its path; null if it is about no file."""
    line: int | None
    """From 1; null if it is about the whole file."""
    column: int | None
    """From 1; null if it is about the whole line or file."""

    @classmethod
    def of(cls, problem: Problem) -> ReportedProblem:
        """A problem as a finding."""
        if (place := problem.place) is None:
            return from_fields(cls, problem, file=None, line=None, column=None)
        return from_fields(cls, problem, place, file=str(place.file))


@dataclass(frozen=True, kw_only=True, repr=False)
class Check(WorkspaceDocument):
    """The findings about a workspace, and which candidates of a task can be done."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_check"

    document: Literal["check"] = "check"
    task: str | None
    """As it was asked for; null if only the workspace was checked."""
    candidates: list[CheckedCandidate]
    """In the order of the task; empty without a task, or if the input has errors."""
    problems: list[ReportedProblem]
    """Errors and warnings about the input."""
    path: str
    """Of the workspace, as it was given."""
    suggested: list[PlannedStep]
    """What has to be done first, and then the task, each in its best way; empty where that was not asked for."""
    example: str | None = field(default=None, metadata=LEFT_OUT)
    """A task of the workspace, if none was asked for."""

    findings: tuple[Problem, ...] = live(())
    """The problems with all that is known of them."""

    @classmethod
    def of(
        cls,
        path: str,
        workspace: str,
        task: str | None,
        problems: Sequence[Problem],
        candidates: Sequence[CheckedCandidate] = (),
        suggested: Sequence[PlannedStep] = (),
        example: str | None = None,
    ) -> Check:
        """Candidates with their verdicts, and the findings about the workspace."""
        return cls(
            workspace=workspace,
            task=task,
            candidates=list(candidates),
            problems=[ReportedProblem.of(problem) for problem in problems],
            path=path,
            suggested=list(suggested),
            example=example,
            findings=tuple(problems),
        )

    @property
    def valid(self) -> bool:
        """Whether nothing is wrong; warnings are not errors."""
        return all(problem.severity != "error" for problem in self.problems)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        about = self.workspace if self.task is None else f"{self.task} in {self.workspace}"
        feasible, candidates = sum(one.feasible for one in self.candidates), how_many(self.candidates, "candidate")
        found = "" if self.task is None or not self.valid else f"{feasible} of {candidates} can be done, "
        return f"{about}: {found}{'valid' if self.valid else 'not valid'}, {how_many(self.problems, 'problem')}"


@dataclass(frozen=True, kw_only=True, repr=False)
class RulesDocument(Document):
    """What can be found, or one finding of it."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_rules"

    document: Literal["rules"] = "rules"
    rules: list[RuleEntry]
    """All, subject by subject, or the requested one."""
