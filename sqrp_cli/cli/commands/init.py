"""`sqrp init`: a new workspace that ranks at once."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import Json
from sqrp_cli.errors import ExitCode, InputError, Problem

if TYPE_CHECKING:
    from sqrp_cli.starter.make import Starter

NAME = "init"

DEFAULT_OBJECTS, DEFAULT_CAMERAS = 9, 4
"""Of a workspace that is filled at random."""


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The new folder; it must not exist or be empty.")],
    urdf: Annotated[
        str | None,
        typer.Option("--urdf", metavar="FILE", help="Your arm; without it, an arm that comes with the program."),
    ] = None,
    random: Annotated[bool, typer.Option("--random", help="Fill it at random, for load tests.")] = False,
    objects: Annotated[
        int | None, typer.Option("--objects", min=1, max=1500, help="With --random: so many cubes; 9 by default.")
    ] = None,
    cameras: Annotated[
        int | None, typer.Option("--cameras", min=1, max=200, help="With --random: so many cameras; 4 by default.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="With --random: seed of what is drawn; 0 by default.")
    ] = None,
    as_json: Json = False,
) -> ExitCode:
    """Make a new workspace with its skill.

    What is guessed about your arm is marked `check:` in the file. Nothing is ever overwritten.
    """
    from sqrp_cli.report.documents.document import as_text
    from sqrp_cli.report.documents.starters import InitDocument
    from sqrp_cli.starter.make import make_starter
    from sqrp_cli.starter.random_cell import Crowd
    from sqrp_cli.terminal.console import print_problems, say_raw

    for option, value in (("--objects", objects), ("--cameras", cameras), ("--seed", seed)):
        if value is not None and not random:
            raise InputError(Problem("bad-option", f"{option} is about --random, which is missing"))
    crowd = Crowd(seed or 0, objects or DEFAULT_OBJECTS, cameras or DEFAULT_CAMERAS) if random else None
    starter = make_starter(folder, urdf, crowd)
    print_problems(starter.warnings)
    if as_json:
        document = InitDocument(
            workspace=str(starter.folder), tool_link=starter.tip, objects=list(starter.cubes), task=starter.task
        )
        say_raw(as_text(document))
    else:
        _print(starter, folder, own=urdf is not None)
    return ExitCode.OK


def _print(starter: Starter, folder: Path, *, own: bool) -> None:
    from sqrp_cli.terminal.console import say, say_command

    where = shlex.quote(str(folder))
    say(f"{where} is a new workspace: workspace.yaml says what is in the cell, skills/pickup how a task is done.")
    if own:
        guessed = f"The tool is fixed to `{starter.tip}`. Lines marked `check:` were guessed; compare with:"
        say_command(guessed, f"sqrp show {where}")
    if starter.task is not None:
        say_command("Try:", f'sqrp rank {where} "{starter.task}"')
