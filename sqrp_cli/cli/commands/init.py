"""`sqrp init`: a new workspace that runs."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.api.new_cell import made
from sqrp_cli.ask.request import Command, flag
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer, check_needed
from sqrp_cli.errors import ExitCode, InputError, Problem, bad_option

NAME = "init"


class InitCommand(requests.InitRequest, requests.Printed, Command):
    """Make a new workspace with its skill.

    Guesses about your arm are marked `check:` in the file. Nothing is ever overwritten. Exit code 1 if the arm can pick
    up nothing anywhere, or the first run stops.
    """

    run: bool = flag(
        "--run/--no-run", "Run its task once in the simulated cell, if there is one; may take minutes.", default=True
    )


def init(_context: Any, ask: InitCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Make it, run its task once, and print."""
    from sqrp_cli.cell.workspace_file import WORKSPACE_FILE
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    folder, given = _split([str(ask.folder), *(ask.arguments or ())])
    of_arm = {"--tip": ask.tip, "--package-root": ask.package_roots, "an argument": given}
    check_needed("the arm of --urdf", ask.moveit if ask.urdf is None else ask.urdf, of_arm)
    for root in ask.package_roots:
        if not Path(root).is_dir():
            raise InputError(Problem("missing-folder", f"--package-root: there is no folder {root}"))
    asked = ask.but(folder=folder, arguments=given, progress=progress)
    try:
        found = made(asked)
    except KeyboardInterrupt:
        if (folder / WORKSPACE_FILE).exists():
            note(f"{folder} is made, but its task was not run: sqrp check {shlex.quote(str(folder))}")
        raise
    print_problems(found.problems)
    answer(found, as_json=ask.json)
    return ExitCode.OK if found.works else ExitCode.NONE_FEASIBLE


def _split(words: list[str]) -> tuple[Path, dict[str, str]]:
    """The folder and the arguments, in whatever order they come."""
    given = dict(word.split(":=", 1) for word in words if ":=" in word)
    folders = [word for word in words if ":=" not in word]
    if len(folders) != 1:
        found = ", ".join(f"`{word}`" for word in folders) or "none"
        raise bad_option(f"expected one folder, and arguments such as `ur_type:=ur5e`; found the folders {found}")
    return Path(folders[0]), given


command = command_of(InitCommand, init)
