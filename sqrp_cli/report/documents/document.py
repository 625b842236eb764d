"""What all documents have in common: how they begin, and how they become JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Literal

Pose = list[list[float]]
"""A 4x4 pose as nested rows, frame in parent."""

LEFT_OUT: Mapping[str, bool] = {"left out": True}
"""Metadata of a field, None by default, that a document has only where it is not None."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """A part of a document; its fields are a contract with other programs. SI units, radians, shares in 0..1."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012 - read by Pydantic, for the JSON Schema


@dataclass(frozen=True, kw_only=True)
class Document(Record):
    """How every document begins."""

    schema: Literal[1] = 1
    """Version of the fields."""


@dataclass(frozen=True, kw_only=True)
class WorkspaceDocument(Document):
    """How a document about a workspace begins."""

    workspace: str
    """Its name: that of its folder, or of its file if that is not `workspace.yaml`."""


@dataclass(frozen=True, kw_only=True)
class TaskDocument(WorkspaceDocument):
    """How a document about a task begins."""

    task: str
    """As it was asked for."""


def as_text(document: Document) -> str:
    """A document as one line of JSON. Raises ValueError if a figure is not finite.

    Non-ASCII characters are escaped, so that they survive any stream and no terminal obeys them. So is the second of
    two `#` in a row, with which commands to CI servers begin.
    """
    return json.dumps(document, default=plain, allow_nan=False).replace("##", "#\\u0023")


def plain(record: object) -> dict[str, Any]:
    """The fields of a record, or the entries of a mapping, one level deep."""
    if is_dataclass(record) and not isinstance(record, type):
        found = ((name, getattr(record, name), optional) for name, optional in _names(type(record)))
        return {name: value for name, value, optional in found if value is not None or not optional}
    if isinstance(record, Mapping):
        return dict(record)
    raise TypeError(f"{type(record).__name__} is no part of a document")


@cache
def _names(record: type) -> tuple[tuple[str, bool], ...]:
    return tuple((part.name, bool(part.metadata.get("left out"))) for part in fields(record))
