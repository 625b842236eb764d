"""JSON documents as text."""

from __future__ import annotations

from typing import Any

from sqrp_cli.paths_as_text import json_line

Document = dict[str, Any]

SCHEMA = 1
"""Version of the documents' fields."""


def as_text(document: Document) -> str:
    """A document as one line of JSON. Raises ValueError if a figure is not finite."""
    return json_line(document)
