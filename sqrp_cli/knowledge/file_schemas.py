"""JSON Schemas of the files that people write, with which editors complete and check them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from sqrp_cli.knowledge.entries import Entry
from sqrp_cli.knowledge.skill import SkillFile
from sqrp_cli.knowledge.units import Quantity
from sqrp_cli.knowledge.workspace_file import WorkspaceFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""What the schemas are written in."""

FILES: Mapping[str, type[Entry]] = {"workspace": WorkspaceFile, "skill": SkillFile}
"""What describes the whole of a file, by the file's name without `.yaml`."""


def file_schema(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of the files of that name, one of `FILES`."""
    schema = FILES[name].model_json_schema(schema_generator=_Generator)
    return {"$schema": DIALECT, **schema}


class _Generator(GenerateJsonSchema):
    """Shows quantities as people write them."""

    def encode_default(self, dft: Any) -> Any:  # noqa: ANN401 - any default
        return dft.value if isinstance(dft, Quantity) else super().encode_default(dft)
