"""JSON documents as text."""

from __future__ import annotations

import json
from typing import Any

Document = dict[str, Any]

SCHEMA = 1
"""Version of the documents' fields."""


def as_text(document: Document) -> str:
    """A document as one line of JSON. Raises ValueError if a figure is not finite."""
    return json.dumps(document, ensure_ascii=False, allow_nan=False)
