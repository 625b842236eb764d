"""Plans of actions against Fast Downward through unified-planning; motions, from inverse kinematics to qualities."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import partial
from statistics import median

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.session import Session
from sqrp_cli.ask.requests import RankRequest
from sqrp_cli.errors import Infeasible
from sqrp_cli.logic.domain import Condition
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.planner import Planner, find_plan
from sqrp_cli.logic.unified_planner import engine_planner
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study.find import Plans, observed
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.timeline import PlannedMotion
from sqrp_cli.task.task import Candidate
from tests.benchmarks.table import cpu_milliseconds, print_table
from tests.cells import ROOT
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


def candidates(runs: int) -> None:
    """What one way takes, from inverse kinematics to its qualities, of the candidates that can be done."""
    cell, rows = open_cell(ROOT / "workspaces" / "tabletop").cell, []
    for name in ("first", "best"):
        session, times = Session.begin(cell, RankRequest("pickup green", ways=name)), list[tuple[float, float, int]]()
        for candidate in session.task.candidates:
            plan = partial(_planned, cell, candidate, session.job)
            if not isinstance(ways := plan(), Infeasible):
                look = partial(observed, cell, ways, session.job.sampling, contending=True)
                times.append((cpu_milliseconds(plan, runs), cpu_milliseconds(look, runs), len(ways)))
        figures = [[own[0] / own[2] for own in times], [own[1] / own[2] for own in times]]
        figures.append([sum(pair) for pair in zip(*figures, strict=True)])
        told = (f"{value:.1f}" for of_part in figures for value in (median(of_part), max(of_part)))
        rows.append([f"--ways {name}", str(sum(own[2] for own in times)), *told])
    head = ["", "ways", "planned, median [ms]", "at most", "observed, median [ms]", "at most", "both [ms]", "at most"]
    print_table("A way of `pickup green` on tabletop, from inverse kinematics to qualities", head, rows, "candidates")


def _planned(cell: Cell, candidate: Candidate, job: RankJob) -> Sequence[PlannedMotion] | Infeasible:
    """The ways of a candidate, of which nothing is known yet."""
    return Plans().of(cell, candidate, job.world, fastest=job.wanted.fastest)[1]
