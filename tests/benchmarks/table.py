"""Timing and printing, shared by the parts of the benchmark."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median


def milliseconds(work: Callable[[], object], runs: int = 5) -> float:
    """Median wall time of a call [ms], after one that is not counted."""
    work()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1e3 * median(times)


def cpu_milliseconds(work: Callable[[], object], runs: int = 5) -> float:
    """Least CPU time of a call in this process [ms], after one that is not counted; what else runs matters little."""
    work()
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def print_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table of at most 80 columns: the first column left-aligned, the others right-aligned."""
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    print(f"\n{title}")
    for row in (head, *rows):
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        print("  " + "  ".join(cells))
