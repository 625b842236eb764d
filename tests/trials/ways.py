"""Random cells, and all ways of a candidate in them, each stated by hand in the task, against what is shown."""

from __future__ import annotations

from itertools import product
from operator import le
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.study.result import CandidateResult, WayFigures
from tests.cells import ROOT, read_cell, write_cell
from tests.random_cell import Crowd, random_cell

YAWS, ELBOWS, SHOULDERS, WRISTS = (0, 90, 180, -90), ("up", "down"), ("left", "right"), ("flip", "no_flip")

POINT = 0.001
"""Qualities are compared rounded to this."""

SLOW_LIFT = ROOT / "tests" / "cases" / "slow_lift"

Figures = tuple[float, float, float]
"""Q_eoi and Q_avg in points, and the time, as they are compared: less is better in each."""


def cell_with_ways(folder: Path, seed: int) -> tuple[OpenCell, str, tuple[int, ...]]:
    """A cell, a task in it that leaves everything free, and the yaws that may be stated.

    It has two cameras beside a part, out of whose low images it is soon lifted. Two of three are variants of the case
    `slow_lift`, the others have a starter's arm and skill. Every other has a camera on the flange, too.
    """
    rng = np.random.default_rng((seed, 41))
    starter = seed % 3 == 2
    if starter:
        path = random_cell(folder, Crowd(seed, 2, 2))
    else:
        path = folder
        path.mkdir()
    cell = read_cell(path if starter else SLOW_LIFT)
    name = "g1" if starter else "part"
    if not starter:
        turn, far = rng.uniform(-0.5, 0.5), rng.uniform(0.38, 0.5)
        place = np.round([far * np.cos(turn), far * np.sin(turn), 0.02], 3).tolist()
        cell["objects"][name]["pose"] = {"position": place, "rpy": [0, 0, round(float(rng.uniform(-np.pi, np.pi)), 3)]}
    x, y, _ = cell["objects"][name]["pose"]["position"]
    for camera in cell["cameras"].values():
        turn, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.2)
        camera["pose"] = {
            "position": np.round([x + 1.2 * np.cos(turn), y + 1.2 * np.sin(turn), height], 3).tolist(),
            "look_at": np.round([x, y, rng.uniform(0.04, 0.09)], 3).tolist(),
        }
        camera["image"] = {"width": 640, "height": int(rng.integers(70, 200)), "horizontal_fov": "20 deg"}
    if seed % 2:
        cell["cameras"]["hand"] = {
            "frame": cell["robot"]["tool"]["link"],
            "pose": {"position": rng.uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.05)).round(3).tolist(), "rpy": [0, 0, 0]},
            "image": {"width": 640, "height": 480, "horizontal_fov": "70 deg"},
            "near": "1 cm", "far": "2 m", "rate": "10 Hz", "latency": "50 ms",
        }  # fmt: skip
    write_cell(cell, path)
    task = f"pickup {name} via=direct" if starter else f"pick {name}"
    return open_cell(path), task, YAWS if starter else (0, 180)


def compared(way: CandidateResult | WayFigures) -> Figures:
    """The figures of a way as they are compared."""
    assert way.q_eoi is not None
    assert way.q_avg is not None
    assert way.time is not None
    return -round(way.q_eoi / POINT), -round(way.q_avg / POINT), round(way.time, 6)


def stated(cell: OpenCell, task: str, yaws: tuple[int, ...]) -> list[CandidateResult]:
    """Every way that can be done, with all settings stated in a task of its own."""
    tasks = (
        f"{task} approach_yaw={yaw}deg elbow={elbow} shoulder={shoulder} wrist={wrist}"
        for yaw, elbow, shoulder, wrist in product(yaws, ELBOWS, SHOULDERS, WRISTS)
    )
    return [way for one in tasks if (way := cell.rank(one, ways="fastest").candidates[0]).feasible]


def undominated(figures: list[Figures]) -> list[Figures]:
    """Those that no other dominates, each once, in order."""
    return sorted({one for one in figures if not any(o != one and all(map(le, o, one)) for o in figures)})


def ways(number: int, folder: Path) -> dict[str, Any]:
    """Whether the best of all ways by hand is shown, and exactly those that no other dominates are named, each once."""
    cell, task, yaws = cell_with_ways(folder / "cell", number)
    (row,) = cell.rank(f"{task} approach_yaw=any elbow=any shoulder=any wrist=any").candidates
    shown = compared(row) if row.feasible else None
    named = sorted(map(compared, row.ways.pareto)) if row.ways else []
    by_hand = sorted(map(compared, stated(cell, task, yaws)))
    good = shown == min(by_hand, default=None) and named == undominated(by_hand)
    wrong = "" if good else f"  WRONG, by hand {by_hand}"
    return {"said": f"{len(by_hand):2} ways, {len(named)} named, shown {shown}{wrong}", "good": good}
