"""Timing and printing, shared by the parts of the benchmark."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "how" / "speed.md"
"""Has each table between the lines `<!-- NAME -->` and `<!-- end of NAME -->`."""


def cpu_milliseconds(work: Callable[[], object], runs: int = 5) -> float:
    """Least CPU time of a call in this process [ms], after one that is not counted; what else runs matters little."""
    work()
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def print_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], write_as: str | None = None) -> None:
    """Print a table, the first column left-aligned, the others right-aligned; write_as: its name in `PAGE`, if any."""
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    print(f"\n{title}")
    for row in (head, *rows):
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        print("  " + "  ".join(cells), flush=True)
    if write_as is not None:
        lines = [" | ".join(["", *row, ""]).strip() for row in (head, ["---"] * len(head), *rows)]
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- {write_as} -->\n")
        after = rest.partition(f"<!-- end of {write_as} -->")[2]
        text = "\n".join([f"{before}<!-- {write_as} -->", title, "", *lines, "", f"<!-- end of {write_as} -->{after}"])
        PAGE.write_text(text, encoding="utf-8")
