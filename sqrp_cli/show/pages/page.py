"""What a page shows: a table of rows, cells, and the motion of each row."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sqrp_cli.document import plain
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.assembly import assembled, asset, packed
from sqrp_cli.study.result import CandidateResult


class FigureShown(NamedTuple):
    """A figure of a row."""

    name: str
    value: str
    """With its unit."""
    means: str = ""
    """The word in the page's list of words that says what it is, if there is one."""


@dataclass(frozen=True, eq=False)
class PageRow:
    """A row of the page's table, with what is shown when it is selected.

    name: of the whole. mark: the row's beginning, such as a rank; labels: what sets it apart from the others, by title.
    candidate: its document in `rank --json`, None where there is none. reasons: what is wrong. scene: index of its
    cell. detail: its `packed` `playback`; None without a motion.
    figures: shown before the candidate's. retried: names of the
    candidate's faults after which the robot tries again; only these have a time for it.
    """

    name: str
    mark: str
    labels: Mapping[str, str]
    candidate: CandidateResult | None
    reasons: Sequence[str]
    scene: int | None
    detail: str | None
    figures: Sequence[FigureShown] = ()
    retried: Collection[str] = ()


@dataclass(frozen=True, eq=False)
class CellScene:
    """A cell. scene: the document of `show --json`. model: its `scene_model`, `packed`."""

    scene: ShowDocument
    model: str


@dataclass(frozen=True, eq=False)
class PageContent:
    """What a page shows.

    heading: of the table. about: what was computed, as pairs of a term and its value, such as version and command.
    of_images: whether the details are what images showed, not what is predicted. placement: mounts and the cameras on
    them, if it is about these, see `write_placement`. compared: whether the rows are answers to one question. opens_at:
    the time [s] that is shown first.
    """

    title: str
    summary: str
    heading: str
    about: Sequence[tuple[str, str]]
    entries: Sequence[PageRow]
    scenes: Sequence[CellScene]
    of_images: bool = False
    placement: Mapping[str, object] | None = None
    compared: bool = True
    opens_at: float = 0.0


def write_page(content: PageContent, path: Path) -> None:
    """Write the page, all or nothing. Raises InputError where it cannot be written or a library is missing."""
    write_atomically(path, page(content))


def page(content: PageContent) -> str:
    """The text of the page: an overview, shown before any motion is decoded, then models and motions."""
    entries, scenes = [row(entry) for entry in content.entries], [scene.scene for scene in content.scenes]
    data = {"overview": packed({**plain(content), "entries": entries, "scenes": scenes})}
    data |= {f"model-{index}": scene.model for index, scene in enumerate(content.scenes)}
    details = enumerate(entry.detail for entry in content.entries)
    data |= {f"detail-{index}": detail for index, detail in details if detail is not None}
    return assembled(content.title, asset("main.js"), data=data)


def row(entry: PageRow) -> dict[str, Any]:
    """A row as the scripts of a page read it."""
    shown = {"moves" if name == "detail" else name: value for name, value in plain(entry).items()}
    return {**shown, "moves": entry.detail is not None, "retried": sorted(entry.retried)}
