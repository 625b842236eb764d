"""Robot descriptions as other files name them: by a path, or as a xacro with arguments."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, Tag, WithJsonSchema

from sqrp_cli.knowledge.text.entries import Entry, Text, mapping_or_else


def _argument(value: object) -> object:
    """An argument as xacro takes it: text."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.15g}" if isinstance(value, int | float) else value


XacroArgument = Annotated[
    str, BeforeValidator(_argument), WithJsonSchema({"type": ["string", "number", "boolean"]}),
]  # fmt: skip


class XacroEntry(Entry):
    """A xacro file and the values of its arguments."""

    xacro: Text = Field(description="The file; relative to this file, or package://.")
    args: dict[str, XacroArgument] = Field(default={}, description="Values of its arguments, by name.")


DescriptionEntry = Annotated[
    Annotated[XacroEntry, Tag("<mapping>")] | Annotated[Text, Tag("<else>")], mapping_or_else()
]
"""A robot description: the path of a plain file or a xacro, or a xacro with arguments."""
