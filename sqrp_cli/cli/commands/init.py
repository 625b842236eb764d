"""`sqrp init`: a new workspace that ranks at once."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.api.new_cell import new_cell
from sqrp_cli.cli.options import Json, answer, check_needed
from sqrp_cli.errors import ExitCode, InputError, Problem, bad_option

NAME = "init"

NewFolder = Annotated[Path, typer.Argument(metavar="DIR", help="The new folder; it must not exist or be empty.")]
XacroArguments = Annotated[
    list[str] | None, typer.Argument(metavar="NAME:=VALUE", help="Arguments of a xacro, such as ur_type:=ur5e.")
]
Arm = Annotated[
    str | None,
    typer.Option("--urdf", metavar="FILE", help="Your arm, URDF or xacro; without it, one of the program's own."),
]
MoveItFolder = Annotated[
    Path | None,
    typer.Option("--moveit", metavar="DIR", help="Its configuration of MoveIt; one beside the URDF is found."),
]
PackageRoots = Annotated[
    list[Path] | None,
    typer.Option("--package-root", metavar="DIR", help="Where packages are looked up; may be repeated."),
]
TipLink = Annotated[
    str | None,
    typer.Option("--tip", metavar="LINK", help="The link at the end of the arm, of a robot with several arms."),
]
RunOnce = Annotated[
    bool,
    typer.Option("--run/--no-run", help="Run its task once in the simulated cell, if there is one; may take minutes."),
]


def command(
    folder: NewFolder,
    arguments: XacroArguments = None,
    urdf: Arm = None,
    moveit: MoveItFolder = None,
    package_root: PackageRoots = None,
    tip: TipLink = None,
    run: RunOnce = True,
    as_json: Json = False,
) -> ExitCode:
    """Make a new workspace with its skill.

    Guesses about your arm are marked `check:` in the file. Nothing is ever overwritten. Exit code 1 if the arm can pick
    up nothing anywhere, or the first run stops.
    """
    from sqrp_cli.knowledge.workspace.workspace_file import WORKSPACE_FILE
    from sqrp_cli.terminal.console import note, print_problems, progress

    folder, given = _split([str(folder), *(arguments or [])])
    of_arm = {"--tip": tip, "--package-root": package_root, "an argument": given}
    check_needed("the arm of --urdf", moveit if urdf is None else urdf, of_arm)
    for root in package_root or []:
        if not root.is_dir():
            raise InputError(Problem("missing-folder", f"--package-root: there is no folder {root}"))
    try:
        made = new_cell(
            folder,
            urdf=urdf,
            arguments=given,
            package_roots=package_root or (),
            moveit=moveit,
            tip=tip,
            run=run,
            progress=progress,
        )
    except KeyboardInterrupt:
        if (folder / WORKSPACE_FILE).exists():
            note(f"{folder} is made, but its task was not run: sqrp check {shlex.quote(str(folder))}")
        raise
    print_problems(made.problems)
    answer(made, as_json=as_json)
    return ExitCode.OK if made.works else ExitCode.NONE_FEASIBLE


def _split(words: list[str]) -> tuple[Path, dict[str, str]]:
    """The folder and the arguments, in whatever order they come."""
    given = dict(word.split(":=", 1) for word in words if ":=" in word)
    folders = [word for word in words if ":=" not in word]
    if len(folders) != 1:
        found = ", ".join(f"`{word}`" for word in folders) or "none"
        raise bad_option(f"expected one folder, and arguments such as `ur_type:=ur5e`; found the folders {found}")
    return Path(folders[0]), given
