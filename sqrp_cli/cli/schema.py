"""`sqrp schema`: the JSON Schema of workspace files."""

from __future__ import annotations

from typing import Annotated

import typer

from sqrp_cli.errors import ExitCode

NAME = "schema"

JsonAnyway = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else, as always.", show_default=False)
]


def command(as_json: JsonAnyway = True) -> ExitCode:  # noqa: ARG001 - it is JSON with and without
    """Print the JSON Schema of workspace files.

    Editors complete and check workspace files with it.
    """
    import json

    from sqrp_cli.cli.console import say_raw
    from sqrp_cli.knowledge.workspace_file import workspace_schema

    say_raw(json.dumps(workspace_schema(), indent=2))
    return ExitCode.OK
