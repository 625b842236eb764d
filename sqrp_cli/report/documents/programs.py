"""`program`: the steps of a program and their totals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.program.file import workspace_path
from sqrp_cli.program.joint_trajectory import ToolCommand, action_name, tool_commands
from sqrp_cli.program.record import FaultMetrics, Totals
from sqrp_cli.report.documents.document import Document, Record

if TYPE_CHECKING:
    from sqrp_cli.program.record import Program, Step


@dataclass(frozen=True, kw_only=True)
class ListedPrimitive(Record):
    """A primitive action, on the clock of the whole program [s]."""

    name: str
    action: str
    start: float
    end: float
    held: str | None


@dataclass(frozen=True, kw_only=True)
class ListedStep(Record):
    """A step with its figures, on the clock of the whole program [s]."""

    task: str
    skill: str
    parameters: Mapping[str, float | str]
    start: float
    end: float
    time: float
    q_avg: float | None
    q_eoi: float | None
    faults: Mapping[str, FaultMetrics]
    verdict: str
    primitives: list[ListedPrimitive]

    @classmethod
    def of(cls, step: Step, start: float) -> ListedStep:
        """A step that begins at a time [s]."""
        return cls(
            task=step.task,
            skill=step.skill,
            parameters=dict(step.parameters),
            start=start,
            end=start + step.time,
            time=step.time,
            q_avg=step.q_avg,
            q_eoi=step.q_eoi,
            faults=step.faults,
            verdict=step.verdict,
            primitives=[
                ListedPrimitive(
                    name=primitive.name,
                    action=action_name(primitive),
                    start=start + primitive.start,
                    end=start + primitive.end,
                    held=primitive.held,
                )
                for primitive in step.primitives
            ],
        )


@dataclass(frozen=True, kw_only=True)
class ProgramTotal(Record):
    """All steps together; Q is weighted with their time."""

    time: float
    q_avg: float | None
    q_eoi: float | None
    delay_worst: float | None
    """The slowest alarm [s]."""
    fault: str | None
    """Its fault."""
    step: int | None
    """Its step, from 1."""


@dataclass(frozen=True, kw_only=True)
class ProgramDocument(Document):
    """What `sqrp program` lists."""

    program: str
    workspace: str
    stale: bool
    """Whether the workspace has changed since."""
    steps: list[ListedStep]
    total: ProgramTotal
    tool: tuple[ToolCommand, ...]

    @classmethod
    def of(cls, program: Program, file: Path, *, stale: bool) -> ProgramDocument:
        """The steps with their figures, the totals, and what the tool has to do."""
        totals = Totals.of(program)
        worst = totals.worst
        return cls(
            program=str(file),
            workspace=workspace_path(program, file).parent.name,
            stale=stale,
            steps=list(_steps(program)),
            total=ProgramTotal(
                time=totals.time,
                q_avg=totals.q_avg,
                q_eoi=totals.q_eoi,
                delay_worst=None if worst is None else worst.seconds,
                fault=None if worst is None else worst.fault,
                step=None if worst is None else worst.step,
            ),
            tool=tool_commands(program),
        )


def _steps(program: Program) -> Iterator[ListedStep]:
    start = 0.0
    for step in program.steps:
        yield ListedStep.of(step, start)
        start += step.time
