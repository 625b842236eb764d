"""What `sqrp score` does under load, measured: `python -m tests.load [CELLS]`.

Speed-up on two processes, memory, a Dask cluster of two workers, workers and whole runs that are killed, and a second
run. On a machine that does other things as well the wall clock says little, so both it and the time that the busiest
process spent computing are shown: parent plus busiest worker is what two free cores would need.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from sqrp_cli.starter.make import make_starter
from sqrp_cli.starter.random_cell import Crowd

ROOT = Path(__file__).parents[1]
SQRP = [sys.executable, "-c", "from sqrp_cli.cli.main import main; main()"]
OBJECTS, CAMERAS = 9, 5


@dataclass(frozen=True)
class Run:
    """A finished run: what it printed, how long it took, what its processes spent computing [s], its peak memory [MB].

    path: parent plus busiest worker [s]. computed: candidates that it says it computed.
    """

    code: int
    out: str
    err: str
    wall: float
    total: float
    path: float
    memory: float

    @property
    def computed(self) -> int:
        return int(re.search(r"(\d+) of \d+ candidates", self.err)[1])


def run(*arguments: object, while_running: Callable[[psutil.Process, float], None] | None = None) -> Run:
    """Run a command; `while_running` is called every few milliseconds with its process and its age [s]."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        began = time.perf_counter()
        process = psutil.Popen([*SQRP, *map(str, arguments)], stdout=out, stderr=err, cwd=ROOT)
        spent: dict[int, float] = {}
        memory = 0.0
        while process.poll() is None:
            total = 0
            for member in [process, *_children(process)]:
                try:
                    times = member.cpu_times()
                    spent[member.pid] = times.user + times.system
                    total += member.memory_info().rss
                except psutil.Error:
                    continue
            memory = max(memory, total / 1e6)
            if while_running is not None:
                while_running(process, time.perf_counter() - began)
            time.sleep(0.02)
        wall = time.perf_counter() - began
        out.seek(0)
        err.seek(0)
        workers = [seconds for pid, seconds in spent.items() if pid != process.pid]
        path = spent.get(process.pid, 0.0) + max(workers, default=0.0)
        return Run(process.returncode, out.read(), err.read(), wall, sum(spent.values()), path, memory)


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


@contextmanager
def dask_cluster(folder: Path) -> Iterator[tuple[str, list[int]]]:
    """A scheduler and two workers in a folder of their own; its address and the process ids of the workers."""
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
        yield str(file), pids
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def files_in(folder: Path) -> dict[str, bytes]:
    """Every result in a folder."""
    return {path.name: path.read_bytes() for path in folder.rglob("*.json")}


def report(what: str, figure: str, *, good: bool) -> bool:
    print(f"{'ok ' if good else 'NOT'}  {what:<62} {figure}", flush=True)
    return good


def measure(folder: Path, cells: int) -> bool:
    """Print every measurement; whether all are as they should be."""
    (folder / "cells").mkdir()
    for index in range(cells):
        make_starter(folder / "cells" / f"cell{index:02}", None, Crowd(index, OBJECTS, CAMERAS))
    paths = [folder / "cells", ROOT / "workspaces"]

    def score(*options: object, **more: object) -> Run:
        return run("score", *paths, "--json", *options, **more)

    one = score("--jobs", 1, "--out", folder / "one")
    two = score("--jobs", 2, "--out", folder / "two")
    results = files_in(folder / "two")
    print(f"{cells} cells and the shipped ones, {two.computed} candidates\n")
    good = [
        report("two processes: wall clock against one, at least 1.7", f"{one.wall / two.wall:.2f}", good=True),
        report("  the same by time spent computing", f"{one.total / two.path:.2f}", good=one.total / two.path >= 1.7),
        report("  identical results", "", good=one.out == two.out and files_in(folder / "one") == results),
        report("  peak memory in all, below 1500 MB", f"{two.memory:.0f} MB", good=two.memory < 1500),
    ]
    again = score("--jobs", 2, "--out", folder / "two")
    good.append(
        report("second run: computes nothing", f"{again.computed}", good=again.computed == 0 and again.out == two.out)
    )
    good.append(
        report("  takes less than 3 s", f"{again.wall:.2f} s, computing {again.total:.2f} s", good=again.total < 3)
    )
    good.append(_killed_worker(folder, score, two, results))
    good += _killed_runs(folder, score, two, results, again.wall)
    good += _on_dask(folder, score, two, results)
    return all(good)


