"""`sqrp check`: whether a workspace is sound, and whether a task can be done in it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.api.cell import OpenCell, checked
from sqrp_cli.ask.request import argument, option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer, check_needed
from sqrp_cli.cli.start import Start
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode, InputError

if TYPE_CHECKING:
    from sqrp_cli.show.documents.checks import Check

NAME = "check"


class CheckCommand(requests.CheckRequest, requests.Watchable, requests.Seeded, requests.Printed, requests.StartCommand):
    """Validate a workspace, and a task in it.

    With a task, show which candidates can be done, why the others cannot, and what would have to be done first. Times
    are those of `rank --ways fastest`; without that, rank takes the best of all ways.
    """

    task: str | None = argument("TASK", requests.CHECK_HELP, requests.TASK, default=None, complete="tasks")
    program: Path | None = option(
        "--program", "Append what has to be done, each step in its best way.", PATH, default=None, metavar="PROGRAM"
    )


def check(context: Any, ask: CheckCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Check everything, and write the program if one is requested and there is something to do."""
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.terminal.console import note, print_problems, say_command, say_raw

    if ask.watch:
        return watched(context, {"--json": ask.json, "--program": ask.program})
    check_needed("a task", ask.task, {"--program": ask.program, "--planner": ask.planner})
    workspace = ask.workspace
    try:
        workspace, after = Start.of(workspace, ask.after, ask.program)
        found = _found(workspace, ask.but(after=after))
    except InputError as error:
        if not ask.json:
            raise
        say_raw(Check.of(str(workspace), workspace.name, ask.task, error.problems).to_json())
        return ExitCode.BAD_INPUT
    if not ask.json:
        print_problems(found.findings)
    answer(found, as_json=ask.json)
    if not ask.json and ask.task is not None and found.suggested and ask.program is None:
        command = f"sqrp check {shlex.join([str(workspace), ask.task])} --program FILE"
        say_command("\nTo write these steps as a program:", command)
    if not found.valid:
        return ExitCode.BAD_INPUT
    if ask.program is not None:
        if not found.suggested:
            note(f"there is nothing that could be done, so {ask.program} was left as it was")
            return ExitCode.NONE_FEASIBLE
        note(f"{', then '.join(step.task for step in found.suggested)}: now at the end of {ask.program}")
        return ExitCode.OK
    if ask.task is not None and not any(one.feasible for one in found.candidates):
        return ExitCode.NONE_FEASIBLE
    return ExitCode.OK


def _found(workspace: Path, ask: CheckCommand) -> Check:
    from sqrp_cli.ask.api.session import add_steps, chosen_steps, world_before
    from sqrp_cli.show.terminal.console import progress
    from sqrp_cli.study.sampling import Adaptive

    cell = OpenCell.read(workspace, ask.seed)
    if cell.errors or ask.task is None:
        return cell.check(ask.task)
    plan = None if ask.program is None else True
    found = checked(cell, ask.but(after=world_before(ask.after, ask.program), plan=plan, progress=progress))
    if ask.program is not None and found.suggested:
        add_steps(cell.cell, chosen_steps(found.steps), Adaptive(), ask.program)
    return found


command = command_of(CheckCommand, check)
