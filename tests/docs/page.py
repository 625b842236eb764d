"""A page of the documentation as a session in a terminal: files are written, commands run, from top to bottom."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
"""Every page that people read."""
BLOCK = re.compile(r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<body>.*?)^```$', re.DOTALL | re.MULTILINE)
ELSEWHERE = ("make", "pip", "git", "dask", ".")
"""First words of commands that set up a machine, which a test does not do."""


@dataclass(frozen=True)
class Block:
    """A block of a page.

    kind: `console` (a command and what it prints), `sh` (commands without output), else the language of a file's text.
    title: the file that it is the content of, if any. body: between the fences.
    """

    kind: str
    title: str | None
    body: str
    start: int
    end: int

    @property
    def command(self) -> str:
        """The command of a `console` block."""
        return self.body.partition("\n")[0].removeprefix("$ ")

    @property
    def output(self) -> str:
        """What a `console` block shows."""
        return self.body.partition("\n")[2]


def blocks(text: str) -> list[Block]:
    """The blocks of a page that are about files and commands."""
    found = [
        Block(match["kind"], match["title"], match["body"], match.start("body"), match.end("body"))
        for match in BLOCK.finditer(text)
    ]
    return [block for block in found if block.kind in ("console", "sh") or block.title]


def played(page: Path, rate: str = "10 Hz") -> Iterator[tuple[Block, str]]:
    """Each `console` block of a page with what its command prints, in a folder with copies of the shipped cells.

    Commands run at 80 columns and without colour. One that refuses its input prints what it says on stderr. rate: that
    of the cells' cameras. Raises AssertionError where a command of a `sh` block fails.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("skills", "workspaces"):
            shutil.copytree(ROOT / part, folder / part)
        for cell in folder.glob("workspaces/*/workspace.yaml"):
            text = cell.read_text(encoding="utf-8")
            cell.write_text(text.replace("rate: 10 Hz", f"rate: {rate}"), encoding="utf-8")
        for block in blocks(page.read_text(encoding="utf-8")):
            if block.title:
                (folder / block.title).parent.mkdir(parents=True, exist_ok=True)
                (folder / block.title).write_text(block.body, encoding="utf-8")
            elif block.kind == "console":
                yield block, _printed(block.command, folder)
            else:
                for line in block.body.splitlines():
                    command = line.partition("  #")[0].strip()
                    if command.split()[:1] not in [[word] for word in ELSEWHERE]:
                        _printed(command, folder, must_succeed=True)


def _printed(command: str, folder: Path, *, must_succeed: bool = False) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "COLUMNS": "80", "NO_COLOR": "1", "PATH": path}
    run = subprocess.run(["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)  # noqa: S607
    assert run.returncode == 0 or (run.returncode in (1, 2) and not must_succeed), run.stderr
    return run.stderr if run.returncode == 2 else run.stdout
