"""Technical words on screens that the page of words does not explain.

`python -m tests.docs.words` runs every command that answers on every shipped cell, opens the pages of `rank` and `run`
and the studio in a browser, and lists them.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from tests.cli.browser import Opened, chromium
from tests.docs.page import ROOT
from tests.studio.hand import Hand, Started

TASKS = {
    "tabletop": ("pickup green", "slip@lift+0.7"),
    "screws": ("pickup screw", "slip@lift+0.7"),
    "tower": ("stack red green", "slip@approach+0.3"),
}
"""A task of every shipped cell, and what may go wrong."""
PAGE = ROOT / "docs" / "words.md"
MOST_WORDS = 12
COMPUTED = "What was computed"
"""Above what a page says of its making: the command, digests and the accuracy in full."""
EXPLAINED = re.compile(r"^\| \*\*(.+?)\*\* \|", re.MULTILINE)
"""A word of the page, in its first table."""

TECHNICAL = re.compile(
    r"\b(?:literals?|atoms?|predicates?|(?:un)?cover(?:s|ed|age|ing)?|pareto\w*|optimal|eoi|q|events? of interest"
    r"|blind\w*|bounds?|gaps?|incidence|optical|obliquely?|silhouettes?|occlu\w+|solutions?|usual(?:ly)?|promised?|(?:in)?feasible"
    r"|primitives?|metrics?|qualit\w+|objectives?|preconditions?|branch(?:es)?|delays?|verdicts?|monitored|targets?|boxe?s?"
    r"|t_\w+|(?:q_)\w+)\b",
    re.IGNORECASE,
)
"""What code, files and definitions say."""
IDENTIFIER = re.compile(r"\b(?:[A-Za-z]\w*_\w+|[a-z]+[A-Z]\w*|[A-Z]{2,}|[A-Za-z]+\d+)\b")
TYPED = re.compile(r"`[^`\n]*`|\bsqrp .*$|--\w[\w-]*(?: (?:'[^']*'|[\w.]+))?|\S*/\S*|\b\w+\([\w, ]+\)", re.MULTILINE)
"""What is typed or stands in a file: between backticks, a command, an option, a path, a fact as formulas write it."""


@cache
def names(cell: str) -> frozenset[str]:
    """All that a shipped cell gives a name."""
    workspace = load_workspace(ROOT / "workspaces" / cell)
    model = Cell.load(workspace).model
    pieces = {name for skill in workspace.skills.values() for name in (skill.name, *skill.pieces, *skill.defaults)}
    robot = {*model.links, *model.arm, *(part.name for part in model.parts)}
    return frozenset({*workspace.objects, *workspace.cameras, *workspace.lights, *robot, *pieces, cell})


def unexplained(screen: str, cell: str) -> Iterator[str]:
    """The technical words of a screen that the page of words does not have."""
    text = TYPED.sub(" ", screen)
    explained = EXPLAINED.findall(PAGE.read_text(encoding="utf-8"))
    yield from (word for word in TECHNICAL.findall(text) if word.lower() not in explained and word not in names(cell))
    yield from (word for word in IDENTIFIER.findall(text) if word not in names(cell))


def screens() -> Iterator[tuple[str, str, str]]:
    """Each command on each shipped cell, its pages and its studio, with the name of the cell and what is shown."""
    for cell, (task, fault) in TASKS.items():
        with tempfile.TemporaryDirectory() as folder, chromium() as browser:
            place = str(ROOT / "workspaces" / cell)
            for words in (
                ["check", place, task],
                ["rank", place, task, "--program", "program.yaml", "--report", "rank.html"],
                ["explain", place, task],
                ["advise", place, task, "--want", "q_avg 100 %, time 20 s", "--ways", "fastest", "--kinds", "aim"],
                ["score", place],
                ["diff", place, place],
                ["program", "program.yaml"],
                ["run", "program.yaml", "--sim", "--fault", fault, "--report", "run.html", "--frames", "frames"],
                ["audit", "program.yaml", "frames"],
            ):
                command = [sys.executable, "-m", "sqrp_cli", *words]
                done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
                assert done.stdout, done.stderr
                yield " ".join(words), cell, done.stdout
            for page in ("rank.html", "run.html"):
                yield page, cell, Opened(browser, Path(folder) / page).page.inner_text("main").partition(COMPUTED)[0]
            studio = Started(Path(place), task, cwd=Path(folder))
            hand = Hand(browser, studio.address)
            hand.wait("return sqrp.settled && sqrp.detailShown")
            yield "studio", cell, hand.page.inner_text("main").partition(COMPUTED)[0]
            studio.closed()


if __name__ == "__main__":
    for command, cell, printed in screens():
        found = dict.fromkeys(unexplained(printed, cell))
        print(f"{command}: {', '.join(found) or 'none'}")
