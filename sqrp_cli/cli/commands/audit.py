"""`sqrp audit`: recorded frames against what a program predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Json, answer, program_with_warnings
from sqrp_cli.errors import ExitCode, InputError, Problem

NAME = "audit"


def command(
    program: Annotated[Path, typer.Argument(metavar="PROGRAM", help="A program that `sqrp rank` wrote.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Frames of a run of it: PNG files and `frames.csv`.")],
    threshold: Annotated[
        float,
        typer.Option(
            "--threshold", metavar="SHARE", help="Least share of predicted detections that must have come true."
        ),
    ] = 0.97,
    as_json: Json = False,
) -> ExitCode:
    """Compare recorded camera frames with what a program predicts.

    Shows how often each camera showed each literal when it was predicted to.
    """
    from sqrp_cli.runtime.cell.requirements import check_packages
    from sqrp_cli.terminal.console import progress

    if not 0.0 <= threshold <= 1.0:
        raise InputError(Problem("bad-option", f"--threshold is {threshold:g}, expected 0 to 1"))
    check_packages()
    audit = program_with_warnings(program).audit(folder, threshold, progress=progress)
    answer(audit, as_json=as_json)
    return ExitCode.OK if audit.passed else ExitCode.NONE_FEASIBLE
