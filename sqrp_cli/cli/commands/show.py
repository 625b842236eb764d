"""`sqrp show`: the resolved scene."""

from __future__ import annotations

from typing import Any

from sqrp_cli.api.cell import OpenCell
from sqrp_cli.ask import requests
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer
from sqrp_cli.errors import ExitCode

NAME = "show"


class ShowCommand(requests.Printed, requests.CellCommand):
    """Show how a workspace is understood.

    Robot, cameras, objects, skills and state, with every path and pose resolved.
    """


def show(_context: Any, ask: ShowCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Print what was understood."""
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.terminal.console import print_problems

    cell = OpenCell.read(ask.workspace)
    scene = cell.scene()
    print_problems((*(one for one in cell.findings if one.severity == "warning"), *cell_warnings(scene.cell)))
    answer(scene, as_json=ask.json)
    return ExitCode.OK


command = command_of(ShowCommand, show)
