"""`sqrp show`: the resolved scene."""

from __future__ import annotations

from sqrp_cli.api.cell import OpenCell
from sqrp_cli.cli.options import Json, WorkspacePath, answer
from sqrp_cli.errors import ExitCode

NAME = "show"


def command(workspace: WorkspacePath, as_json: Json = False) -> ExitCode:
    """Show how a workspace is understood.

    Robot, cameras, objects, skills and state, with every path and pose resolved.
    """
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.terminal.console import print_problems

    cell = OpenCell.read(workspace)
    scene = cell.scene()
    print_problems((*(one for one in cell.findings if one.severity == "warning"), *cell_warnings(scene.cell)))
    answer(scene, as_json=as_json)
    return ExitCode.OK
