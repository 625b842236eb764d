"""A rearrangement of ten objects in 28 steps: our search against Fast Downward through unified-planning."""

from __future__ import annotations

import random

from sqrp_cli.logic.planner import Plan, Planner, find_plan
from sqrp_cli.logic.unified_planner import engine_planner
from tests.benchmarks.table import milliseconds, print_table
from tests.logic.planning import TOWERS, goal_towers, towers

CUBES = "abcdefghij"
OBJECTS = {name: frozenset({"cube"}) for name in CUBES}
REVERSED = (towers("abcdefgh", "ij"), goal_towers("bacdefgh", "ij"))


def plan(runs: int) -> None:
    """Times and lengths of plans: one that needs 28 steps, and between random towers."""
    shuffled = [random.Random(seed).sample(CUBES, 10) for seed in range(6)]  # noqa: S311
    towers_of_five = ["".join(order[:5]) for order in shuffled], ["".join(order[5:]) for order in shuffled]
    pairs = list(zip(*towers_of_five, strict=True))
    random_tasks = [(towers(*before), goal_towers(*after)) for before, after in zip(pairs[:3], pairs[3:], strict=True)]
    planners: dict[str, Planner] = {"ours": find_plan, "fast-downward": engine_planner("fast-downward")}
    rows = []
    for name, planner in planners.items():
        cells = [name]
        for facts, goal in [REVERSED, *random_tasks]:
            found = planner(TOWERS, OBJECTS, facts, goal, {})
            steps = f"{len(found.steps)} steps" if isinstance(found, Plan) else "none"
            time = milliseconds(lambda p=planner, f=facts, g=goal: p(TOWERS, OBJECTS, f, g, {}), runs)
            cells += [f"{time:.0f}", steps]
        rows.append(cells)
    head = ["", "28 steps [ms]", "", *(cell for number in (1, 2, 3) for cell in (f"random {number}", ""))]
    print_table("Rearranging ten objects", head, rows)
