"""`sqrp audit`: recorded frames against what a program predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Json
from sqrp_cli.errors import ExitCode, InputError, Problem

NAME = "audit"


def command(
    program: Annotated[Path, typer.Argument(metavar="PROGRAM", help="A program that `sqrp rank` wrote.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Frames of a run of it: PNG files and `frames.csv`.")],
    threshold: Annotated[
        float, typer.Option("--threshold", help="Least share of predicted detections that must have come true.")
    ] = 0.97,
    as_json: Json = False,
) -> ExitCode:
    """Compare recorded camera frames with what a program predicts.

    Tells how often each camera showed each literal when it was predicted to.
    """
    from sqrp_cli.cli.program_input import open_program
    from sqrp_cli.report.documents.document import as_text
    from sqrp_cli.report.documents.runs import AuditDocument
    from sqrp_cli.runtime.cell.requirements import check_packages
    from sqrp_cli.terminal.console import progress, say_raw
    from sqrp_cli.terminal.run_view import print_audit

    if not 0.0 <= threshold <= 1.0:
        raise InputError(Problem("bad-option", f"--threshold is {threshold:g}, expected 0 to 1"))
    check_packages()
    from sqrp_cli.runtime.monitor.frame_audit import audit
    from sqrp_cli.runtime.record.frames import read_frames

    found, workspace = open_program(program)
    total = sum(1 for _ in read_frames(folder, list(workspace.cameras), len(found.steps)))
    with progress(f"Looking at {folder}", total) as advance:
        report = audit(found, workspace, folder, advance)
    if as_json:
        say_raw(as_text(AuditDocument.of(workspace.name, report, threshold)))
    else:
        print_audit(found, workspace.name, report, threshold)
    precision = report.total.precision
    return ExitCode.OK if precision is not None and precision >= threshold else ExitCode.NONE_FEASIBLE
