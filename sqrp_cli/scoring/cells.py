"""What is to be scored: every workspace with its tasks, or why it cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.knowledge.workspace.workspace import ExpectedTask, Workspace
from sqrp_cli.programming.task import Task, read_task
from sqrp_cli.scoring.discovery import short_names
from sqrp_cli.scoring.work.identity import content_digest


@dataclass(frozen=True, eq=False)
class ScoredTask:
    """A task that a workspace lists.

    task: with its candidates; None where the text cannot be read, and then `problems` says why. content: see
    `identity.content_digest`.
    """

    text: str
    expected: ExpectedTask
    task: Task | None
    content: str
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True, eq=False)
class ScoredCell:
    """A workspace to be scored. name: what output calls it. workspace: None where `problems` has an error."""

    name: str
    workspace: Workspace | None
    tasks: tuple[ScoredTask, ...] = ()
    problems: tuple[Problem, ...] = ()


def read_cells(files: Sequence[Path]) -> Iterator[ScoredCell]:
    """The workspaces in some files, each as soon as it is read."""
    for file, name in short_names(files).items():
        yield read_cell(file, name)


def read_cell(file: Path, name: str, content: bytes | None = None) -> ScoredCell:
    """A workspace, read as `load_workspace` does."""
    try:
        workspace = load_workspace(file, content)
    except InputError as error:
        return ScoredCell(name, None, problems=error.problems)
    problems = (*workspace.warnings, *lint(workspace))
    errors = tuple(problem for problem in problems if problem.severity == "error")
    if errors:
        return ScoredCell(name, None, problems=errors)
    return ScoredCell(name, workspace, _tasks(workspace), problems)


def _tasks(workspace: Workspace) -> tuple[ScoredTask, ...]:
    tasks = []
    contents: dict[str, str] = {}
    for expected in workspace.tasks:
        try:
            task = read_task(expected.task, workspace)
        except InputError as error:
            tasks.append(ScoredTask(expected.task, expected, None, "", error.problems))
            continue
        skill = task.skill.name
        if skill not in contents:
            contents[skill] = content_digest(workspace, skill)
        tasks.append(ScoredTask(expected.task, expected, task, contents[skill]))
    return tuple(tasks)
