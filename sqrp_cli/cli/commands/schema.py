"""`sqrp schema`: the JSON Schema of files and documents."""

from __future__ import annotations

from typing import Annotated

import typer

from sqrp_cli.cli import completion
from sqrp_cli.errors import ExitCode

NAME = "schema"

Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        autocompletion=completion.schemas,
        help="workspace, skill, mounts (place.yaml), robot (run --robot), for files; log, for a line of the file of"
        " run --log; or a command, such as rank, for its --json.",
    ),
]
JsonAnyway = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else, as always.", show_default=False)
]


def command(name: Name = "workspace", as_json: JsonAnyway = True) -> ExitCode:  # noqa: ARG001 - always JSON
    """Print the JSON Schema of a file, or of what a command prints with --json.

    Editors complete and check files with it, programs read documents with it.
    """
    import json

    from sqrp_cli.report.documents.schemas import schema_of
    from sqrp_cli.terminal.console import say_raw

    say_raw(json.dumps(schema_of(name), indent=2))
    return ExitCode.OK
