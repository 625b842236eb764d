"""What a page shows, and its text: scripts, styles, documents and the three.js viewer in one file without a network.

Its documents are small texts that cannot become markup; meshes are simplified.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import unicodedata
import zlib
from collections.abc import Collection, Mapping, Sequence
from importlib import metadata, resources
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from sqrp_cli.document import plain
from sqrp_cli.errors import bad_input
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Triangles
from sqrp_cli.show import sentences

if TYPE_CHECKING:
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.show.documents.scene import ShowDocument
    from sqrp_cli.study.result import CandidateResult

MOST_TRIANGLES = 3000  # triangles of a part in a page; larger meshes are simplified to this many
_SAME_PLACE = 8  # vertices that are equal to so many decimals of a metre are one
_VIEWER = ("resources/templates/viewer.zip", "viewer.html.template")
"""Where trimesh keeps its own viewer page: an archive among its files, and the file in it."""


def check_libraries() -> None:
    """Raises InputError, with the command that installs them, where the libraries that a page needs are missing."""
    for name in ("trimesh", "fast_simplification"):
        _folder(name)


def viewer_library() -> str:
    """The text of three.js (MIT licence), a classic script that defines `THREE`.

    Raises InputError where trimesh is missing or does not carry it. Trimesh itself is not imported, as it takes long.
    """
    archive, name = _VIEWER
    try:
        with ZipFile(_folder("trimesh") / archive) as files:
            template = files.read(name).decode()
    except (OSError, KeyError, BadZipFile):
        template = ""
    _, _, script = template.partition("<script>")
    notice, found, rest = script.partition("*/\n")
    # After the licence comes the library as one line; what follows is the application of trimesh.
    library, _, _ = rest.partition("\n")
    if not found or "THREE={}" not in library or "</script" in library:
        message = f"trimesh {metadata.version('trimesh')} does not carry three.js where it was expected"
        raise bad_input("no-viewer", message, mend="pip install 'trimesh==5.2.0'")
    return f"{notice}*/\n{library}\n"


def simplified(surface: Triangles) -> Triangles:
    """A mesh with its equal vertices merged, and with at most about `MOST_TRIANGLES` triangles."""
    rounded = np.round(surface.vertices, _SAME_PLACE) + 0.0  # not -0.0
    _, first, which = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    vertices, faces = surface.vertices[first], which.reshape(-1)[surface.faces]
    if len(faces) > MOST_TRIANGLES:
        check_libraries()
        from fast_simplification import simplify

        vertices, faces = simplify(vertices, faces, target_count=MOST_TRIANGLES)
    return Triangles(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64))


def _folder(name: str) -> Path:
    """Where a package is installed. Raises InputError where it is not."""
    try:
        spec = find_spec(name)
    except ValueError:  # its import is blocked
        spec = None
    if spec is None or spec.origin is None:
        message = f"a report needs the Python package `{name}`, which is not installed"
        raise bad_input("missing-extra", message, mend="pip install trimesh fast-simplification")
    return Path(spec.origin).parent


# The text of a page

DIGITS = 6  # decimals that figures keep: micrometres and microseconds
_UNSEEN = ("Cc", "Cf", "Co", "Cs", "Zl", "Zp")  # unicode categories of invisible characters that change a line

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
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in (library, code))
    scripts = " ".join(f"'sha256-{digest}'" for digest in digests)  # that may run; no others may
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
    """A record as a JSON value: figures with so many digits, or all (None), and invisible characters spelled out."""
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


def asset(name: str, package: str = "sqrp_cli.show.pages") -> str:
    """A script, style or template of the pages."""
    return resources.files(package).joinpath("browser", name).read_text(encoding="utf-8")


# What a page shows

FigureShown = tuple[str, str, str]
"""A figure of a row: its name, its value with its unit, and the word of the page's list that says what it is."""


