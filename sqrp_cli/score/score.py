"""What to score: every task of the workspaces of folders, files and patterns; its best candidate, and if it passes."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Literal

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import ExpectedTask, Workspace
from sqrp_cli.cell.workspace_file import WORKSPACE_FILE, workspace_file
from sqrp_cli.checks.lint import lint
from sqrp_cli.document import Record, live
from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.figures import falls_short
from sqrp_cli.records import dataclass
from sqrp_cli.score.changes import Comparison
from sqrp_cli.score.work.compute import Computer, Wanted
from sqrp_cli.score.work.identity import content_digest
from sqrp_cli.search.suggestion import with_first_steps
from sqrp_cli.shown import shown_name
from sqrp_cli.study.pipeline import described
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.verdict import HELP
from sqrp_cli.task.candidate import THEN
from sqrp_cli.task.task import Candidate, Task, read_task


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
        if not pattern:
            message = f"PATH is empty; expected a workspace, which is a folder with a {WORKSPACE_FILE}"
            raise bad_input("no-workspace", message)
        if Path(pattern).exists() or not glob.has_magic(pattern):
            matches = [Path(pattern)]
        else:
            matches = [Path(match) for match in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207
        files = [file for match in matches for file in _files(match)]
        if not files:
            # A single path that does not exist is explained by whoever reads workspaces.
            files = [] if glob.has_magic(pattern) else [workspace_file(Path(pattern))]
        if not files:
            message = f"no workspace fits `{pattern}`; a workspace is a folder with a {WORKSPACE_FILE}"
            raise bad_input("no-workspace", message, Place(Path(pattern)))
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


Status = Literal["passed", "failed", "error"]


@dataclass(frozen=True, eq=False)
class TaskScore(Record):
    """The score of a task in a workspace, compared with its baseline."""

    workspace: str
    """Its name, with as much of its path as makes it unique."""
    task: str | None
    """Null where the workspace itself cannot be used."""
    status: Status
    """Failed if the task is not good enough or got worse; error if it cannot be ranked."""
    reasons: tuple[str, ...]
    """What is not good enough or got worse, or what the error is, in a sentence each."""
    best: CandidateResult | None = None
    """The first in the ranking; null if none is feasible."""
    baseline: Comparison | None = None
    """What changed since the baseline; null without a baseline, or after an error."""
    ways: Mapping[str, CandidateResult] = live(factory=dict)
    """The best candidate for every choice of objects, by `way_name`; infeasible where none of them is feasible."""
    content: str = live("")
    """Digest of the workspace, see `identity.content_digest`."""

    @property
    def named(self) -> str:
        """Workspace and task, for display."""
        return self.workspace if self.task is None else f"{self.workspace}, {self.task}"


def wanted_of(cell: ScoredCell) -> tuple[Wanted, ...]:
    """The candidates of a workspace's tasks, to be computed."""
    return tuple(want for task in cell.tasks for want in _wanted(cell, task))


def _wanted(cell: ScoredCell, task: ScoredTask) -> tuple[Wanted, ...]:
    if cell.workspace is None or task.task is None:
        return ()
    return tuple(Wanted(cell.workspace, task.content, candidate) for candidate in task.task.candidates)


def score(cells: Sequence[ScoredCell], computer: Computer, advance: Callable[[int], None]) -> tuple[TaskScore, ...]:
    """Score every task of some workspaces; an unusable workspace has one score, without a task.

    `advance` is called with the number of finished candidates. Raises InputError if results cannot be kept.
    """
    computer.compute([want for cell in cells for want in wanted_of(cell)], advance)
    return tuple(result for cell in cells for result in scores_of(cell, computer))


def scores_of(cell: ScoredCell, computer: Computer) -> Iterator[TaskScore]:
    """The scores of a workspace's finished tasks: each candidate is computed, or cannot be."""
    if cell.workspace is None:
        yield TaskScore(cell.name, None, "error", _sentences(cell.problems))
    for task in cell.tasks:
        result = _task_score(cell, task, computer)
        if result is not None:
            yield result


def way_name(candidate: Candidate) -> str:
    """The name of a choice of objects of a task, such as `g1`, `g1 tray` or `peg1 then peg1 socket`."""
    if candidate.steps:
        return THEN.join(map(way_name, candidate.steps))
    return " ".join(candidate.binding.values()) or candidate.skill.name


def _task_score(cell: ScoredCell, task: ScoredTask, computer: Computer) -> TaskScore | None:
    if task.task is None:
        return TaskScore(cell.name, task.text, "error", _sentences(task.problems))
    assessments = []
    for want in _wanted(cell, task):
        problems = computer.why_not(want)
        if problems:
            return TaskScore(cell.name, task.text, "error", _sentences(problems))
        outcome = computer.outcome(want)
        if outcome is None:
            return None
        assessments.append(outcome.assessment)
    ranking = rank(assessments, "q_eoi")
    ways: dict[str, CandidateResult] = {}
    for ranked in ranking:
        ways.setdefault(way_name(ranked.candidate), ranked)
    best = described(ranking[0]) if ranking[0].feasible else None
    first = ranking[0]
    why_none = f"{first.candidate.name}: {first.reasons[0]}" if best is None else ""
    reasons = shortcomings(best, task.expected, why_none)
    return TaskScore(
        workspace=cell.name,
        task=task.text,
        status="failed" if reasons else "passed",
        reasons=reasons,
        best=best,
        ways=ways,
        content=task.content,
    )


def _sentences(problems: Sequence[Problem]) -> tuple[str, ...]:
    return tuple(f"{problem}" + (f"; to mend it: {problem.mend}" if problem.mend else "") for problem in problems)


def shortcomings(best: CandidateResult | None, expected: ExpectedTask, why_none: str) -> tuple[str, ...]:
    """One sentence for each expectation that is not met; none if all are.

    best: the first in the ranking; None if no candidate is feasible, and then `why_none` says why. A task is expected
    to be feasible unless `expected` says otherwise.
    """
    if best is None:
        return () if expected.feasible is False else (f"no candidate can be done: {why_none}",)
    return tuple(_shortcomings(best, expected))


def _shortcomings(best: CandidateResult, expected: ExpectedTask) -> Iterator[str]:
    name = best.candidate.name
    lost = best.verdict.split(HELP)[0]
    if expected.feasible is False:
        yield f"{name} can be done, but no candidate was expected to be"
    qualities = (("Q_eoi", best.q_eoi, expected.min_q_eoi), ("Q_avg", best.q_avg, expected.min_q_avg))
    for label, quality, least in qualities:
        if least is None:
            continue
        if quality is None:
            yield f"{label} of {name} is undefined, expected at least {100 * least:g} %"
        elif falls_short(quality, least):
            yield f"{label} of {name} is {100 * quality:.1f} %, expected at least {100 * least:g} %: {lost}"
    if expected.max_time is not None and best.time is not None and best.time > expected.max_time:
        yield f"{name} takes {best.time:.2f} s, expected at most {expected.max_time:g} s"
    delay = best.latest
    if expected.max_delay is not None and delay is not None and delay > expected.max_delay:
        fault = max(best.faults, key=lambda fault: (best.faults[fault].unseen, best.faults[fault].delay_worst or 0.0))
        most = f"expected at most {expected.max_delay:g} s"
        hidden = best.faults[fault].blind_longest and lost != NOTHING_MISSING
        why = lost if hidden else best.why_late
        noticed = "never be noticed" if delay == inf else f"be noticed only after {delay:.2f} s"
        yield f"the fault {fault} of {name} may {noticed}, {most}: {why}"
    if expected.winner is not None and expected.winner not in best.candidate.binding.values():
        yield f"{name} is best, expected one with {expected.winner}"
