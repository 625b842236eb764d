"""Reading a program together with the workspace that it is about."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqrp_cli.errors import InputError, Place, Problem

if TYPE_CHECKING:
    from pathlib import Path

    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.program.record import Program


def open_program(path: Path) -> tuple[Program, Workspace]:
    """A program with at least one step, and its workspace. Raises InputError if it does not fit the workspace."""
    from sqrp_cli.program.file import check_program

    program, workspace = program_and_workspace(path)
    check_program(program, path, workspace)
    if not program.steps:
        raise InputError(Problem("no-steps", "this program has no steps", Place(path)))
    return program, workspace


def program_and_workspace(path: Path) -> tuple[Program, Workspace]:
    """A program and its workspace as it is now, whether or not they still fit."""
    from sqrp_cli.cli.options import open_with_warnings
    from sqrp_cli.program.file import load_program, workspace_path

    program = load_program(path)
    return program, open_with_warnings(workspace_path(program, path)).workspace