@dataclass(frozen=True, eq=False)
class PageRow:
    """A row of the page's table, with what is shown when it is selected."""

    name: str  # of the whole
    mark: str  # at the row's beginning, such as a rank
    labels: Mapping[str, str]  # what sets it apart from the others, by title
    candidate: CandidateResult | None  # its document in `rank --json`; None where there is none
    reasons: Sequence[str]  # what is wrong
    scene: int | None  # index of its cell among `PageContent.scenes`; None if that is not drawn
    detail: str | None  # its `packed_playback`; None without a motion
    figures: Sequence[FigureShown] = ()  # shown before the candidate's
    retried: Collection[str] = ()  # the candidate's faults after which the robot tries again


CellScene = tuple["ShowDocument", str]  # A cell: the document of `show --json`, and its `scene_model`, `packed`


@dataclass(frozen=True, eq=False)
class PageContent:
    """What a page shows."""

    title: str
    summary: str
    heading: str  # of the table
    about: Sequence[tuple[str, str]]  # pairs of a term and its value, such as version and command
    entries: Sequence[PageRow]
    scenes: Sequence[CellScene]
    of_images: bool = False  # whether the details are what images showed, not what is predicted
    placement: Mapping[str, object] | None = None  # mounts and the cameras on them, see `write_placement`
    compared: bool = True  # whether the rows are answers to one question
    opens_at: float = 0.0  # the time that is shown first [s]


def write_page(content: PageContent, path: Path) -> None:
    """Write the page, all or nothing: the overview, then models and motions. Raises InputError where that cannot be."""
    entries, scenes = [row(entry) for entry in content.entries], [scene for scene, _ in content.scenes]
    data = {"overview": packed({**plain(content), "entries": entries, "scenes": scenes})}
    data |= {f"model-{index}": model for index, (_, model) in enumerate(content.scenes)}
    details = enumerate(entry.detail for entry in content.entries)
    data |= {f"detail-{index}": detail for index, detail in details if detail is not None}
    write_atomically(path, assembled(content.title, asset("main.js"), data=data))


def row(entry: PageRow) -> dict[str, Any]:
    """A row as the scripts of a page read it."""
    shown = {"moves" if name == "detail" else name: value for name, value in plain(entry).items()}
    said = [] if entry.candidate is None or entry.detail is None else sentences.told(entry.candidate)
    return {**shown, "moves": entry.detail is not None, "retried": sorted(entry.retried), "said": said}


# Colours of pages and pictures

Color = tuple[int, int, int]  # red, green and blue, 0 to 255
COVERED: Color = (42, 157, 111)
HIDDEN: Color = (208, 58, 75)
CULPRIT: Color = (238, 158, 166)
"""Colour in pictures of what hides a target; the target's outline must stand out from it."""

_NAMED: dict[str, Color] = {
    "red": (207, 74, 63), "green": (74, 157, 91), "blue": (67, 114, 201), "yellow": (217, 178, 58),
    "orange": (221, 132, 52), "brown": (138, 100, 70), "purple": (126, 87, 176), "pink": (219, 130, 165),
    "grey": (180, 188, 196), "gray": (180, 188, 196), "black": (48, 54, 60), "white": (242, 244, 245),
}  # fmt: skip
_ROBOT: tuple[Color, ...] = ((195, 204, 212), (143, 163, 179))
_TOOL: Color = (224, 165, 60)
_OTHER: Color = (170, 178, 185)


def solid_colors(cell: Cell) -> list[Color]:
    """A colour for every solid: objects have their own if it is known, links alternate, the tool stands out."""
    shades, colors = cycle(_ROBOT), []
    for parent in (solid.part.parent for solid in cell.observer.solids):
        if parent in cell.workspace.objects:
            colors.append(_NAMED.get((cell.workspace.objects[parent].color or "").lower(), _OTHER))
        else:
            colors.append(_TOOL if parent in cell.model.tool_links else next(shades))
    return colors
