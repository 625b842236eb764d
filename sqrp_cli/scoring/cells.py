"""What to score: the workspaces of folders, files and patterns, with their tasks."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.knowledge.workspace.workspace import ExpectedTask, Workspace
from sqrp_cli.knowledge.workspace.workspace_file import WORKSPACE_FILE, workspace_file
from sqrp_cli.programming.suggestion import with_first_steps
from sqrp_cli.programming.task import Task, read_task
from sqrp_cli.scoring.work.identity import content_digest
from sqrp_cli.shown import shown_name


@dataclass(frozen=True, eq=False)
class ScoredTask:
    """A task that a workspace lists."""

    text: str
    expected: ExpectedTask
    task: Task | None
    """With its candidates; None if the text cannot be read."""
    content: str
    """Digest of what the figures depend on, see `identity.content_digest`."""
    problems: tuple[Problem, ...] = ()
    """Why the text cannot be read."""


@dataclass(frozen=True, eq=False)
class ScoredCell:
    """A workspace to be scored."""

    name: str
    """Its name in the output."""
    workspace: Workspace | None
    """None if `problems` has an error."""
    tasks: tuple[ScoredTask, ...] = ()
    problems: tuple[Problem, ...] = ()

    @property
    def content(self) -> str:
        """A digest of the bytes of all its files; empty without a workspace."""
        return "" if self.workspace is None else self.workspace.file_digest


def read_cells(files: Sequence[Path]) -> Iterator[ScoredCell]:
    """The workspaces in some files, yielded one by one as they are read."""
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
    contents: dict[tuple[str, ...], str] = {}
    for expected in workspace.tasks:
        try:
            task = read_task(expected.task, workspace)
        except InputError as error:
            tasks.append(ScoredTask(expected.task, expected, None, "", error.problems))
            continue
        if expected.feasible is not False:
            task = with_first_steps(task, workspace)
        steps = task.candidates[0].steps or task.candidates[:1]
        skills = tuple(dict.fromkeys(step.skill.name for step in steps))
        if skills not in contents:
            contents[skills] = content_digest(workspace, *skills)
        tasks.append(ScoredTask(expected.task, expected, task, contents[skills]))
    return tuple(tasks)


def find_workspaces(patterns: Sequence[str]) -> tuple[Path, ...]:
    """The workspace files that match patterns, each once: in the order of the patterns, each pattern's by name.

    They begin with what the pattern says, so messages name them as the user did.

    A pattern is a workspace file, the folder of one, a folder with workspaces at any depth below it (hidden folders
    left out), or a glob of those (`cells/*`, `**` for any depth). Raises InputError for one without a match.
    """
    found: dict[Path, Path] = {}
    for pattern in patterns:
        if Path(pattern).exists() or not glob.has_magic(pattern):
            matches = [Path(pattern)] if pattern else []
        else:
            matches = [Path(match) for match in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207
        files = [file for match in matches for file in _files(match)]
        if not files:
            # A single path that does not exist is explained by whoever reads workspaces.
            files = [] if glob.has_magic(pattern) or not pattern else [workspace_file(Path(pattern))]
        if not files:
            message = f"no workspace fits `{pattern}`; a workspace is a folder with a {WORKSPACE_FILE}"
            raise InputError(Problem("no-workspace", message, Place(Path(pattern))))
        for file in files:
            found.setdefault(file.absolute(), file)
    return tuple(found.values())


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix in (".yaml", ".yml") else []
    if (path / WORKSPACE_FILE).is_file():
        return [path / WORKSPACE_FILE]
    found = path.rglob(WORKSPACE_FILE)
    return sorted(file for file in found if not any(part.startswith(".") for part in file.relative_to(path).parts))


def short_names(files: Sequence[Path]) -> Mapping[Path, str]:
    """The name of each workspace in the output: its folder's, with as much of its path as makes it unique."""
    names: dict[Path, str] = {}
    whole = {file: file.absolute() for file in files}
    paths = {file: at.parent if at.name == WORKSPACE_FILE else at.with_suffix("") for file, at in whole.items()}
    for file, path in paths.items():
        count = 1
        while count < len(path.parts) and any(
            other.parts[-count:] == path.parts[-count:] for at, other in paths.items() if at != file
        ):
            count += 1
        names[file] = shown_name("/".join(path.parts[-count:]))
    return names
