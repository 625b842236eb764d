"""`sqrp calibrate`: how likely a detector sees, learned from labelled frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.api.calibration import calibrate
from sqrp_cli.cli.options import Json, Patches, answer
from sqrp_cli.errors import ExitCode
from sqrp_cli.platform.files import check_not_read

NAME = "calibrate"

PATCHES = Patches("# Curves that `sqrp calibrate` found", "of `sqrp calibrate`")


def command(
    frames: Annotated[
        Path,
        typer.Argument(
            metavar="FRAMES", help="What `sqrp run --frames` kept, a recording, or PNG files and `labels.csv`."
        ),
    ],
    workspace: Annotated[
        Path | None, typer.Option("--workspace", metavar="WORKSPACE", help="The cell that `labels.csv` is about.")
    ] = None,
    program: Annotated[
        Path | None, typer.Option("--program", metavar="FILE", help="The program that was run, if it is not in FRAMES.")
    ] = None,
    patch: Annotated[
        Path | None, typer.Option("--patch", metavar="FILE", help="Write a patch of the workspace with the curves.")
    ] = None,
    as_json: Json = False,
) -> ExitCode:
    """Learn from labelled frames how likely each detector sees.

    Prints how well its curve, and its limits, agree with frames that the curve was not learned from.
    """
    from sqrp_cli.knowledge.text.yaml_edit import to_apply
    from sqrp_cli.terminal.console import note, progress

    if patch is not None:
        PATCHES.check(patch)
    found = calibrate(frames, workspace=workspace, program=program, progress=progress)
    if patch is not None:
        check_not_read([patch], [file.path for file in found.cell.workspace.files.values()])
        PATCHES.write(patch, found.patch)
        note(f"to have the curves: {to_apply(patch, found.cell.workspace.whole_file.file)}")
    answer(found, as_json=as_json)
    return ExitCode.OK
