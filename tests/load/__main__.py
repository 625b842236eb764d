"""What `sqrp score` does under load, each figure beside what is asked: `python -m tests.load [CELLS]`.

Speed-up on two processes, memory, a second run, a Dask cluster of two workers, and workers and whole runs that are
killed. The machine should have two cores and nothing else to do. What two free cores would need is printed too, worked
out from the time that the processes spent computing.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from tests.load.command import ROOT, Run, dask_cluster, results_in, run, spent
from tests.load.kills import Undisturbed, kill_dask_worker, kill_local_worker, kill_runs
from tests.load.table import Table
from tests.random_cell import Crowd, random_cell

OBJECTS, CAMERAS = 9, 5

ROUNDS = 5
"""So often everything is measured in turns.

Within a round the machine is about as fast for all; so it is each round's ratios that count, and the median of them.
"""


@dataclass(frozen=True, eq=False)
class Round:
    """The same scored by one process, by two, and by a Dask cluster of two workers that has just started.

    computing: what client and workers of the cluster spent together [s].
    """

    one: Run
    two: Run
    dask: Run
    computing: float


def measure(folder: Path, cells: int, table: Table) -> None:
    """Print every measurement; folder: for everything that is written."""
    (folder / "cells").mkdir()
    for index in range(cells):
        random_cell(folder / "cells" / f"cell{index:02}", Crowd(index, OBJECTS, CAMERAS))
    paths = [folder / "cells", ROOT / "workspaces"]
    run("score", ROOT / "workspaces" / "tower")  # compiles the program, reads its libraries from the disk
    rounds = [_round(paths, folder / f"round{number}") for number in range(ROUNDS)]
    first = rounds[0]
    whole = Undisturbed(first.two, results_in(folder / "round0" / "two"), paths)
    print(f"{cells} generated cells and the shipped ones: {first.two.computed} candidates; medians of {ROUNDS} rounds")

    def the_same(name: str) -> bool:
        return all(whole.equals(getattr(r, name), folder / f"round{i}" / name) for i, r in enumerate(rounds))

    table.title("Two processes")
    table.line("time of one process", f"{median(each.one.wall for each in rounds):.1f} s")
    table.line("time of two", f"{median(each.two.wall for each in rounds):.1f} s")
    faster = median(each.one.wall / each.two.wall for each in rounds)
    table.line("so many times as fast", f"{faster:.2f}", ">= 1.70", faster >= 1.7)
    free = median(each.one.total / each.two.needed for each in rounds)
    table.line("so many times on two free cores, by computing time", f"{free:.2f}")
    table.same("results and output", good=the_same("one") and the_same("two"))
    memory = max(each.two.memory for each in rounds)
    table.line("peak memory of all processes, shared pages for each", f"{memory:.0f} MB", "< 1500 MB", memory < 1500)
    _second_run(table, _score(paths, folder / "round0" / "two", "--jobs", 2), first.two)

    table.title("Dask, two workers")
    times = median(each.dask.wall / each.two.wall for each in rounds)
    table.line("time, in that of two processes", f"{times:.2f}", "<= 1.25", times <= 1.25)
    computing = median(each.computing / each.two.total for each in rounds)
    table.line("computing, in that of two processes", f"{computing:.2f}")
    table.same("results and output", good=the_same("dask"))
    (folder / "cluster").mkdir()
    with dask_cluster(folder / "cluster") as (address, workers):
        kill_dask_worker(table, whole, folder / "dask_killed", address, workers[0])
    kill_local_worker(table, whole, folder / "local_killed")
    kill_runs(table, whole, folder / "killed")


def _round(paths: list[Path], folder: Path) -> Round:
    folder.mkdir()
    one, two = _score(paths, folder / "one", "--jobs", 1), _score(paths, folder / "two", "--jobs", 2)
    with dask_cluster(folder) as (address, workers):
        before = [spent(pid) for pid in workers]
        dask = _score(paths, folder / "dask", "--cluster", address)
        seconds = sum(spent(pid) - so_far for pid, so_far in zip(workers, before, strict=True))
    return Round(one, two, dask, dask.total + seconds)


def _score(paths: list[Path], out: Path, *options: object) -> Run:
    return run("score", *paths, "--json", "--out", out, *options)


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
