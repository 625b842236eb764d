"""`sqrp set`: values of a workspace file, written anew; comments stay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.request import argument
from sqrp_cli.cli.command import command_of
from sqrp_cli.errors import ExitCode, InputError, bad_option

NAME = "set"


class SetCommand(requests.CellCommand):
    """Set values of a workspace file by their paths, as the studio does. Comments and layout stay.

    Nothing is written where the result would be no workspace.
    """

    path: Sequence[str] = argument(
        "PATH=VALUE...", "Values by dotted path, such as cameras.cam1.rate=20.", values.texts("values by their paths")
    )


def set_values(_context: Any, ask: SetCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Write the values, if the result is a workspace."""
    from sqrp_cli.cell.workspace_file import read_workspace_document, replace_workspace, workspace_file
    from sqrp_cli.files.yaml_edit import with_values
    from sqrp_cli.show.terminal.console import note, print_problems
    from sqrp_cli.task.task import impossible_tasks

    file = workspace_file(ask.workspace)
    document = read_workspace_document(file)
    pairs = [_pair(text) for text in ask.path]
    paths = [path for path, _ in pairs]
    if twice := [path for path in paths if paths.count(path) > 1]:
        raise bad_option(f"`{twice[0]}` is set twice; give one value")
    content = with_values(document, dict(pairs))
    if content == document.content:
        note(f"{file} says so already; nothing was written")
        return ExitCode.OK
    opened = OpenCell.read(ask.workspace, 0, content)
    findings = (*opened.findings, *impossible_tasks(opened.workspace))
    print_problems(one for one in findings if one.severity != "error")
    if errors := [one for one in findings if one.severity == "error"]:
        raise InputError(*errors)
    replace_workspace(document, content)
    note(f"{file} is written")
    return ExitCode.OK


def _pair(text: str) -> tuple[str, str]:
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise bad_option(f"found `{text}`, expected PATH=VALUE, such as cameras.cam1.rate=20")
    return path.strip(), value.strip()


command = command_of(SetCommand, set_values)
