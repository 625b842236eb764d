"""Paths that keep sight, against direct ones and those of a planner that knows no cameras, in random cells."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import mean

import numpy as np

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.study.robustness import Calibration
from tests.benchmarks.table import print_table
from tests.random_cell import Crowd, random_cell
from tests.study.compared import Compared, blind_time

OBJECTS, CAMERAS = 6, 4
"""Of a random cell."""

CALIBRATION, DRAWS = Calibration(0.005, np.deg2rad(0.5), seed=0), 3
"""How far cameras may be off: 5 mm and 0.5 degrees."""

EQUAL = 1e-3
"""Blind times that differ by no more than this share of the monitored time are equal: the samples' tolerance."""


def paths(cells: int) -> None:
    """Blind times of the first feasible candidate of random cells, in one way with direct and with other paths."""
    direct, planned, seen, extra, costs, off = [], [], [], [], [], []
    better = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(cells):
            place = Path(folder) / str(seed)
            random_cell(place, Crowd(seed, OBJECTS, CAMERAS))
            workspace = load_workspace(place)
            start = time.process_time()
            found = Compared.of(workspace, "pickup path=seen")
            costs.append(time.process_time() - start)
            direct.append(blind_time(found.direct))
            planned.append(blind_time(found.planned))
            seen.append(blind_time(found.seen))
            extra.append(found.seen.planned.motion.time - found.direct.motion.time)
            better += seen[-1] <= min(direct[-1], planned[-1]) + EQUAL * found.seen.planned.T
            draws = [found.off(CALIBRATION, draw) for draw in range(DRAWS)]
            off.append(mean(blind_time(draw.direct) - blind_time(draw.seen) for draw in draws))
    rows = [
        ["direct paths", f"{mean(direct):.2f}", "", ""],
        ["shortest paths of RRT-Connect, simplified", f"{mean(planned):.2f}", "", ""],
        [
            "paths that keep sight",
            f"{mean(seen):.2f}",
            f"{mean(direct) - mean(seen):.2f}",
            f"{mean(off):.2f}",
        ],
    ]
    head = ["the same way with", "blind [s]", "gain [s]", "cameras off"]
    print_table(f"Joint moves in {cells} random cells, means", head, rows)
    print(f"  fewer or as many blind seconds as both others in {better} of {cells} cells;")
    cpu = f"{mean(costs):.2f} s of CPU a candidate ({max(costs):.2f} s at most), loading included"
    print(f"  {mean(extra):.2f} s longer; {cpu}")
