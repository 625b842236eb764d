"""What a page that `--report` wrote carries."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any


def detail_in(page: Path, number: int = 0) -> dict[str, Any]:
    """The document of one of the candidates of a page."""
    return carried(page, f"detail-{number}")


def overview_of(page: Path) -> dict[str, Any]:
    """What a page shows first."""
    return carried(page, "overview")


def carried(page: Path, name: str) -> dict[str, Any]:
    """A document that a page carries."""
    (data,) = re.findall(rf'id="{name}">([^<]*)<', page.read_text(encoding="utf-8"))
    document = json.loads(zlib.decompress(base64.b64decode(data)))
    assert isinstance(document, dict)
    return document
