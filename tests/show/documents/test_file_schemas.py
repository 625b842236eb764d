"""JSON Schemas of workspace and skill files, asked by a validator that knows nothing of the program."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.show.documents.schemas import FILES, schema_of

ROOT = Path(__file__).parents[3]
SHIPPED = sorted([*ROOT.glob("workspaces/*/workspace.yaml"), *ROOT.glob("skills/*/skill.yaml")])


@cache
def validator_of(name: str) -> Draft202012Validator:
    return Draft202012Validator(schema_of(name))


def mappings(value: object) -> Iterator[dict[str, Any]]:
    """The mappings within a document, the document included."""
    if isinstance(value, dict):
        yield value
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from mappings(inner)


@pytest.mark.parametrize("name", FILES)
def test_a_schema_is_valid_and_describes_every_key(name: str) -> None:
    schema = schema_of(name)
    Draft202012Validator.check_schema(schema)
    entries = [schema, *schema["$defs"].values()]
    assert all(entry["additionalProperties"] is False for entry in entries)
    assert all(entry["description"] for entry in entries)
    keys = [(key, value) for entry in entries for key, value in entry["properties"].items()]
    assert [key for key, value in keys if "description" not in value and "$ref" not in value] == []
    defaults = [(key, value) for key, value in keys if value.get("default") is not None]
    validator = validator_of(name)
    assert [key for key, value in defaults if not validator.evolve(schema=value).is_valid(value["default"])] == []


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.parent.name)
def test_shipped_files_are_valid_and_a_key_too_many_is_not_anywhere(file: Path) -> None:
    validator, content = validator_of(file.stem), read_yaml(file).data
    assert [error.message for error in validator.iter_errors(content)] == []
    for place in range(sum(1 for _ in mappings(content))):
        changed = copy.deepcopy(content)
        list(mappings(changed))[place]["nonsense"] = {}
        assert not validator.is_valid(changed)
