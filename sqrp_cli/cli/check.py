"""`sqrp check`: whether a workspace is sound, and whether a task can be done in it."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import After, Json, Seed, WorkspacePath
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqrp_cli.programming.dependency_check import Feasibility

NAME = "check"


def command(
    workspace: WorkspacePath,
    task: Annotated[
        str | None, typer.Argument(metavar="TASK", help='Check this task as well, such as "pickup green".')
    ] = None,
    after: After = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Validate a workspace, and a task in it.

    With a task, say which of its candidates can be done, why the others cannot, and what would have to be done first.
    """
    from sqrp_cli.cli.console import say_raw
    from sqrp_cli.cli.documents import as_text, check_document

    try:
        name, problems, found = _check(workspace, task, after, seed)
    except InputError as error:
        if not as_json:
            raise
        say_raw(as_text(check_document(workspace.name, task, (), error.problems)))
        return ExitCode.BAD_INPUT
    if as_json:
        say_raw(as_text(check_document(name, task, found, problems)))
    else:
        _print(workspace, name, task, problems, found)
    if any(problem.severity == "error" for problem in problems):
        return ExitCode.BAD_INPUT
    if task is not None and not any(feasibility.feasible for feasibility in found):
        return ExitCode.NONE_FEASIBLE
    return ExitCode.OK


def _check(
    path: Path, task: str | None, after: Path | None, seed: int
) -> tuple[str, tuple[Problem, ...], tuple[Feasibility, ...]]:
    """Name of the workspace, its findings, and the candidates of the task with their verdicts."""
    from sqrp_cli.cli.console import progress
    from sqrp_cli.cli.session import Session
    from sqrp_cli.knowledge.lint import lint
    from sqrp_cli.knowledge.load import load_workspace
    from sqrp_cli.programming.dependency_check import check_candidate
    from sqrp_cli.programming.sampling import Adaptive

    workspace = load_workspace(path)
    problems = (*workspace.warnings, *lint(workspace))
    if task is None or any(problem.severity == "error" for problem in problems):
        return workspace.name, problems, ()
    session = Session.begin(workspace, task, after, Adaptive(), seed=seed)
    found = []
    with progress(f"Checking {task}", len(session.task.candidates)) as advance:
        for candidate in session.task.candidates:
            found.append(check_candidate(session.cell, candidate, session.assignment.world))
            advance()
    return workspace.name, (*problems, *session.cell.warnings), tuple(found)


def _print(
    workspace: Path, name: str, task: str | None, problems: Sequence[Problem], found: Sequence[Feasibility]
) -> None:
    from sqrp_cli.cli.console import Column, plain, print_problems, print_table, say

    print_problems(problems)
    if any(problem.severity == "error" for problem in problems):
        return
    if task is None:
        findings = (
            f"{len(problems)} warning{'s' if len(problems) > 1 else ''}" if problems else "nothing to complain about"
        )
        say(f"{name} is valid: {findings}. Try: sqrp rank {shlex.quote(str(workspace))} TASK")
        return
    feasible = sum(feasibility.feasible for feasibility in found)
    say(f"{task} in {name}: {feasible} of {len(found)} candidates can be done\n")
    rows = [
        (
            feasibility.candidate.name,
            plain("yes", "green") if feasibility.feasible else plain("no", "red"),
            f"{feasibility.time:.2f}" if feasibility.time is not None else "",
            "; ".join(filter(None, [*feasibility.reasons, feasibility.suggestion.explanation])),
        )
        for feasibility in found
    ]
    print_table(
        [Column("candidate"), Column("feasible"), Column("time s", right=True), Column("why not", shrink=True)], rows
    )
    around = [f"{one.candidate.name}: {', '.join(one.ways_around)}" for one in found if one.ways_around]
    if around:
        say("\n" + "\n".join(around))
