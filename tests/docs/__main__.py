"""Writes what the commands print into the documentation: `python -m tests.docs`, or with the pages to write."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.docs.page import PAGES, played

for page in [Path(name).resolve() for name in sys.argv[1:]] or PAGES:
    text = page.read_text(encoding="utf-8")
    for block, printed in reversed(list(played(page))):
        text = f"{text[: block.start]}$ {block.command}\n{printed}{text[block.end :]}"
    page.write_text(text, encoding="utf-8")
