"""Prints tables, and collects the same for a page in Markdown with pictures."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from sqrp_cli import open_cell
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.show.pictures.pictures import SHEET, write_pictures
from sqrp_cli.study.sampling import Sampling

WIDTH, HEIGHT, MARGIN = 800, 120, 40
"""Of a time line [pixels]."""


class Page:
    """A page that grows; pictures go to its folder at once, the text with `write`."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._lines = folder, ["# The paper's experiments, reproduced"]

    @property
    def file(self) -> Path:
        """The page."""
        return self._folder / "README.md"

    def heading(self, text: str) -> None:
        """A section."""
        print(f"\n{text}\n")
        self._lines += ["", f"## {text}"]

    def text(self, text: str) -> None:
        """A paragraph."""
        print(text)
        self._lines += ["", text]

    def table(self, titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table, columns as wide as they need to be."""
        widths = [max(map(len, column)) for column in zip(titles, *rows, strict=True)]
        for row in (titles, *rows):
            print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        print()
        self._lines += ["", f"| {' | '.join(titles)} |", "|" + " --- |" * len(titles)]
        self._lines += [f"| {' | '.join(row)} |" for row in rows]

    def timeline(self, title: str, coverage: tuple[np.ndarray, np.ndarray]) -> None:
        """A time line of covered (up) and uncovered samples: times [s], shape (m,), and whether covered, shape (m,)."""
        t, covered = coverage
        image = Image.new("RGB", (WIDTH, HEIGHT), "white")
        draw = ImageDraw.Draw(image)
        x = MARGIN + (WIDTH - 2 * MARGIN) * t / t[-1]
        y = np.where(covered, 30, HEIGHT - 40)
        draw.line(list(zip(x.tolist(), y.tolist(), strict=True)), fill="#0b6e99", width=2)
        for at, height in zip(x.tolist(), y.tolist(), strict=True):
            draw.ellipse((at - 3, height - 3, at + 3, height + 3), fill="#0b6e99")
        for second in range(0, int(t[-1]) + 1, 2):
            at = MARGIN + (WIDTH - 2 * MARGIN) * second / t[-1]
            draw.text((at, HEIGHT - 18), str(second), fill="black", anchor="mm")
        draw.text((MARGIN - 8, 30), "T", fill="black", anchor="rm")
        draw.text((MARGIN - 8, HEIGHT - 40), "F", fill="black", anchor="rm")
        name = "".join(c if c.isalnum() else "-" for c in title.lower()) + ".png"
        image.save(self._folder / name)
        self._lines += ["", f"{title} (s):", "", f"![{title}]({name})"]

    def pictures(self, cell: str, task: str, choice: str, sampling: Sampling | None = None) -> None:
        """What the cameras see in the blind intervals of a candidate, in its fastest way."""
        opened = open_cell(f"workspaces/{cell}")
        explained = opened.explain(task, choice, sampling=sampling, ways="fastest").explained
        assert explained.study is not None
        with tempfile.TemporaryDirectory() as folder:
            if write_pictures(opened.cell, explained.study, Path(folder)):
                (self._folder / f"{cell}-{choice}.png").write_bytes((Path(folder) / SHEET).read_bytes())
                self._lines += ["", f"Blind intervals of {choice}:", "", f"![{choice}]({cell}-{choice}.png)"]

    def write(self) -> None:
        """Write the page."""
        write_atomically(self.file, "\n".join(self._lines) + "\n")
