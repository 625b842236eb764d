"""What `sqrp score` does under load: two processes, a Dask cluster of two workers, workers and runs that are killed.

The machine should have two cores and nothing else to do.
"""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import psutil

from tests.cells import ROOT
from tests.random_cell import Crowd, random_cell

CELLS, OBJECTS, CAMERAS = 40, 9, 5
ROUNDS, KILLS = 5, 10
"""So often everything is measured in turns, as within a round the machine is about as fast for all; and is killed."""

Watch = Callable[[psutil.Process], None]


class Run(NamedTuple):
    """A finished command: what it printed, how long it took [s], and what all of its processes needed at most [MB].

    memory: pages that they share counted for each. computed: candidates, by what it says; -1 if it was killed.
    """

    out: str
    wall: float
    memory: float
    computed: int


def _run(*arguments: object, watch: Watch | None = None) -> Run:
    """Run a command of `sqrp`; `watch` is called every 20 ms with its process, and may kill it."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        began, memory = time.perf_counter(), 0.0
        command = [sys.executable, "-m", "sqrp_cli", *map(str, arguments)]
        process = psutil.Popen(command, stdout=out, stderr=err, cwd=ROOT, env=environment)
        while process.poll() is None:
            try:
                everyone = (process, *process.children())
                memory = max(memory, sum(one.memory_info().rss for one in everyone) / 1e6)
            except psutil.Error:
                pass  # it ended while we looked
            if watch is not None:
                watch(process)
            time.sleep(0.25 if watch is None else 0.02)
        wall = time.perf_counter() - began
        out.seek(0)
        err.seek(0)
        found = re.search(r"(\d+) of \d+ candidates were computed", err.read())
        return Run(out.read(), wall, memory, -1 if found is None else int(found[1]))


@contextmanager
def _dask(folder: Path) -> Iterator[tuple[Path, int]]:
    """The scheduler file of a cluster with two workers, and the process id of one of these."""
    file, quiet = folder / "scheduler.json", {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = ["--no-dashboard", "--scheduler-file", str(file)]
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", *words]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", *words]
    processes = [subprocess.Popen(command, **quiet) for command in (scheduler, worker, worker)]
    try:
        from distributed import Client

        while not file.exists():
            time.sleep(0.1)
        with Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(2, timeout=60)
            pids = list(client.run(os.getpid).values())
        yield file, pids[0]
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def _results(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("??/*.json")}


def load(_number: int, folder: Path, cells: int = CELLS) -> dict[str, Any]:
    """All measurements, as the lines that are asked."""
    return {"said": f"{cells} cells", "lines": [[words, bool(good)] for words, good in _lines(folder, cells)]}


def load_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    yield from ((words, good) for words, good in found[0]["lines"])


def _lines(folder: Path, cells: int) -> Iterator[tuple[str, bool]]:
    for index in range(cells):
        (folder / "cells").mkdir(exist_ok=True)
        random_cell(folder / "cells" / f"cell{index:02}", Crowd(index, OBJECTS, CAMERAS))
    score = ("score", folder / "cells", ROOT / "workspaces", "--json")
    _run("score", ROOT / "workspaces" / "tower")  # compiles the program, reads its libraries from the disk
    rounds = []
    for turn in range(ROUNDS):
        own = folder / f"round{turn}"
        own.mkdir()
        one, two = (_run(*score, "--jobs", jobs, "--out", own / f"{jobs}") for jobs in (1, 2))
        with _dask(own) as (address, _):
            rounds.append((one, two, _run(*score, "--cluster", address, "--out", own / "dask")))
    whole, kept = rounds[0][1], _results(folder / "round0" / "2")
    total = len(kept)

    def same(run: Run, out: Path) -> bool:
        return run.out == whole.out and _results(out) == kept

    for column, name in enumerate(("1", "2", "dask")):
        equal = all(same(each[column], folder / f"round{turn}" / name) for turn, each in enumerate(rounds))
        yield f"{median(each[column].wall for each in rounds):.1f} s with {name}, the same results: {equal}", equal
    faster, slower = (median(each[a].wall / each[b].wall for each in rounds) for a, b in ((0, 1), (2, 1)))
    yield f"two processes are {faster:.2f} times as fast, at least 1.7", faster >= 1.7
    yield f"Dask takes {slower:.2f} times as long as they, at most 1.25", slower <= 1.25
    memory = max(each[1].memory for each in rounds)
    yield f"peak memory {memory:.0f} MB, less than 1500", memory < 1500
    again = _run(*score, "--jobs", 2, "--out", folder / "round0" / "2")
    quick = again.computed == 0 and again.wall < 3 and again.out == whole.out
    yield f"a second run computes {again.computed} in {again.wall:.2f} s, less than 3, with the same output", quick
    with _dask(folder) as (address, worker):
        yield _worker_killed([*score, "--cluster", address], folder / "d", lambda _: worker, total, same)
    yield _worker_killed([*score, "--jobs", 2], folder / "l", _busiest, total, same)
    yield from _runs_killed([*score, "--jobs", 2, "--out", folder / "k", "--resume"], folder / "k", kept, same)


def _busiest(process: psutil.Process) -> int:
    """The worker of a command that has computed most."""
    worker = max(process.children(), key=lambda child: child.cpu_times().user + child.cpu_times().system)
    return int(worker.pid)


def _worker_killed(
    command: list[object], out: Path, victim: Callable[[psutil.Process], int], total: int, same: Callable[..., bool]
) -> tuple[str, bool]:
    """Kill a worker of a command when half of the results are there."""
    left: list[int] = []

    def watch(process: psutil.Process) -> None:
        if not left and len(_results(out)) >= total / 2:
            psutil.Process(victim(process)).kill()
            left.append(total - len(_results(out)))

    found = _run(*command, "--out", out, watch=watch)
    good = sum(left) > 0 and found.computed == total and same(found, out)
    return f"a worker is killed with {sum(left)} unfinished: {found.computed} of {total} in the end", good


def _runs_killed(
    command: list[object], out: Path, kept: dict[str, bytes], same: Callable[..., bool]
) -> Iterator[tuple[str, bool]]:
    """Kill a run, resume it, kill it again, ten times in all, at random moments of its work.

    A moment is so many results in the folder, of which one at least is of the run to be killed, and up to 0.3 s more.
    """
    draw, total = random.Random(0), len(kept)  # noqa: S311 # the same moments every time
    known: dict[str, tuple[int, int]] = {}
    interrupted, twice, different = 0, 0, 0
    for moment in [*sorted(draw.sample(range(1, total * 9 // 10), KILLS)), None]:
        before, later, reached = known, draw.uniform(0, 0.3), list[float]()

        def watch(process: psutil.Process, moment=moment, before=before, later=later, reached=reached) -> None:
            if not reached and len(_results(out)) >= max(moment, len(before) + 1):
                reached.append(time.perf_counter())
            if reached and time.perf_counter() - reached[0] >= later:
                process.kill()

        found = _run(*command, watch=None if moment is None else watch)
        known = {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in out.glob("??/*.json")}
        twice += sum(known.get(name) != written for name, written in before.items())
        different += sum(kept.get(name) != content for name, content in _results(out).items())
        interrupted += found.computed < 0 and len(before) < len(known) < total
    yield f"{interrupted} of {KILLS} kills interrupted work", interrupted == KILLS
    yield f"{twice} were computed twice, {different} are different", not twice and not different
    rest = found.computed == total - len(before) and same(found, out)
    yield f"the last run computes {found.computed} of {total - len(before)}, and all is the same", rest
