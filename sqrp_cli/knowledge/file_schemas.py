"""JSON Schemas of the files that people write, with which editors complete and check them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqrp_cli.knowledge.skill.skill import SkillFile
from sqrp_cli.knowledge.text.entries import Entry
from sqrp_cli.knowledge.workspace.workspace_file import WorkspaceFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""What the schemas are written in."""

FILES: Mapping[str, type[Entry]] = {"workspace": WorkspaceFile, "skill": SkillFile}
"""What describes the whole of a file, by the file's name without `.yaml`."""


def file_schema(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of the files of that name, one of `FILES`."""
    schema = FILES[name].model_json_schema()
    return {"$schema": DIALECT, **schema}