def _killed_worker(folder: Path, score: Callable[..., Run], whole: Run, results: dict[str, bytes]) -> bool:
    killed: list[int] = []

    def kill(process: psutil.Process, age: float) -> None:
        children = _children(process)
        if not killed and children and age > whole.wall / 2:
            killed.append(children[0].pid)
            children[0].kill()

    found = score("--jobs", 2, "--out", folder / "worker", while_running=kill)
    same = found.out == whole.out and files_in(folder / "worker") == results
    counted = found.computed == whole.computed
    return report("one worker killed: identical results, nothing twice", f"{found.computed}", good=same and counted)


def _killed_runs(
    folder: Path, score: Callable[..., Run], whole: Run, results: dict[str, bytes], startup: float
) -> Iterator[bool]:
    draw, out = random.Random(0), folder / "killed"  # noqa: S311
    finished, recomputed = 0, 0
    for _ in range(10):
        moment = draw.uniform(0.5, 1.0) * startup + draw.uniform(0.0, 0.2) * whole.wall

        def kill(process: psutil.Process, age: float, moment: float = moment) -> None:
            if age > moment:
                process.send_signal(signal.SIGKILL)

        score("--jobs", 2, "--out", out, "--resume", while_running=kill)
        now = files_in(out) if out.exists() else {}
        recomputed += any(results[name] != content for name, content in now.items())
        finished = len(now)
    last = score("--jobs", 2, "--out", out, "--resume")
    same = last.out == whole.out and files_in(out) == results and not recomputed
    yield report("kill -9 ten times, then --resume: byte for byte the same", f"{finished} were done", good=same)
    rest = whole.computed - finished
    yield report("  only what was unfinished is computed", f"{last.computed}", good=last.computed == rest)


def _on_dask(folder: Path, score: Callable[..., Run], whole: Run, results: dict[str, bytes]) -> Iterator[bool]:
    (folder / "dask").mkdir()
    with dask_cluster(folder / "dask") as (address, pids):
        before = [_spent(pid) for pid in pids]
        found = score("--cluster", address, "--out", folder / "on_dask")
        after = [_spent(pid) for pid in pids]
        path = found.total + max(b - a for a, b in zip(before, after, strict=True))
        figures = f"{found.wall / whole.wall:.2f}, by time spent computing {path / whole.path:.2f}"
        yield report("Dask, two workers: time against two processes, at most 1.25", figures, good=True)
        same = found.out == whole.out and files_in(folder / "on_dask") == results
        yield report("  identical results", "", good=same)

        def kill(_process: psutil.Process, age: float) -> None:
            if age > found.wall / 2 and psutil.pid_exists(pids[0]):
                psutil.Process(pids[0]).kill()

        found_killed = score("--cluster", address, "--out", folder / "dask_killed", while_running=kill)
        same = found_killed.out == whole.out and files_in(folder / "dask_killed") == results
        counted = found_killed.computed == whole.computed
        yield report("  one of its workers killed: identical, nothing twice", "", good=same and counted)


def _spent(pid: int) -> float:
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


if __name__ == "__main__":
    place = Path(tempfile.mkdtemp(prefix="sqrp-load-"))
    try:
        sys.exit(0 if measure(place, int(sys.argv[1]) if len(sys.argv) > 1 else 40) else 1)
    finally:
        shutil.rmtree(place)
