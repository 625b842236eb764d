"""Fields of documents are defined in the reference; schemas of files are asked by a validator that knows no program."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from jsonschema import Draft202012Validator

from sqrp_cli.document import LIVE
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.score.result import Scorecard, Sweep
from sqrp_cli.show.documents.checks import Check
from sqrp_cli.show.documents.schemas import FILES, schema_of
from sqrp_cli.study.result import CandidateResult

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


def names(kind: Any, known: set[Any]) -> Iterator[str]:
    """The fields of a record, and of the records in it."""
    if is_dataclass(kind) and kind not in known:
        known.add(kind)
        hints = get_type_hints(kind)
        for part in (part for part in fields(kind) if part.metadata != LIVE):
            yield part.name
            yield from names(hints[part.name], known)
    for part in get_args(kind):
        yield from names(part, known)


@pytest.mark.parametrize("record", [CandidateResult, Check, Scorecard, Sweep])
def test_every_field_is_defined_in_the_reference(record: type) -> None:
    text = (ROOT / "docs" / "reference" / "numbers.md").read_text(encoding="utf-8")
    assert [name for name in names(record, set()) if f"`{name}`" not in text] == []
