"""What commands say of workspaces and tasks: `python -m tests.cli.all_output WORKSPACE TASK [WORKSPACE TASK ...]`.

A program of its own, because the order of Python's sets is drawn anew for each process.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.cli.conftest import _call


def everything(workspace: str, task: str, folder: Path) -> Iterator[tuple[str, object]]:
    """Each command about a task with what it says and writes; folder: an empty one for its files."""
    quick = ("--samples", 4, "--jobs", 1)
    for command in (
        ("check", workspace, "--json"),
        ("show", workspace, "--json"),
        ("check", workspace, task, "--json", "--program", "planned.yaml"),
        ("rank", workspace, task, "--json", *quick, "--program", "ranked.yaml"),
        ("explain", workspace, task, "--all", "--json", *quick, "--ways", "fastest"),
        ("score", workspace, "--json", *quick, "--save-baseline", "baseline.json"),
    ):
        outcome = _call(*(folder / word if word in FILES else word for word in command))
        written = {name: (folder / name).read_text(encoding="utf-8") for name in FILES if (folder / name).exists()}
        for name in written:
            (folder / name).unlink()
        yield " ".join(map(str, command)), [outcome.code, outcome.out, outcome.err, written]


FILES = ("planned.yaml", "ranked.yaml", "baseline.json")

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as own:
        pairs = zip(sys.argv[1::2], sys.argv[2::2], strict=True)
        said = {name: found for pair in pairs for name, found in everything(*pair, Path(own))}
        sys.stdout.write(json.dumps(said).replace(own, ""))
