"""`sqrp schema`: the JSON Schema of workspace and skill files."""

from __future__ import annotations

from typing import Annotated

import typer

from sqrp_cli.errors import ExitCode

NAME = "schema"

File = Annotated[str, typer.Argument(metavar="workspace|skill", help="Of which files: workspace.yaml or skill.yaml.")]
JsonAnyway = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else, as always.", show_default=False)
]


def command(file: File = "workspace", as_json: JsonAnyway = True) -> ExitCode:  # noqa: ARG001 - always JSON
    """Print the JSON Schema of workspace files, or of skill files.

    Editors complete and check these files with it.
    """
    import json

    from sqrp_cli.cli.console import say_raw
    from sqrp_cli.knowledge.file_schemas import file_schema

    say_raw(json.dumps(file_schema(file), indent=2))
    return ExitCode.OK
