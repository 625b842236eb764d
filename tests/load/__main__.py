"""What `sqrp score` does under load, each figure beside what is asked: `python -m tests.load [CELLS]`.

Speed-up on two processes, memory, a second run, a Dask cluster of two workers, and workers and whole runs that are
killed. The machine should have two cores and nothing else to do. What it does besides is printed, and what two free
cores would need, worked out from the time that the processes spent computing.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

from sqrp_cli.starter.make import make_starter
from sqrp_cli.starter.random_cell import Crowd
from tests.load.command import ROOT, Run, dask_cluster, results_in, run, spent
from tests.load.kills import Undisturbed, kill_dask_worker, kill_local_worker, kill_runs
from tests.load.table import Table

OBJECTS, CAMERAS = 9, 5


def measure(folder: Path, cells: int, table: Table) -> None:
    """Print every measurement; folder: for everything that is written."""
    (folder / "cells").mkdir()
    for index in range(cells):
        make_starter(folder / "cells" / f"cell{index:02}", None, Crowd(index, OBJECTS, CAMERAS))
    paths = [folder / "cells", ROOT / "workspaces"]

    def score(out: str, *options: object) -> Run:
        return run("score", *paths, "--json", "--out", folder / out, *options)

    run("score", ROOT / "workspaces" / "tower")  # compiles the program, reads its libraries from the disk
    # The run with one process between the two with two, so that what else the machine does falls on both.
    two, one, other_two = score("two", "--jobs", 2), score("one", "--jobs", 1), score("other_two", "--jobs", 2)
    whole = Undisturbed(two, results_in(folder / "two"), paths)
    print(f"{cells} generated cells and the shipped ones: {two.computed} candidates")
    wall = (two.wall + other_two.wall) / 2
    _speed(table, one, wall, (two.needed + other_two.needed) / 2)
    table.same("results and output", good=whole.equals(one, folder / "one"))
    memory = max(two.memory, other_two.memory)
    table.line("peak memory of all processes, shared pages for each", f"{memory:.0f} MB", "< 1500 MB", memory < 1500)
    _second_run(table, score("two", "--jobs", 2), two)
    (folder / "cluster").mkdir()
    with dask_cluster(folder / "cluster") as (address, workers):
        before = [spent(pid) for pid in workers]
        found = score("dask", "--cluster", address)
        seconds = [spent(pid) - so_far for pid, so_far in zip(workers, before, strict=True)]
        table.title("Dask, two workers")
        table.line("time, in that of two processes", f"{found.wall / wall:.2f}", "<= 1.25", found.wall <= 1.25 * wall)
        spent_there = found.total + sum(seconds)
        table.line("computing, in that of two processes", f"{spent_there / two.total:.2f}")
        table.same("results and output", good=whole.equals(found, folder / "dask"))
        kill_dask_worker(table, whole, folder / "dask_killed", address, workers[0])
    kill_local_worker(table, whole, folder / "local_killed")
    kill_runs(table, whole, folder / "killed")


def _speed(table: Table, one: Run, wall: float, needed: float) -> None:
    """wall, needed: of two processes, see `Run`."""
    table.title("Two processes")
    table.line("time of one process", f"{one.wall:.1f} s")
    table.line("time of two", f"{wall:.1f} s")
    table.line("so many times as fast", f"{one.wall / wall:.2f}", ">= 1.70", one.wall >= 1.7 * wall)
    table.line("so many times on two free cores, by computing time", f"{one.total / needed:.2f}")
    table.line("time that one process had to wait for a core", f"{100 * (1 - one.total / one.wall):.0f} %")


def _second_run(table: Table, again: Run, before: Run) -> None:
    table.title("A second run")
    table.line("candidates that are computed", f"{again.computed}", "0", again.computed == 0)
    table.line("time", f"{again.wall:.2f} s", "< 3 s", again.wall < 3)
    table.same("output", good=again.out == before.out)


if __name__ == "__main__":
    place, began, results = Path(tempfile.mkdtemp(prefix="sqrp-load-")), time.perf_counter(), Table()
    try:
        measure(place, int(sys.argv[1]) if len(sys.argv) > 1 else 40, results)
    finally:
        shutil.rmtree(place)
    print(f"\n{'All is' if results.good else 'NOT all is'} as asked, after {time.perf_counter() - began:.0f} s.")
    sys.exit(0 if results.good else 1)
