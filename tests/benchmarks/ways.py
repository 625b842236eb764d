"""All ways of each candidate of tabletop: how many in a second of CPU time, and where the time goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar
from unittest.mock import patch

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.task import Candidate, read_task
from sqrp_cli.programming.ways import find
from tests.benchmarks.scene import TABLETOP
from tests.benchmarks.table import print_table

STAGES = {"plan_branches": "motions", "prospects": "looks", "observed": "exact"}
"""Functions of `find` that take most of the time, and what they give."""

Result = TypeVar("Result")


def ways(runs: int) -> None:
    """One row for each candidate, the least of several runs, each in a cell loaded anew."""
    workspace = load_workspace(TABLETOP)
    task = read_task("pickup green", workspace)
    rows = []
    for candidate in task.candidates:
        cells = (Cell.load(workspace) for _ in range(runs))
        found = [_spent(Assignment(cell=cell, world=workspace.stated_world), candidate) for cell in cells]
        spent = min(found, key=lambda one: one["all"])
        row = [f"{spent[name]:.0f}" for name in ("tried", "feasible", "all", *STAGES.values())]
        rows.append([candidate.name, *row, f"{1e3 * spent['tried'] / spent['all']:.0f}"])
    head = ["", "tried", "feasible", "ms of CPU", *STAGES.values(), "tried per s"]
    print_table("All ways of each candidate of tabletop", head, rows)


def _spent(assignment: Assignment, candidate: Candidate) -> dict[str, float]:
    """CPU times [ms] of a candidate by stage, and how many ways it has."""
    spent = dict.fromkeys(STAGES.values(), 0.0)

    def watched(work: Callable[..., Result], stage: str) -> Callable[..., Result]:
        def run(*arguments: object, **named: object) -> Result:
            start = time.process_time()
            result = work(*arguments, **named)
            spent[stage] += 1e3 * (time.process_time() - start)
            return result

        return run

    with patch.multiple(find, **{name: watched(getattr(find, name), stage) for name, stage in STAGES.items()}):
        start = time.process_time()
        found = assignment.assess(candidate)
        spent["all"] = 1e3 * (time.process_time() - start)
    known = found.ways
    return {**spent, "tried": known.tried if known else 0, "feasible": known.feasible if known else 0}
