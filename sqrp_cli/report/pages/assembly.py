"""The text of a page: scripts, styles and documents in one file that opens in any browser and needs no network.

Its documents are small texts that cannot become markup.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import unicodedata
import zlib
from collections.abc import Mapping
from importlib import resources
from typing import Any

from sqrp_cli.report.documents.document import plain
from sqrp_cli.report.pages.libraries import viewer_library

DIGITS = 6
"""Decimals that figures keep: micrometres and microseconds."""

_UNSEEN = ("Cc", "Cf", "Co", "Cs", "Zl", "Zp")
"""Unicode categories of invisible characters that change a line."""

PARTS = (
    "data", "words", "motion", "table", "plot", "timeline", "shape", "orbit", "camera", "sight", "scene", "mounts",
    "page",
)  # fmt: skip
"""The scripts that all pages share, the live one too, each after those that it needs."""


def assembled(
    title: str, start: str, *, data: Mapping[str, str], style: str = "", further: str = "", policy: str = ""
) -> str:
    """The text of a page.

    start: the script that begins to show it. data: packed documents by the id of their element. style, further: rules
    and elements beyond those that all pages share. policy: what the page may do beyond running its own scripts.
    """
    library = viewer_library()
    code = "'use strict';\n(() => {\n" + "\n".join([*(asset(f"{name}.js") for name in PARTS), start]) + "})();\n"
    scripts = f"{_digest(library)} {_digest(code)}"
    parts = {
        "TITLE": html.escape(visible(title)),
        "POLICY": f"default-src 'none'; style-src 'unsafe-inline'; script-src {scripts}{policy}",
        "STYLE": asset("style.css") + style,
        "FURTHER": further,
        "DATA": "\n".join(f'<script type="text/plain" id="{name}">{text}</script>' for name, text in data.items()),
        "LIBRARY": f"<script>{library}</script>",
        "CODE": f"<script>{code}</script>",
    }
    text = asset("page.html")
    for name, part in parts.items():
        before, _, after = text.partition(f"<!--{name}-->")
        text = before + part + after
    return text


def packed(document: object) -> str:
    """A document as base64 of deflated JSON, with `tidy` strings."""
    text = json.dumps(tidy(document), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def tidy(value: Any, digits: int | None = DIGITS) -> Any:  # noqa: ANN401 # a record, or a JSON value of any kind
    """A record as a JSON value, with figures rounded and invisible characters spelled out.

    digits: decimals that figures keep; None for all.
    """
    match value:
        case bool() | int() | None:
            return value
        case float():
            return value if digits is None else round(value, digits)
        case str():
            return visible(value)
        case list() | tuple():
            return [tidy(entry, digits) for entry in value]
        case _:
            return {visible(key): tidy(entry, digits) for key, entry in plain(value).items()}


def visible(text: str) -> str:
    """A text with control and format characters spelled out, such as marks of writing direction."""
    return "".join(
        f"\\u{{{ord(character):x}}}" if unicodedata.category(character) in _UNSEEN else character for character in text
    )


def _digest(script: str) -> str:
    """How the page's policy names a script that may run; no other may."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def asset(name: str) -> str:
    """A script, style or template of the pages."""
    return resources.files("sqrp_cli.report.pages").joinpath("browser", name).read_text(encoding="utf-8")
