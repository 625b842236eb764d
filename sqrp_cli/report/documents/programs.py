"""`program`: the steps of a program and their totals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sqrp_cli.document import Document, Record
from sqrp_cli.figures import FaultMetrics
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.workspace_file import workspace_name
from sqrp_cli.program.file import workspace_path
from sqrp_cli.program.joint_trajectory import ToolCommand, action_name, tool_commands
from sqrp_cli.program.record import Program, Step, Totals


@dataclass(frozen=True, kw_only=True)
class ListedPrimitive(Record):
    """A primitive action, on the clock of the whole program [s]."""

    name: str
    """As in the skill."""
    does: str
    """What it does, in a word or two."""
    action: str
    """What kind of action it is, such as `joint_move` or `grasp`."""
    start: float
    """When it begins [s]."""
    end: float
    """When it ends [s]."""
    held: str | None
    """The object in the tool throughout; null if there is none."""


@dataclass(frozen=True, kw_only=True)
class ListedStep(Record):
    """A step with its figures, on the clock of the whole program [s]."""

    task: str
    """As it was asked for."""
    skill: str
    """Name of the skill."""
    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    start: float
    """When it begins [s]."""
    end: float
    """When it ends [s]."""
    time: float
    """Duration of its motion [s]."""
    q_avg: float | None
    """Q_avg in 0..1; null where no formula applies."""
    q_eoi: float | None
    """Q_eoi in 0..1; null where there is no event of interest."""
    faults: Mapping[str, FaultMetrics]
    """By the fault's name."""
    verdict: str
    """Where it is blind, why, and what would help."""
    primitives: list[ListedPrimitive]
    """In the order in which they are done."""

    @classmethod
    def of(cls, step: Step, start: float) -> ListedStep:
        """A step that begins at a time [s]."""
        return completed(
            cls,
            step,
            parameters=dict(step.parameters),
            start=start,
            end=start + step.time,
            primitives=[
                completed(
                    ListedPrimitive,
                    primitive,
                    does=primitive.does or primitive.name,
                    action=action_name(primitive),
                    start=start + primitive.start,
                    end=start + primitive.end,
                )
                for primitive in step.primitives
            ],
        )


@dataclass(frozen=True, kw_only=True)
class ProgramTotal(Record):
    """All steps together; Q is weighted with their time."""

    time: float
    """Duration of all steps [s]."""
    q_avg: float | None
    """Mean Q_avg in 0..1 of the steps that have one; null if none has."""
    q_eoi: float | None
    """Mean Q_eoi in 0..1 of the steps that have one; null if none has."""
    delay_worst: float | None
    """Longest time that a fault of any step may remain unnoticed [s]; null if none can happen."""
    fault: str | None
    """Name of that fault."""
    step: int | None
    """Number of its step, from 1."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ProgramDocument(Document):
    """What `sqrp program` lists."""

    document: Literal["program"] = "program"
    program: str
    """Path of the program file, as it was given."""
    workspace: str
    """Name of the workspace's folder."""
    stale: bool
    """Whether the workspace has changed since."""
    steps: list[ListedStep]
    """In the order in which they are done."""
    total: ProgramTotal
    """Figures of all steps together."""
    tool: tuple[ToolCommand, ...]
    """When the tool has to grasp and release what, in order of time."""

    @classmethod
    def of(cls, program: Program, file: Path, *, stale: bool) -> ProgramDocument:
        """The steps with their figures, the totals, and what the tool has to do."""
        totals = Totals.of(program)
        worst = totals.worst
        return cls(
            program=str(file),
            workspace=workspace_name(workspace_path(program, file)),
            stale=stale,
            steps=list(_steps(program)),
            total=completed(
                ProgramTotal,
                totals,
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
