"""Commands in processes of their own, with what they print, how long they take and what memory they need."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
COMPILED = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""An environment in which a program is compiled once, as an installed one is."""
SQRP = [sys.executable, "-m", "sqrp_cli"]
LOOKS = 0.25
"""How often a running command is looked at [s]; more often would take from the cores what is to be measured."""


@dataclass(frozen=True)
class Run:
    """A finished command.

    wall: how long it took [s]. total: what its processes spent computing [s]. memory: of all of them at the worst
    instant, pages that they share counted for each [MB]. alone: what was spent before it had workers [s]. busiest: what
    the busiest worker spent [s].
    """

    out: str
    err: str
    wall: float
    total: float
    memory: float
    alone: float
    busiest: float

    @property
    def computed(self) -> int:
        """Candidates that it says it computed; -1 if it was killed before it said so."""
        found = re.search(r"(\d+) of \d+ candidates were computed", self.err)
        return -1 if found is None else int(found[1])

    @property
    def needed(self) -> float:
        """What two cores need that do nothing else [s]: all of it shared between them, but for the beginning."""
        return self.alone + max((self.total - self.alone) / 2, self.busiest)


Watch = Callable[[psutil.Process], None]


def run(*arguments: object, watch: Watch | None = None) -> Run:
    """Run a command of `sqrp`; `watch` is called every 20 ms with its process, and may kill it."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        before = os.times()
        began = time.perf_counter()
        process = psutil.Popen([*SQRP, *map(str, arguments)], stdout=out, stderr=err, cwd=ROOT, env=COMPILED)
        looks = _Looks(process)
        while process.poll() is None:
            looks.look()
            if watch is not None:
                watch(process)
            time.sleep(LOOKS if watch is None else 0.02)
        wall = time.perf_counter() - began
        after = os.times()
        total = after.children_user - before.children_user + after.children_system - before.children_system
        out.seek(0)
        err.seek(0)
        return Run(out.read(), err.read(), wall, total, looks.memory, looks.alone, looks.busiest)


class _Looks:
    """What is seen of a running command and its workers."""

    def __init__(self, process: psutil.Process) -> None:
        self._process = process
        self._spent: dict[int, float] = {}
        self.memory = self.alone = 0.0

    @property
    def busiest(self) -> float:
        return max(self._spent.values(), default=0.0)

    def look(self) -> None:
        try:
            workers = self._process.children()
            if not self._spent:
                self.alone = spent(self._process.pid)
            self._spent |= {worker.pid: spent(worker.pid) for worker in workers}
            self.memory = max(self.memory, sum(p.memory_info().rss for p in (self._process, *workers)) / 1e6)
        except psutil.Error:
            pass  # it ended while we looked


def spent(pid: int) -> float:
    """What a process has spent computing [s]."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def busiest_child(process: psutil.Process) -> psutil.Process:
    """The worker of a command that has computed most."""
    return max(process.children(), key=lambda child: spent(child.pid))


@contextmanager
def dask_cluster(folder: Path) -> Iterator[tuple[Path, list[int]]]:
    """A scheduler and two workers in a folder of their own; the scheduler file and the process ids of the workers."""
    file = folder / "scheduler.json"
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    processes = [subprocess.Popen([*scheduler, "--scheduler-file", str(file)], **quiet)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    processes += [subprocess.Popen([*worker, "--no-dashboard"], **quiet) for _ in range(2)]
    try:
        from distributed import Client

        while not file.exists():
            time.sleep(0.1)
        with Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(2, timeout=60)
            pids = list(client.run(os.getpid).values())
        yield file, pids
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def count_results(folder: Path) -> int:
    """How many results a folder has."""
    return sum(1 for _ in folder.glob("??/*.json"))


def results_in(folder: Path) -> dict[str, bytes]:
    """Every result in a folder, by the name of its file."""
    return {path.name: path.read_bytes() for path in folder.glob("??/*.json")}
