"""JSON Schemas of the files that people write, for completion and checks in editors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from sqrp_cli.knowledge.skill.skill import SkillFile
from sqrp_cli.knowledge.text.entries import Entry
from sqrp_cli.knowledge.workspace.workspace import WorkspaceFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""The dialect of the schemas."""

FILES: Mapping[str, type[Entry]] = {"workspace": WorkspaceFile, "skill": SkillFile}
"""The model of each file, by the file's name without `.yaml`."""


NAMES: Mapping[str, str] = {
    "Detector": "DetectorEntry",
    "ExpectedTask": "TaskEntry",
    "Held": "HeldEntry",
    "Marker": "MarkerEntry",
}
"""Names of renamed records in the schemas, kept so that references to their definitions stay valid."""


class _Generator(GenerateJsonSchema):
    """Uses the names that schemas have for records."""

    def normalize_name(self, name: str) -> str:
        """The name of a definition, from that of its class."""
        return super().normalize_name(NAMES.get(name, name))


def file_schema(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of the files of that name, one of `FILES`."""
    schema = FILES[name].model_json_schema(schema_generator=_Generator)
    for called, definition in schema["$defs"].items():
        definition["title"] = called
    return {"$schema": DIALECT, **schema}
