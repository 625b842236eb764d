"""Two cameras for shipped and random cells.

Laws: with one way each, the exact figure of the choice is the best of all pairs, by brute force over the definition at
instants 4 ms apart; cameras and ways together are never worse than cameras alone; both are proven.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.search.place import CameraPlacer
from sqrp_cli.search.placing_problem import Problem, Requirements
from sqrp_cli.search.placing_result import PlaceDocument
from tests.cells import ROOT
from tests.random_cell import Crowd, random_cell
from tests.search.test_place import BruteForce, placer

SHIPPED = ("tabletop", "screws", "tower")
ANGLES = (30, 22, 26, 34)
"""Fields of view in turn [deg]: so narrow that two cameras do not always see everything."""
MOUNTS = """
mounts:
  ceiling: {{grid: {{from: [-0.8, -0.8, 1.4], to: [0.8, 0.8, 1.4], step: 40 cm}}}}
  rail: {{rail: {{from: [-0.7, 1.0, 0.6], to: [0.7, 1.0, 0.6], step: 10 cm}}}}
lenses:
  tele: {{image: {{width: 640, height: 480, horizontal_fov: {angle} deg}}, near: 20 cm, far: 4 m, rate: 10 Hz}}
"""
SAME = 1.5e-3
"""Figures that differ by less are the same: brute force places changes to 4 ms."""


def place(number: int, folder: Path) -> dict[str, Any]:
    """The shipped cells come first, then random ones."""
    cell, angle = folder / "cell", ANGLES[number % len(ANGLES)]
    if number < len(SHIPPED):
        cell = ROOT / "workspaces" / SHIPPED[number]
    else:
        seed = number - len(SHIPPED)
        random_cell(cell, Crowd(seed, objects=3 + seed % 3, cameras=1))
    alone, asked = _placed(cell, folder, angle, fastest=True)
    together, _ = _placed(cell, folder, angle, fastest=False)
    pairs = _best_pair(asked)
    laws = {
        "worse than cameras alone": together.objective >= alone.objective - SAME,
        "not the best pair": abs(alone.objective - pairs) <= SAME,
        "not proven": alone.proven and together.proven,
    }
    failed = [words for words, holds in laws.items() if not holds]
    columns = ", ".join(f"{100 * q:.2f}" for q in (together.objective, alone.objective, pairs))
    said = f"mean Q [%] together, alone, of pairs: {columns}, lens {angle} deg {', '.join(failed)}"
    return {"said": said, "failed": failed, "gain": 100 * (together.objective - alone.objective)}


def place_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    gains = [one["gain"] for one in found]
    yield f"ways with cameras: {np.mean(gains):+.1f} points on average, most {max(gains):+.1f}", True
    kept = sum(not one["failed"] for one in found)
    yield f"{kept} of {len(found)} cells keep all laws", kept == len(found)


def _placed(folder: Path, own: Path, angle: float, *, fastest: bool) -> tuple[PlaceDocument, CameraPlacer]:
    """The best cameras, with what chose them; by the mean, as the least is often 0 or 100 % whatever is chosen."""
    cell, wanted = open_cell(folder), Requirements(most=2, objective="mean")
    tasks = [task.task for task in cell.workspace.tasks]
    asked = placer(cell, own, MOUNTS.format(angle=angle), wanted, fastest=fastest, tasks=tasks)
    return asked.place(), asked


def _best_pair(asked: CameraPlacer) -> float:
    """The greatest mean quality of at most two cameras that may stand together, with one way of each candidate."""
    problem = asked.table.problem(0)
    brutes = [BruteForce(asked, number) for number in range(len(asked.table.ways))]
    weights = problem.weights / problem.weights.sum()
    pairs = ({*pair} for pair in _allowed(problem))
    means = ([np.mean(brute.qualities(pair)) for brute in brutes] for pair in pairs)
    return max((float(weights @ one) for one in means), default=0.0)


def _allowed(problem: Problem) -> Iterator[tuple[int, int]]:
    """The pairs that may stand together, each camera also with itself."""
    site = problem.site_of.tolist()
    hiding = {(place, option) for place, options, _ in problem.hiding for option in options}
    free = [option for option in problem.free if site[option] not in problem.shut]
    yield from ((option, option) for option in free)
    for a, b in combinations(free, 2):
        near = site[a] == site[b] or {(site[a], site[b]), (site[b], site[a])} & problem.apart
        if not near and (site[a], b) not in hiding and (site[b], a) not in hiding:
            yield a, b
