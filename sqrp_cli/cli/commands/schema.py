"""`sqrp schema`: the JSON Schema of files and documents."""

from __future__ import annotations

from typing import Any

from sqrp_cli.ask import values
from sqrp_cli.ask.request import Command, argument, flag
from sqrp_cli.cli.command import command_of
from sqrp_cli.errors import ExitCode

NAME = "schema"


class SchemaCommand(Command):
    """Print the JSON Schema of a file, or of what a command prints with --json.

    Editors complete and check files with it, programs read documents with it.
    """

    name: str = argument(
        "NAME",
        "workspace, skill, mounts (place.yaml), robot (run --robot), for files; log, for a line of the file of run "
        "--log; or a command, such as rank, for its --json.",
        values.text("a name"),
        default="workspace",
        complete="schemas",
    )
    json: bool = flag("--json", "Print one JSON document and nothing else, as always.")


def schema(_context: Any, ask: SchemaCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Print a schema."""
    import json

    from sqrp_cli.show.documents.schemas import schema_of
    from sqrp_cli.show.terminal.console import say_raw

    say_raw(json.dumps(schema_of(ask.name), indent=2))
    return ExitCode.OK


command = command_of(SchemaCommand, schema)
