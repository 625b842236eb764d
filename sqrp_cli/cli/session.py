"""What every command about a task begins with: the cell, the world it starts from, and the candidates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.assessment import Assessment
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.task import Task, read_task


@dataclass(frozen=True, eq=False)
class Session:
    """A task in a cell."""

    workspace: Workspace
    task: Task
    assignment: Assignment

    @property
    def cell(self) -> Cell:
        """The cell."""
        return self.assignment.cell

    @classmethod
    def begin(
        cls, workspace: Workspace, task: str, after: Path | None, program: Path | None, sampling: Sampling, seed: int
    ) -> Session:
        """Read the task, load the cell and find the world to start from.

        after: a program whose final world that is. program: a file that a step will be added to; if it exists, and `after` is not given, its
        final world is where the task starts. Raises InputError for input that cannot be used.
        """
        read = read_task(task, workspace)
        world = workspace.initial_world
        return cls(workspace, read, Assignment(Cell.load(workspace), world, sampling))


def add_step(session: Session, assessment: Assessment, path: Path) -> None:
    """Append a feasible candidate to a program file."""
