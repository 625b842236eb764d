"""`sqrp check`: whether a workspace is sound, and whether a task can be done in it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import After, Jobs, Json, Seed, WorkspacePath, job_count
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqrp_cli.knowledge.workspace import Workspace
    from sqrp_cli.logic.planner import Planner
    from sqrp_cli.programming.dependency_check import Feasibility
    from sqrp_cli.programming.suggestion import SuggestedStep, Suggestion

NAME = "check"


def command(
    workspace: WorkspacePath,
    task: Annotated[
        str | None, typer.Argument(metavar="TASK", help='Check this task as well, such as "pickup green".')
    ] = None,
    after: After = None,
    program: Annotated[
        Path | None,
        typer.Option("--program", metavar="FILE", help="Append what has to be done, each step in its best way."),
    ] = None,
    planner: Annotated[
        str | None, typer.Option("--planner", metavar="NAME", help="Plan with this engine of unified-planning.")
    ] = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> ExitCode:
    """Validate a workspace, and a task in it.

    With a task, say which of its candidates can be done, why the others cannot, and what would have to be done first.
    """
    from sqrp_cli.cli.console import note, say, say_raw
    from sqrp_cli.report.documents.checks import CheckDocument
    from sqrp_cli.report.documents.document import as_text

    if task is None and (program is not None or planner is not None):
        option = "--program" if program is not None else "--planner"
        raise InputError(Problem("bad-option", f"{option} is about a task, which is missing"))
    try:
        checked = _check(workspace, task, after, program, planner, job_count(jobs), seed)
    except InputError as error:
        if not as_json:
            raise
        say_raw(as_text(CheckDocument.of(workspace.name, task, (), error.problems)))
        return ExitCode.BAD_INPUT
    if as_json:
        say_raw(as_text(CheckDocument.of(checked.name, task, checked.found, checked.problems)))
    else:
        _print(workspace, task, checked)
        if task is not None and checked.suggested and program is None:
            say(f"\nTo write this as a program: sqrp check {shlex.join([str(workspace), task])} --program FILE")
    if any(problem.severity == "error" for problem in checked.problems):
        return ExitCode.BAD_INPUT
    if program is not None:
        if not checked.suggested:
            note(f"there is nothing that could be done, so {program} was left as it was")
            return ExitCode.NONE_FEASIBLE
        note(f"{', then '.join(step.task for step in checked.suggested)}: now at the end of {program}")
        return ExitCode.OK
    if task is not None and not any(feasibility.feasible for feasibility in checked.found):
        return ExitCode.NONE_FEASIBLE
    return ExitCode.OK


@dataclass(frozen=True)
class _Checked:
    """Name of the workspace, its findings, the candidates of the task with their verdicts, and what to do."""

    name: str
    problems: tuple[Problem, ...]
    found: tuple[Feasibility, ...] = ()
    suggested: tuple[SuggestedStep, ...] = ()


def _check(
    path: Path, task: str | None, after: Path | None, program: Path | None, planner: str | None, jobs: int, seed: int
) -> _Checked:
    """Check everything, and write the program if one is asked for and there is something to do."""
    from sqrp_cli.cli.console import progress
    from sqrp_cli.cli.session import Session, add_steps, chosen_steps, world_before
    from sqrp_cli.knowledge.lint import lint
    from sqrp_cli.knowledge.load import load_workspace
    from sqrp_cli.logic.planner import find_plan
    from sqrp_cli.programming.dependency_check import best_suggestion, check_candidate
    from sqrp_cli.programming.listed_tasks import impossible_tasks
    from sqrp_cli.programming.outside import intervals_outside
    from sqrp_cli.programming.sampling import Adaptive
    from sqrp_cli.programming.suggestion import Suggester

    workspace = load_workspace(path)
    problems = (*workspace.warnings, *lint(workspace))
    if any(problem.severity == "error" for problem in problems):
        return _Checked(workspace.name, problems)
    if task is None:
        return _Checked(workspace.name, (*problems, *impossible_tasks(workspace), *_doubts(workspace, seed)))
    session = Session.begin(workspace, task, world_before(after, program), Adaptive(), seed=seed)
    world = session.assignment.world
    suggester = Suggester(session.cell, world, _planner(planner) if planner else find_plan, jobs)
    found = []
    with progress(f"Checking {task}", len(session.task.candidates)) as advance:
        for candidate in session.task.candidates:
            found.append(check_candidate(candidate, suggester))
            advance()
    planned = program is not None or not any(feasibility.feasible for feasibility in found)
    suggested = best_suggestion(found, suggester) if planned else ()
    if program is not None and suggested:
        add_steps(session.cell, chosen_steps(suggested), Adaptive(), program)
    told = (*problems, *session.cell.warnings, *intervals_outside(found))
    return _Checked(workspace.name, told, tuple(found), suggested)


def _doubts(workspace: Workspace, seed: int) -> Iterator[Problem]:
    """Warnings that need the geometry of the cell, among them what the robot hits at home.

    That is no error, because a program may have left the robot elsewhere.
    """
    from sqrp_cli.programming.cell import Cell

    cell = Cell.load(workspace, seed)
    yield from cell.warnings
    contact = cell.collision.contact_in(cell.initial_world)
    if contact is not None:
        message = f"at home {contact} before anything moves, so no task can begin there"
        mend = "change the home position, or move what is in its way"
        place = workspace.places.get("robot.home")
        yield Problem("contact-at-home", message, place, severity="warning", mend=mend)


def _planner(name: str) -> Planner:
    from sqrp_cli.logic.unified_planner import engine_planner

    return engine_planner(name)


def _print(workspace: Path, task: str | None, checked: _Checked) -> None:
    from sqrp_cli.cli.console import Column, plain, print_problems, print_table, say, say_command
    from sqrp_cli.cli.suggestion_table import print_suggested

    problems, found = checked.problems, checked.found
    print_problems(problems)
    if any(problem.severity == "error" for problem in problems):
        return
    if task is None:
        findings = (
            f"{len(problems)} warning{'s' if len(problems) > 1 else ''}" if problems else "nothing to complain about"
        )
        say(f"{checked.name} is valid: {findings}.")
        if any(problem.code == "no-skills" for problem in problems):
            return
        say_command("Try:", f"sqrp rank {shlex.quote(str(workspace))} TASK")
        return
    feasible = sum(feasibility.feasible for feasibility in found)
    say(f"{task} in {checked.name}: {feasible} of {len(found)} candidates can be done\n")
    rows = [
        (
            feasibility.candidate.name,
            plain("yes", "green") if feasibility.feasible else plain("no", "red"),
            f"{feasibility.time:.2f}" if feasibility.time is not None else "",
            "; ".join(filter(None, [*feasibility.reasons, _plan_in_words(feasibility.suggestion)])),
        )
        for feasibility in found
    ]
    print_table(
        [Column("candidate"), Column("feasible"), Column("time s", right=True), Column("why not", shrink=True)], rows
    )
    around = [f"{one.candidate.name}: {', '.join(one.ways_around)}" for one in found if one.ways_around]
    if around:
        say("\n" + "\n".join(around))
    if checked.suggested and not feasible:
        print_suggested(checked.suggested)


def _plan_in_words(suggestion: Suggestion) -> str:
    """How planning ended; for a plan of which a step cannot be done, which and why."""
    steps = (*(suggestion.steps or ()), *((suggestion.last,) if suggestion.last else ()))
    failing = next((step for step in steps if not step.feasible), None)
    if failing is None:
        return suggestion.explanation
    then = "after that" if failing is suggestion.last else "but"
    return f"{suggestion.explanation}, {then} {failing.task} cannot be done: {'; '.join(failing.reasons)}"
