"""JSON documents as text."""

from __future__ import annotations

import json
from typing import Any

Document = dict[str, Any]

SCHEMA = 1
"""Version of the documents' fields."""


def as_text(document: Document) -> str:
    """A document as one line of JSON. Raises ValueError if a figure is not finite.

    What is no ASCII is escaped, so that it is exact on any stream and no terminal obeys it; of two `#` in a row, with
    which commands to CI servers begin, so is the second.
    """
    return json.dumps(document, allow_nan=False).replace("##", "#\\u0023")
