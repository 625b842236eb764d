"""`sqrp calibrate`: how likely a detector sees, learned from labelled frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.api.calibration import learned
from sqrp_cli.ask.request import Command, option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import Patches, answer
from sqrp_cli.errors import ExitCode
from sqrp_cli.platform.files import check_not_read

NAME = "calibrate"

PATCHES = Patches("# Curves that `sqrp calibrate` found", "of `sqrp calibrate`")


class CalibrateCommand(requests.CalibrateRequest, requests.Printed, Command):
    """Learn from labelled frames how likely each detector sees.

    Prints how well its curve, and its limits, agree with frames that the curve was not learned from.
    """

    patch: Path | None = option(
        "--patch", "Write a patch of the workspace with the curves.", PATH, default=None, metavar="FILE"
    )


def calibrate(_context: Any, ask: CalibrateCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Learn, write the patch, and print."""
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.show.terminal.console import note, progress

    if ask.patch is not None:
        PATCHES.check(ask.patch)
    found = learned(ask.but(progress=progress))
    if ask.patch is not None:
        check_not_read([ask.patch], [file.path for file in found.cell.workspace.files.values()])
        PATCHES.write(ask.patch, found.patch)
        note(f"to have the curves: {to_apply(ask.patch, found.cell.workspace.whole_file.file)}")
    answer(found, as_json=ask.json)
    return ExitCode.OK


command = command_of(CalibrateCommand, calibrate)
