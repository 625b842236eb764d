"""Random cells, and all ways of a candidate in them, each stated by hand in the task."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.api.cell import OpenCell
from sqrp_cli.starter.make import make_starter
from sqrp_cli.starter.random_cell import Crowd
from tests.cells import read_cell, write_cell

YAWS, ELBOWS, SHOULDERS, WRISTS = (0, 90, 180, -90), ("up", "down"), ("left", "right"), ("flip", "no_flip")

POINT = 0.001
"""Qualities are compared rounded to this."""

OBJECT = "g1"

Figures = tuple[float, float, float]
"""Q_eoi and Q_avg in points, and the time, as they are compared: less is better in each."""


class Ways(NamedTuple):
    """What is said of a candidate, and what follows from all its ways stated by hand."""

    shown: Figures | None
    """The figures of its row; None if it cannot be done."""
    optimal: set[Figures]
    """Those of the ways that are named as Pareto-optimal."""
    by_hand: list[Figures]
    """Those of every way that can be done."""

    @property
    def right(self) -> bool:
        """Whether the best way is shown, and exactly the ways that no other dominates are named."""
        undominated = {
            one for one in self.by_hand if not any(_dominates(other, one) for other in self.by_hand if other != one)
        }
        return self.shown == min(self.by_hand, default=None) and self.optimal == undominated


def _dominates(one: Figures, other: Figures) -> bool:
    return all(a <= b for a, b in zip(one, other, strict=True))


def random_cell(folder: Path, seed: int) -> OpenCell:
    """A cell with one to three cameras beside the part, through whose low images it is lifted in a moment.

    Every other seed has a camera on the flange, too.
    """
    rng = np.random.default_rng((seed, 41))
    path = make_starter(folder, None, Crowd(seed, 2, int(rng.integers(1, 4)))).folder
    cell = read_cell(path)
    x, y, _ = cell["objects"][OBJECT]["pose"]["position"]
    for camera in cell["cameras"].values():
        turn, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.03, 0.3)
        camera["pose"] = {
            "position": np.round([x + 1.2 * np.cos(turn), y + 1.2 * np.sin(turn), height], 3).tolist(),
            "look_at": np.round([x, y, rng.uniform(0.02, 0.1)], 3).tolist(),
        }
        camera["image"] = {"width": 640, "height": int(rng.integers(90, 320)), "horizontal_fov": "20 deg"}
    cell["detectors"]["color"]["min_pixels"] = 4
    cell["robot"]["limits"] |= {"velocity": "30 deg/s"}
    if seed % 2:
        cell["cameras"]["hand"] = {
            "frame": "flange",
            "pose": {"position": rng.uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.05)).round(3).tolist(), "rpy": [0, 0, 0]},
            "image": {"width": 640, "height": 480, "horizontal_fov": "70 deg"},
            "near": "1 cm",
            "far": "2 m",
            "rate": "10 Hz",
            "latency": "50 ms",
        }
    write_cell(cell, path)
    return open_cell(path)


def ways_of(cell: OpenCell) -> Ways:
    """What is said of the candidate, and all its ways."""
    (row,) = cell.rank(f"pickup {OBJECT}").document.candidates
    tasks = (
        f"pickup {OBJECT} approach_yaw={yaw}deg elbow={elbow} shoulder={shoulder} wrist={wrist} via=direct"
        for yaw, elbow, shoulder, wrist in product(YAWS, ELBOWS, SHOULDERS, WRISTS)
    )
    found = [cell.rank(task, ways="fastest").document.candidates[0] for task in tasks]
    return Ways(
        shown=_figures(row) if row.feasible else None,
        optimal=set(map(_figures, row.ways.pareto)) if row.ways else set(),
        by_hand=[_figures(way) for way in found if way.feasible],
    )


def _figures(way: object) -> Figures:
    q_eoi, q_avg, time = (getattr(way, name) for name in ("q_eoi", "q_avg", "time"))
    return -round(q_eoi / POINT), -round(q_avg / POINT), round(time, 6)
