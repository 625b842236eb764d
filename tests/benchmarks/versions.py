"""Ways per second, and where the time goes; with a baseline checkout, against that one, in turns.

As a script, it is one such run: `python versions.py WORKLOAD COUNT` with the checkout as `PYTHONPATH`.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

STAGES = ("interpreter, imports", "cell", "planning", "sensing", "verdict", "rest")
"""Each without the stages inside it."""

WORKLOADS = {
    "tabletop": "`pickup green` in tabletop, every way of each candidate",
    "fastest": "`pickup green` in tabletop, the fastest way of each candidate",
    "crowd": "the fastest ways in a cell with 200 objects and 24 cameras",
}

WATCHED = {
    "planning": (
        ("sqrp_cli.programming.coverage.assessment", "feasible_motion"),
        ("sqrp_cli.programming.ways.find", "impossible_start"),
        ("sqrp_cli.programming.ways.find", "plan_motion"),
        ("sqrp_cli.programming.ways.find", "plan_branches"),
    ),
    "sensing": (
        ("sqrp_cli.programming.coverage.assessment", "observe"),
        ("sqrp_cli.programming.coverage.assessment", "observe_all"),
        ("sqrp_cli.programming.ways.prospect", "look_at"),
    ),
    "verdict": (("sqrp_cli.programming.pipeline", "verdict"), ("sqrp_cli.programming.pipeline", "verdicts")),
}
"""The functions of each stage; a checkout has some of them."""

_ROOT = Path(__file__).parents[2]


def versions(runs: int, candidates: int, baseline: Path | None) -> None:
    """Where the time of each workload goes, as the least CPU time of several runs."""
    from tests.benchmarks.table import print_table

    trees = {"now": _ROOT} if baseline is None else {"now": _ROOT, "before": baseline.resolve()}
    for workload, title in WORKLOADS.items():
        found: dict[str, list[dict[str, str]]] = {name: [] for name in trees}
        for _ in range(runs):
            for name, tree in trees.items():
                found[name].append(_run(tree, workload, candidates))
        least = {
            name: {stage: min(float(run[stage]) for run in of_tree) for stage in (*STAGES, "whole")}
            for name, of_tree in found.items()
        }
        rows = [[stage, *_cells([least[name][stage] for name in trees])] for stage in (*STAGES, "whole")]
        work = {name: int(of_tree[0]["ways"]) for name, of_tree in found.items()}
        planned = {name: least[name]["whole"] - sum(least[name][stage] for stage in STAGES[:2]) for name in trees}
        rows.append(["ways", *(f"{count}" for count in work.values())])
        rows.append(["ways per second, loaded", *(f"{1e3 * work[name] / planned[name]:.0f}" for name in trees)])
        print_table(title, ["CPU", *(f"{name}, ms" for name in trees), *(["ratio"] if baseline else [])],
                    [row + [""] * (len(rows[0]) - len(row)) for row in rows])  # fmt: skip
        if baseline is not None and workload != "tabletop":
            same = {run["figures"] for of_tree in found.values() for run in of_tree}
            print("  The figures are the same." if len(same) == 1 else "  THE FIGURES DIFFER.")


def _cells(times: list[float]) -> list[str]:
    return [f"{value:.0f}" for value in times] + ([f"{times[0] / times[1]:.2f}"] if len(times) > 1 else [])


def _run(tree: Path, workload: str, count: int) -> dict[str, str]:
    output = subprocess.run(
        [sys.executable, __file__, workload, str(count)],
        check=True, capture_output=True, text=True, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)},
    ).stdout  # fmt: skip
    return dict(line.split("\t") for line in output.splitlines())


class _Clock:
    """CPU time of each stage, without that of the stages that run inside it [ms]."""

    def __init__(self) -> None:
        self.times = dict.fromkeys(STAGES, 0.0)
        self._stage, self._since = STAGES[0], 0.0

    def enter(self, stage: str) -> str:
        """Begin a stage; returns the one before."""
        now, before = time.process_time(), self._stage
        self.times[before] += 1e3 * (now - self._since)
        self._stage, self._since = stage, now
        return before

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Count every call of a module's function to a stage."""
        work: Callable[..., Any] = getattr(owner, name)

        def watched(*args: Any, **kwargs: Any) -> Any:
            before = self.enter(stage)
            try:
                return work(*args, **kwargs)
            finally:
                self.enter(before)

        setattr(owner, name, watched)


def _main(workload: str, count: int) -> None:
    """One run: a line per stage and figure, name and value with a tab between."""
    clock = _Clock()
    from sqrp_cli.cli import main as _  # noqa: F401 - what every command imports
    from sqrp_cli.knowledge.workspace.load import load_workspace
    from sqrp_cli.platform.memory import keep_freed_memory
    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.coverage.sampling import Adaptive
    from sqrp_cli.programming.pipeline import Assignment, assess_all
    from sqrp_cli.programming.task import read_task
    from tests.benchmarks.candidates import YAWS, _crowded

    keep_freed_memory()
    clock.enter("cell")
    with tempfile.TemporaryDirectory() as folder:
        crowded = workload == "crowd"
        workspace = load_workspace(_crowded(Path(folder)) if crowded else Path("workspaces/tabletop"))
        cell = Cell.load(workspace)
    clock.enter("rest")
    candidates = read_task("pickup green", workspace).candidates
    if crowded:
        starts = np.linspace(0, len(candidates) - YAWS, max(1, count // YAWS)).astype(int) // YAWS * YAWS
        candidates = [candidate for start in starts for candidate in candidates[start : start + YAWS]]
    for stage, functions in WATCHED.items():
        for place, name in functions:
            owner = _found(place)
            if owner is not None and hasattr(owner, name):
                clock.watch(owner, name, stage)
    find = _found("sqrp_cli.programming.ways.find")
    wanted = {} if find is None else {"wanted": find.WantedWay(fastest=workload != "tabletop")}
    assignment = Assignment(cell=cell, world=workspace.stated_world, sampling=Adaptive(), **wanted)
    found = list(assess_all(assignment, candidates, 1))
    clock.enter("rest")
    tried = [getattr(one, "ways", None) for one in found]
    figures = [(one.q_avg, one.q_eoi, one.time, one.faults, one.verdict) for one in found]
    for stage, value in clock.times.items():
        print(f"{stage}\t{value}")
    print(f"whole\t{sum(clock.times.values())}")
    print(f"ways\t{sum(1 if ways is None else ways.tried for ways in tried)}")
    print(f"figures\t{hashlib.sha256(repr(figures).encode()).hexdigest()}")


def _found(module: str) -> Any:
    """A module of the checkout; None if it has none of this name."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return None


if __name__ == "__main__":
    _main(sys.argv[1], int(sys.argv[2]))
