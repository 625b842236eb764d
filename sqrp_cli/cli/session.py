"""What every command about a task begins with: the cell, the world it starts from, and the candidates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sqrp_cli.knowledge.workspace import Workspace, World
from sqrp_cli.program import check_program, load_program, new_program, save_program
from sqrp_cli.programming.assessment import Assessment, Study, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.program_update import make_step
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.programming.robustness import Calibration
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.task import Task, read_task
from sqrp_cli.programming.verdict import verdict


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
        cls,
        workspace: Workspace,
        task: str,
        before: Path | None,
        sampling: Sampling,
        calibration: Calibration | None = None,
    ) -> Session:
        """Read the task, load the cell and find the world to start from.

        before: a program whose final world that is; the workspace's own state by default. Raises InputError for input
        that cannot be used.
        """
        read = read_task(task, workspace)
        cell = Cell.load(workspace)
        world = cell.initial_world if before is None else _world_after(before, cell)
        return cls(workspace, read, Assignment(cell, world, sampling, calibration))


def _world_after(path: Path, cell: Cell) -> World:
    program = load_program(path)
    check_program(program, path, cell.workspace)
    return program.steps[-1].after.world if program.steps else cell.initial_world


def explain(session: Session, ranked: Ranked) -> tuple[Ranked, Study | None]:
    """A candidate with the study of every camera's verdicts and the figures of that; no study if it is infeasible."""
    if ranked.rank is None:
        return ranked, None
    cell, assignment = session.cell, session.assignment
    found = study(cell, ranked.assessment.candidate, assignment.world, assignment.sampling, full=True)
    if isinstance(found, Infeasible):
        raise ValueError(f"{ranked.assessment.candidate.name} was feasible a moment ago")
    return replace(ranked, assessment=found.assessment(verdict(cell, found))), found


def add_step(session: Session, assessment: Assessment, path: Path) -> None:
    """Append a feasible candidate to a program file, which is made if it does not exist."""
    assignment, cell = session.assignment, session.cell
    found = study(cell, assessment.candidate, assignment.world, assignment.sampling, full=True)
    if isinstance(found, Infeasible):
        raise ValueError(f"{assessment.candidate.name} is infeasible: {found.reasons[0]}")
    cameras = tuple(camera.name for camera in cell.observer.cameras)
    step = make_step(session.task.text, found, assessment, cameras)
    program = load_program(path) if path.exists() else new_program(session.workspace, cell.model.joints, path)
    check_program(program, path, session.workspace)
    save_program(program.with_step(step), path)
