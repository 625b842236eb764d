"""JSON Schemas of the documents that commands print, and of the files that people write."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, reduce
from itertools import groupby, pairwise
from operator import or_
from textwrap import dedent
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import DataclassSchema, ModelSchema

from sqrp_cli.cell.mounts import PlaceFile
from sqrp_cli.cell.workspace import WorkspaceFile
from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.files.entries import Entry
from sqrp_cli.run.cell.robot_file import RobotFile
from sqrp_cli.run.record.events import LINE
from sqrp_cli.show.documents import KINDS, record_of
from sqrp_cli.skill.skill import SkillFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"  # the dialect of the schemas

FILES: Mapping[str, type[Entry]] = {
    "workspace": WorkspaceFile,
    "skill": SkillFile,
    "mounts": PlaceFile,
    "robot": RobotFile,
}
"""The model of each file: a workspace, a skill, the `place.yaml` beside a workspace, and how to reach a real cell."""

_RECORD_NAMES: Mapping[str, str] = {
    "ExpectedTask": "TaskEntry", "Held": "HeldEntry", "Marker": "MarkerEntry", "ToolTopicEntry": "ToolEntry",
}  # fmt: skip
"""Names of renamed records in the schemas, kept so that references to their definitions stay valid."""

DOCUMENTS: Mapping[str, Any] = {
    command: reduce(or_, map(record_of, kinds)) for command, kinds in groupby(KINDS, lambda kind: kind.split()[0])
}
"""What each command prints with `--json`."""
RECORDS: Mapping[str, Any] = {"log": LINE}  # the content of each line of a file that commands write
NAMES = (*FILES, *DOCUMENTS, *RECORDS)  # everything that has a schema


def schema_of(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of a file, a command's document, or a line of a log. Raises InputError for other names."""
    if name in FILES:
        schema = FILES[name].model_json_schema(schema_generator=_Described)
        for called, definition in schema["$defs"].items():
            definition["title"] = called
        return {"$schema": DIALECT, **schema}
    if name not in NAMES:
        raise InputError(Problem("bad-option", f"there is no schema of `{name}`; {expected_names(name, NAMES)}"))
    found = {**DOCUMENTS, **RECORDS}[name]
    return {"$schema": DIALECT, **TypeAdapter(found).json_schema(mode="serialization", schema_generator=_Described)}


class _Described(GenerateJsonSchema):
    """Describes inherited fields too, which Pydantic does not; records of files have the names in `_RECORD_NAMES`."""

    def normalize_name(self, name: str) -> str:
        return super().normalize_name(_RECORD_NAMES.get(name, name) if self.mode == "validation" else name)

    def dataclass_schema(self, schema: DataclassSchema) -> JsonSchemaValue:
        return _described(super().dataclass_schema(schema), schema["cls"])

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        return _described(super().model_schema(schema), schema["cls"])


def _described(schema: JsonSchemaValue, record: type) -> JsonSchemaValue:
    if is_dataclass(record):
        for hidden in (part.name for part in fields(record) if part.metadata.get("live")):
            schema["properties"].pop(hidden)
    for name, value in schema.get("properties", {}).items():
        owners = [base for base in record.__mro__ if name in inspect.get_annotations(base)]
        text = next((texts[name] for texts in map(_texts, owners) if name in texts), None)
        if text is not None:
            value["description"] = text
    return schema


@cache
def _texts(record: type) -> Mapping[str, str]:
    """The text under each field of a class, by the field's name; none of a class that is made at run time."""
    try:
        source = inspect.getsource(record)
    except OSError:
        return {}
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for statement in ast.parse(dedent(source)).body
        if isinstance(statement, ast.ClassDef)
        for field, text in pairwise(statement.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }
