"""`sqrp show`: the resolved scene, or the table of a saved result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.results import is_result, read_result
from sqrp_cli.ask.request import argument
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer
from sqrp_cli.errors import ExitCode

NAME = "show"


class ShowCommand(requests.Printed, requests.CellCommand):
    """Show how a workspace is understood, or the table of a saved result.

    Of a workspace: robot, cameras, objects, skills and state, with every path and pose resolved.
    """

    workspace: Path = argument(
        "WORKSPACE", "Folder of a workspace, its YAML file, or what a command wrote with --json.", PATH
    )


def show(_context: Any, ask: ShowCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Print what was understood, or found."""
    if is_result(ask.workspace):
        answer(read_result(ask.workspace), as_json=ask.json)
        return ExitCode.OK
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.show.terminal.console import print_problems

    cell = OpenCell.read(ask.workspace)
    scene = cell.scene()
    print_problems((*(one for one in cell.findings if one.severity == "warning"), *cell_warnings(scene.cell)))
    answer(scene, as_json=ask.json)
    return ExitCode.OK


command = command_of(ShowCommand, show)
