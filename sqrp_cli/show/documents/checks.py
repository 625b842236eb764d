"""`check` and `rules`: findings about a workspace and candidates of a task, and what each finding means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from sqrp_cli.checks.registry import RuleEntry
from sqrp_cli.document import LEFT_OUT, Document, Record, WorkspaceDocument, how_many, live
from sqrp_cli.errors import Finding
from sqrp_cli.files.entries import from_fields
from sqrp_cli.records import dataclass
from sqrp_cli.search.planned_step import PlannedStep

if TYPE_CHECKING:
    from sqrp_cli.errors import Problem
    from sqrp_cli.search.suggestion import Feasibility
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
    name: str
    """What sets it apart among the candidates of its task."""
    objects: Mapping[str, str]
    """The object of each parameter that stands for one."""
    remarks: tuple[str, ...]
    """Detours and speeds that are not reached."""
    advice: str
    """What would have to be done first, or why nothing would help, in words; empty if nothing has to be."""


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
        found: Sequence[Feasibility] = (),
        suggested: Sequence[PlannedStep] = (),
        example: str | None = None,
    ) -> Check:
        """Candidates with their verdicts, and the findings about the workspace."""
        candidates = []
        for one in found:
            steps, in_pieces = one.suggestion.steps, one.candidate.skill.in_pieces
            said = {"reasons": [*map(in_pieces, one.reasons)], "remarks": tuple(map(in_pieces, one.remarks))}
            plan = {"plan": None if steps is None else list(steps), "planning": one.suggestion.outcome}
            known = {**said, **plan, "objects": dict(one.candidate.binding), "advice": one.suggestion.words}
            candidates.append(from_fields(CheckedCandidate, one.candidate, one.suggestion, one, **known))
        return cls(
            workspace=workspace,
            task=task,
            candidates=candidates,
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
