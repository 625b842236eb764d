"""Rearrangements of ten objects: our search against Fast Downward through unified-planning."""

from __future__ import annotations

import random

from sqrp_cli.logic.domain import Condition
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import Planner, find_plan
from sqrp_cli.logic.unified_planner import engine_planner
from tests.benchmarks.table import cpu_milliseconds, print_table
from tests.logic.planning import TOWERS, goal_towers, towers

CUBES = "abcdefghij"
OBJECTS = {name: frozenset({"cube"}) for name in CUBES}


def plan(runs: int) -> None:
    """Times and lengths of plans: one that needs 28 steps, and between random pairs of towers of five."""
    problems = {"the two lowest of eight change places": (towers("abcdefgh", "ij"), goal_towers("bacdefgh", "ij"))}
    for number in range(3):
        rng = random.Random(number)  # noqa: S311
        before, after = ("".join(rng.sample(CUBES, 10)) for _ in range(2))
        problems[f"random towers {number + 1}"] = (
            towers(before[:5], before[5:]),
            goal_towers(after[:5], after[5:]),
        )
    engine = engine_planner("fast-downward")
    rows = [
        [name, *_cells(find_plan, facts, goal, runs), *_cells(engine, facts, goal, runs)]
        for name, (facts, goal) in problems.items()
    ]
    print_table("Rearranging ten objects", ["", "ours [ms]", "steps", "fast-downward [ms]", "steps"], rows)


def _cells(planner: Planner, facts: frozenset[Atom], goal: Condition, runs: int) -> list[str]:
    found = planner(TOWERS, OBJECTS, facts, goal, {})
    time = cpu_milliseconds(lambda: planner(TOWERS, OBJECTS, facts, goal, {}), runs)
    return [f"{time:.0f}", str(len(found)) if isinstance(found, tuple) else "none"]
