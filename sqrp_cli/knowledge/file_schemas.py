"""JSON Schemas of the files that people write, with which editors complete and check them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from sqrp_cli.knowledge.skill.skill import SkillFile
from sqrp_cli.knowledge.text.entries import Entry
from sqrp_cli.knowledge.workspace.workspace import WorkspaceFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""What the schemas are written in."""

FILES: Mapping[str, type[Entry]] = {"workspace": WorkspaceFile, "skill": SkillFile}
"""What describes the whole of a file, by the file's name without `.yaml`."""


NAMES: Mapping[str, str] = {
    "Detector": "DetectorEntry",
    "ExpectedTask": "TaskEntry",
    "Held": "HeldEntry",
    "Marker": "MarkerEntry",
}
"""What a schema calls a record that is named otherwise here: what refers to a definition shall go on to find it."""


class _Generator(GenerateJsonSchema):
    """Knows records by the names that schemas have for them."""

    def normalize_name(self, name: str) -> str:
        """The name of a definition, from that of its class."""
        return super().normalize_name(NAMES.get(name, name))


def file_schema(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of the files of that name, one of `FILES`."""
    schema = FILES[name].model_json_schema(schema_generator=_Generator)
    for called, definition in schema["$defs"].items():
        definition["title"] = called
    return {"$schema": DIALECT, **schema}
