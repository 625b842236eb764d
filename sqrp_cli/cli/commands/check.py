"""`sqrp check`: whether a workspace is sound, and whether a task can be done in it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.api.cell import OpenCell
from sqrp_cli.cli import completion
from sqrp_cli.cli.options import After, Jobs, Json, Seed, StartPath, answer, check_needed, job_count
from sqrp_cli.cli.start import Start
from sqrp_cli.cli.watch import Watch, watched
from sqrp_cli.errors import ExitCode, InputError
from sqrp_cli.report.documents.document import as_text

if TYPE_CHECKING:
    from sqrp_cli.api.results import Check
    from sqrp_cli.logic.planner import Planner

NAME = "check"


def command(
    context: typer.Context,
    workspace: StartPath,
    task: Annotated[
        str | None,
        typer.Argument(
            metavar="TASK", autocompletion=completion.tasks, help='Check this task as well, such as "pickup green".'
        ),
    ] = None,
    after: After = None,
    program: Annotated[
        Path | None,
        typer.Option("--program", metavar="PROGRAM", help="Append what has to be done, each step in its best way."),
    ] = None,
    planner: Annotated[
        str | None, typer.Option("--planner", metavar="NAME", help="Plan with this engine of unified-planning.")
    ] = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    watch: Watch = False,
    as_json: Json = False,
) -> ExitCode:
    """Validate a workspace, and a task in it.

    With a task, show which candidates can be done, why the others cannot, and what would have to be done first. Times
    are those of `rank --ways fastest`; without that, rank takes the best of all ways.
    """
    from sqrp_cli.report.documents.checks import CheckDocument
    from sqrp_cli.terminal.console import note, print_problems, say_command, say_raw

    if watch:
        return watched(context, {"--json": as_json, "--program": program})
    check_needed("a task", task, {"--program": program, "--planner": planner})
    try:
        workspace, after = Start.of(workspace, after, program)
        checked = _check(workspace, task, after, program, planner, job_count(jobs), seed)
    except InputError as error:
        if not as_json:
            raise
        say_raw(as_text(CheckDocument.of(workspace.name, task, (), error.problems)))
        return ExitCode.BAD_INPUT
    if not as_json:
        print_problems(checked.problems)
    answer(checked, as_json=as_json)
    if not as_json and task is not None and checked.suggested and program is None:
        command = f"sqrp check {shlex.join([str(workspace), task])} --program FILE"
        say_command("\nTo write these steps as a program:", command)
    if not checked.valid:
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


def _check(
    path: Path, task: str | None, after: Path | None, program: Path | None, planner: str | None, jobs: int, seed: int
) -> Check:
    """Check everything; write the program if one is requested and there is something to do."""
    from sqrp_cli.api.session import add_steps, chosen_steps, world_before
    from sqrp_cli.programming.coverage.sampling import Adaptive
    from sqrp_cli.terminal.console import progress

    cell = OpenCell.read(path, seed)
    if cell.errors or task is None:
        return cell.check(task)
    checked = cell.check(
        task,
        after=world_before(after, program),
        plan=None if program is None else True,
        planner=_planner(planner) if planner else None,
        jobs=jobs,
        progress=progress,
    )
    if program is not None and checked.suggested:
        add_steps(cell.cell, chosen_steps(checked.suggested), Adaptive(), program)
    return checked


def _planner(name: str) -> Planner:
    from sqrp_cli.logic.unified_planner import engine_planner

    return engine_planner(name)
