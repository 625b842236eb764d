"""Results as documents: the record that `--json` prints is the one that Python gets, and that tables and pages show.

How a command becomes so:

1. Its request (`sqrp_cli.ask`) holds all that is asked. One function takes the request and returns the document.
2. The document is a frozen dataclass of plain fields: `class RunDocument(WorkspaceDocument)`, decorated with
   `@dataclass(frozen=True, kw_only=True, repr=False)`. Its kind is stated: `document: Literal["run"] = "run"`.
3. All that its table needs is a field of it, words too: a table takes the document, nothing else. `VIEW` names the
   function that prints it, as `module:function`; it is imported when something is shown.
4. What only this process can know (motions, an open cell, to write a program or a page) is a field made with `live()`:
   no JSON, schema or saved file has it. Its type is `Any` at run time (`if TYPE_CHECKING: ... else: X = Any`).
5. The command reads its request, calls the function, and shows: `answer(found, as_json=ask.json)`.
6. Its kind has a line in `sqrp_cli.show.documents.KINDS`; then `sqrp show FILE` prints the table of a saved result.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sized
from dataclasses import MISSING, field, fields, is_dataclass
from functools import cache
from importlib import import_module
from typing import Any, ClassVar, Literal, Self

from sqrp_cli.records import dataclass

Pose = list[list[float]]  # a 4x4 pose as nested rows, frame in parent
LEFT_OUT: Mapping[str, bool] = {"left out": True}
"""Metadata of a field that a document has only where it is not its default."""
LIVE: Mapping[str, bool] = {"live": True}  # metadata of a field that no document has; see `live`


def live(default: Any = None, *, factory: Any = MISSING) -> Any:  # noqa: ANN401 - a field of any type
    """A field that is known only in the process that found the result: its default in a result that was read."""
    made = {"default": default} if factory is MISSING else {"default_factory": factory}
    return field(**made, metadata=LIVE, repr=False, compare=False)


class Record:
    """A part of a document; its fields are a contract with other programs. SI units, radians, shares in 0..1."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012 - read by Pydantic, for the JSON Schema


@dataclass(frozen=True, kw_only=True, repr=False)
class Document(Record):
    """A result. `print` and a notebook show it as its command does."""

    VIEW: ClassVar[str] = ""
    """The function that prints it, as `module:function`; empty while none can from the document alone."""

    schema: Literal[1] = 1
    """Version of the fields."""
    document: str = ""
    """The command that prints it."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"a result of `sqrp {self.document}`"

    @classmethod
    def read(cls, text: str) -> Self:
        """The document of a JSON text; raises pydantic's ValidationError for another one."""
        from pydantic import TypeAdapter

        return TypeAdapter(cls).validate_json(text)

    def to_json(self) -> str:
        """One line of JSON, as `--json` prints it. Raises ValueError if a figure is not finite.

        Non-ASCII characters are escaped, so that they survive any stream and no terminal obeys them. So is the second
        of two `#` in a row, with which commands to CI servers begin.
        """
        return json.dumps(self, default=plain, allow_nan=False).replace("##", "#\\u0023")

    def show(self, **how: bool) -> None:
        """Print it to the terminal. how: what its view may leave out or add, such as `all_rows`."""
        module, function = self.VIEW.split(":")
        getattr(import_module(module), function)(self, **how)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.brief})"

    def __str__(self) -> str:
        return str(import_module("sqrp_cli.show.terminal.console").captured(self.show))

    def _repr_html_(self) -> str:
        return str(import_module("sqrp_cli.show.terminal.console").captured(self.show, html=True))


@dataclass(frozen=True, kw_only=True, repr=False)
class WorkspaceDocument(Document):
    """How a document about a workspace begins."""

    workspace: str
    """Its name: that of its folder, or of its file if that is not `workspace.yaml`."""


@dataclass(frozen=True, kw_only=True, repr=False)
class TaskDocument(WorkspaceDocument):
    """How a document about a task begins."""

    task: str
    """As it was asked for."""


def how_many(several: Sized, noun: str) -> str:
    """How many there are, such as `1 candidate` or `6 candidates`."""
    return f"{len(several)} {noun}{'' if len(several) == 1 else 's'}"


def plain(record: object) -> dict[str, Any]:
    """The fields of a record, or the entries of a mapping, one level deep."""
    if is_dataclass(record) and not isinstance(record, type):
        found = ((name, getattr(record, name), left_out) for name, left_out in _names(type(record)))
        return {name: value for name, value, left_out in found if left_out is MISSING or value != left_out}
    if isinstance(record, Mapping):
        return dict(record)
    raise TypeError(f"{type(record).__name__} is no part of a document")


@cache
def _names(record: type) -> tuple[tuple[str, Any], ...]:
    """The fields of a document, each with the value that is left out, MISSING where none is."""
    known = (part for part in fields(record) if not part.metadata.get("live"))
    return tuple((part.name, part.default if part.metadata.get("left out") else MISSING) for part in known)
