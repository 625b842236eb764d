"""One self-contained page about the candidates of a task: it opens in any browser and asks no network for anything."""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from sqrp_cli.files import write_atomically
from sqrp_cli.report.libraries import viewer_library
from sqrp_cli.report.packing import packed, visible

SCRIPTS = ("data", "motion", "table", "plot", "timeline", "orbit", "scene", "main")
"""The page's own scripts in the order in which they need each other."""


@dataclass(frozen=True, eq=False)
class PageContent:
    """What a page tells.

    title: of the page. about: what was computed, as pairs of a term and its value, such as version and command.
    ranking: the document of `rank --json`. scene: the document of `show --json`. model: see `model_document`.
    details: `packed` documents of `explain --json` `without_repetition`, one per candidate of the ranking, None where
    it is infeasible.
    """

    title: str
    about: Sequence[tuple[str, str]]
    ranking: dict[str, Any]
    scene: dict[str, Any]
    model: dict[str, Any]
    details: Sequence[str | None]


def write_page(content: PageContent, path: Path) -> None:
    """Write the page, all or nothing. Raises InputError where it cannot be written or a library is missing."""
    write_atomically(path, page(content))


def page(content: PageContent) -> str:
    """The text of the page."""
    library = viewer_library()
    code = "'use strict';\n(() => {\n" + "\n".join(_asset(f"{name}.js") for name in SCRIPTS) + "})();\n"
    overview = {"title": content.title, "about": content.about, "ranking": content.ranking, "scene": content.scene}
    data = {"overview": packed(overview), "model": packed(content.model)}
    data |= {f"detail-{index}": detail for index, detail in enumerate(content.details) if detail is not None}
    carriers = "\n".join(f'<script type="text/plain" id="{name}">{text}</script>' for name, text in data.items())
    parts = {
        "TITLE": html.escape(visible(content.title)),
        "POLICY": f"default-src 'none'; style-src 'unsafe-inline'; script-src {_digest(library)} {_digest(code)}",
        "STYLE": _asset("style.css"),
        "DATA": carriers,
        "LIBRARY": f"<script>{library}</script>",
        "CODE": f"<script>{code}</script>",
    }
    text = _asset("page.html")
    for name, part in parts.items():
        before, _, after = text.partition(f"<!--{name}-->")
        text = before + part + after
    return text


def _digest(script: str) -> str:
    """How the page's policy names a script that may run; any other one may not."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _asset(name: str) -> str:
    return resources.files("sqrp_cli.report").joinpath("page", name).read_text(encoding="utf-8")
