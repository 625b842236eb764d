"""`sqrp init`: a new workspace that ranks at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Json, answer
from sqrp_cli.errors import ExitCode, InputError, Problem

NAME = "init"

DEFAULT_OBJECTS, DEFAULT_CAMERAS = 9, 4
"""Of a workspace that is filled at random."""


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The new folder; it must not exist or be empty.")],
    urdf: Annotated[
        str | None,
        typer.Option("--urdf", metavar="FILE", help="Your arm; without it, an arm that comes with the program."),
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option("--tip", metavar="LINK", help="The link at the end of the arm, of a robot with several arms."),
    ] = None,
    run: Annotated[
        bool, typer.Option("--run/--no-run", help="Run its task once in the simulated cell, where there is one.")
    ] = True,
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

    Guesses about your arm are marked `check:` in the file. Nothing is ever overwritten. Exit code 1 if the arm can pick
    up nothing anywhere, or the first run stops.
    """
    from sqrp_cli.api.new_cell import new_cell
    from sqrp_cli.starter.random_cell import Crowd
    from sqrp_cli.terminal.console import print_problems, progress

    for option, value in (("--objects", objects), ("--cameras", cameras), ("--seed", seed)):
        if value is not None and not random:
            raise InputError(Problem("bad-option", f"{option} is about --random, which is missing"))
    if tip is not None and urdf is None:
        raise InputError(Problem("bad-option", "--tip is about the arm of --urdf, which is missing"))
    crowd = Crowd(seed or 0, objects or DEFAULT_OBJECTS, cameras or DEFAULT_CAMERAS) if random else None
    with progress(f"Making {folder}", None):
        made = new_cell(folder, urdf=urdf, tip=tip, crowd=crowd, run=run and crowd is None)
    print_problems(made.problems)
    answer(made, as_json=as_json)
    return ExitCode.OK if made.works else ExitCode.NONE_FEASIBLE
