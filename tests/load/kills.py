"""Runs and workers that are killed while they work."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from tests.load.command import Run, Watch, busiest_child, count_results, results_in, run
from tests.load.table import Table

KILLS = 10


@dataclass(frozen=True)
class Undisturbed:
    """A run that nobody killed, with its results by file name, and the paths that it scored."""

    run: Run
    results: Mapping[str, bytes]
    paths: Sequence[Path]

    def equals(self, other: Run, out: Path) -> bool:
        """Whether another run came to the same, byte for byte."""
        return other.out == self.run.out and results_in(out) == self.results


def kill_runs(table: Table, whole: Undisturbed, out: Path) -> None:
    """Kill a run, resume it, kill it again, ten times in all, at random moments of its work.

    A moment is so many results in the folder, of which one at least is of the run to be killed, and up to 0.3 s more.
    """
    draw, total = random.Random(0), len(whole.results)  # noqa: S311 # the same moments every time
    moments = sorted(draw.sample(range(1, total * 9 // 10), KILLS))
    command = ["score", *whole.paths, "--json", "--jobs", 2, "--out", out, "--resume"]
    print(f"\n{KILLS} times kill -9 while {total} candidates are computed, then --resume")
    print("  after kill   done  unfinished   computed   of which done before   bytes", flush=True)
    known: dict[str, tuple[int, int]] = {}
    interrupted = 0
    nothing_twice = True
    for number, moment in enumerate([*moments, None]):
        before = known
        found = run(*command, watch=None if moment is None else _killer(out, moment, len(known), draw.uniform(0, 0.3)))
        known = {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in out.glob("??/*.json")}
        twice = sum(known.get(name) != written for name, written in before.items())
        same = all(whole.results.get(name) == content for name, content in results_in(out).items())
        interrupted += found.computed < 0 and len(before) < len(known) < total
        nothing_twice &= twice == 0 and same
        figures = f"{len(before):6} {total - len(before):11} {len(known) - len(before):10} {twice:22}"
        print(f"  {number or '-':>10} {figures}   {'the same' if same else 'DIFFERENT'}", flush=True)
    table.title("Killed and resumed")
    table.line("kills that interrupted work", f"{interrupted}", f"{KILLS}", interrupted == KILLS)
    table.line("done before and computed again", "none" if nothing_twice else "some", "none", nothing_twice)
    rest = total - len(before)
    table.line("computed by the last run", f"{found.computed}", f"{rest}", found.computed == rest)
    table.same("results and output", good=whole.equals(found, out))


def _killer(out: Path, moment: int, before: int, later: float) -> Watch:
    """Kills a run some time [s] after so many results are there, one of them its own."""
    reached: list[float] = []

    def watch(process: psutil.Process) -> None:
        if not reached and count_results(out) >= max(moment, before + 1):
            reached.append(time.perf_counter())
        if reached and time.perf_counter() - reached[0] >= later:
            process.kill()

    return watch


def kill_local_worker(table: Table, whole: Undisturbed, out: Path) -> None:
    """Kill one of two processes."""
    table.title("One of two processes killed")
    _kill_worker(table, whole, out, ["--jobs", 2], busiest_child)


def kill_dask_worker(table: Table, whole: Undisturbed, out: Path, address: Path, worker: int) -> None:
    """Kill one of the two workers of a cluster; worker: its process id."""
    table.title("One of two Dask workers killed")
    _kill_worker(table, whole, out, ["--cluster", address], lambda _command: psutil.Process(worker))


def _kill_worker(
    table: Table,
    whole: Undisturbed,
    out: Path,
    options: Sequence[object],
    victim: Callable[[psutil.Process], psutil.Process],
) -> None:
    """Kill a worker of a command when half of the results are there."""
    total, unfinished = len(whole.results), []

    def watch(process: psutil.Process) -> None:
        if not unfinished and count_results(out) >= total / 2:
            victim(process).kill()
            unfinished.append(total - count_results(out))

    found = run("score", *whole.paths, "--json", "--out", out, *options, watch=watch)
    left = sum(unfinished)
    table.line("unfinished at that time", f"{left}", "> 0", left > 0)
    table.line("candidates counted at the end", f"{found.computed}", f"{total}", found.computed == total)
    table.same("results and output", good=whole.equals(found, out))
