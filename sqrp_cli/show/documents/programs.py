"""`program` and `init`: the steps of a program and their totals, and a workspace just made."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import field
from math import inf
from pathlib import Path
from typing import Literal

from sqrp_cli.cell.workspace_file import shortest_path, workspace_name
from sqrp_cli.document import LEFT_OUT, Document, Record, how_many, live
from sqrp_cli.errors import Problem
from sqrp_cli.figures import FaultMetrics, Qualities
from sqrp_cli.files.entries import from_fields
from sqrp_cli.program.file import workspace_path
from sqrp_cli.program.joint_trajectory import ToolCommand, action_name, tool_commands
from sqrp_cli.program.record import Program
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.report import Outcome
from sqrp_cli.show.documents.explanation import Span
from sqrp_cli.study.whole_analysis import mean_qualities


@dataclass(frozen=True, kw_only=True)
class ListedPrimitive(Span):
    """A primitive action, on the clock of the whole program [s]."""

    does: str
    """What it does, in a word or two."""
    action: str
    """What kind of action it is, such as `joint_move` or `grasp`."""
    held: str | None
    """The object in the tool throughout; null if there is none."""


@dataclass(frozen=True, kw_only=True)
class ListedStep(Qualities):
    """A step with its figures, on the clock of the whole program [s]."""

    task: str
    """As it was asked for."""
    label: str
    """The skill with its objects, such as `pickup g2`."""
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
    faults: Mapping[str, FaultMetrics]
    """By the fault's name."""
    happens: Mapping[str, str]
    """What happens at each fault, such as `it slips while it is lifted`, by its name."""
    verdict: str
    """Where it is blind, why, and what would help."""
    primitives: list[ListedPrimitive]
    """In the order in which they are done."""


@dataclass(frozen=True, kw_only=True)
class ProgramTotal(Qualities):
    """All steps together; Q is weighted with their time."""

    time: float
    """Duration of all steps [s]."""
    delay_worst: float | None
    """Longest time that a fault of any step may remain unnoticed [s]; null if none can happen, or one may never be
    noticed."""
    fault: str | None
    """Name of that fault."""
    step: int | None
    """Number of its step, from 1."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ProgramDocument(Document):
    """What `sqrp program` lists."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_program"

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
    held: str | None = None
    """The object that it leaves in the tool; null if there is none."""
    add: str | None = None
    """The command that adds a step; null while the workspace is not where it was."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.program} for {self.workspace}: {how_many(self.steps, 'step')}, {self.total.time:.2f} s"

    @classmethod
    def of(cls, program: Program, file: Path, *, stale: bool) -> ProgramDocument:
        """The steps with their figures, the totals, and what the tool has to do."""
        steps, start = [], 0.0
        for step in program.steps:
            primitives = []
            for one in step.primitives:
                said = {"does": one.does or one.name, "action": action_name(one)}
                span = {"start": start + one.start, "end": start + one.end}
                primitives.append(from_fields(ListedPrimitive, one, **said, **span))
            words = {one.fault: one.words for one in step.formulas}
            happens = {name: words.get(name) or f"`{name}` happens" for name in step.faults}
            known = {"label": step.short_task, "parameters": dict(step.parameters), "happens": happens}
            span = {"start": start, "end": start + step.time}
            steps.append(from_fields(ListedStep, step, **known, **span, primitives=primitives))
            start += step.time
        # The fault with the longest delay at worst; one that may never be noticed is the longest.
        faults = [(one.delay_worst, at, name) for at, s in enumerate(steps, 1) for name, one in s.faults.items()]
        none = None, None, None
        late, at, fault = max(faults, key=lambda one: inf if one[0] is None else one[0], default=none)
        qualities = mean_qualities((step, step.time, step.time) for step in steps)
        workspace = workspace_path(program, file)
        here = shlex.quote(os.path.relpath(shortest_path(workspace)))
        add = f"sqrp rank {here} TASK --program {shlex.quote(str(file))}"
        return cls(
            program=str(file),
            workspace=workspace_name(workspace),
            stale=stale,
            steps=steps,
            total=ProgramTotal(**vars(qualities), time=start, delay_worst=late, step=at, fault=fault),
            tool=tool_commands(program),
            held=program.steps[-1].after.held if program.steps else None,
            add=add if workspace.exists() else None,
        )


@dataclass(frozen=True, kw_only=True)
class FirstRun(Record):
    """How the best candidate of a new workspace ran in the simulated cell, once."""

    outcome: Outcome
    """Whether all was done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    reason: str | None
    """Why it stopped, or what was not noticed; null if it is done."""
    time: float
    """Simulated [s]."""
    promised: int
    """Images of a camera that were predicted to show a literal."""
    seen: int
    """Those of them that did."""


@dataclass(frozen=True, kw_only=True, repr=False)
class NewCell(Document):
    """What `sqrp init` has made: a new workspace."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_new_cell"

    document: Literal["init"] = "init"
    workspace: str
    """Its folder."""
    tool_link: str
    """The link of the robot that carries the tool, or grasps itself."""
    fingers: list[str]
    """The joints that drive the fingers of its gripper; none of a suction cup."""
    width: float | None
    """How wide the fingers open [m]; null for a suction cup."""
    objects: list[str]
    """Names of the cubes that stand on the table."""
    task: str | None
    """A task that can be ranked at once."""
    run: FirstRun | None
    """Of its best candidate; null if it was not run, as without a simulator."""
    path: str
    """Of its folder, as it was given."""
    own_arm: bool
    """Whether the arm is the user's, so that some values were guessed."""
    told: tuple[str, ...] = field(default=(), metadata=LEFT_OUT)
    """What was guessed of its recording, in sentences."""

    problems: Sequence[Problem] = live(())
    """Warnings about the arm."""

    @property
    def works(self) -> bool:
        """Whether there is a task to rank and, if it was run, it was done."""
        return self.task is not None and (self.run is None or self.run.outcome == "done")

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.path}: {self.task or 'nothing within reach'}"
