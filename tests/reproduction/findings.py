"""The findings of the paper, as relations that the pipeline's own figures must satisfy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sqrp_cli.geometry import displacement
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.observer import Observer
from tests.reproduction.cells import Outcome
from tests.reproduction.paper import REAL_WORLD, RETRY_EARLIER, SIMULATION, Figures
from tests.reproduction.runs import earlier

DRAWS = 20
"""How often all cameras are moved at random, to see which findings survive."""

Findings = Mapping[str, Callable[[Any], bool]]
"""Statements of the paper, each with whether it holds in an outcome of ours."""


def failing(findings: Findings, outcome: object) -> list[str]:
    """The findings that do not hold."""
    return [text for text, holds in findings.items() if not holds(outcome)]


def moved(cell: Cell, draw: int) -> Cell:
    """The cell with every camera moved by 2 mm and turned by 0.2 degrees at random."""
    random, cameras = np.random.default_rng(draw), []
    for camera in cell.observer.cameras:
        position, axis = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
        cameras.append(replace(camera, X_FC=camera.X_FC @ displacement(0.002 * position, np.radians(0.2) * axis)))
    return replace(cell, observer=Observer(tuple(cameras), cell.observer.solids))


def as_reported(name: str, paper: Figures) -> tuple[str, Callable[[Outcome], bool]]:
    def holds(found: Outcome) -> bool:
        own = found.of.get(name, Figures(np.nan, np.nan, np.nan))
        close = abs(own.q_avg - paper.q_avg) <= 5.0 and abs(own.q_eoi - paper.q_eoi) <= 5.0
        return close and abs(own.time - paper.time) <= 0.1 * paper.time

    return f"{name} has the qualities of the paper to 5 points and its time to 10 %", holds


def same_time(one: str, other: str) -> tuple[str, Callable[[Outcome], bool]]:
    def holds(found: Outcome) -> bool:
        first, second = found.of[one].time, found.of[other].time
        return abs(first - second) <= 0.01 * min(first, second)

    return f"{one} and {other} take the same time", holds


SIMULATED: Findings = dict([
    *(as_reported(name, paper) for name, paper in SIMULATION.items()),
    same_time("g1", "g5"),
    ("nothing of interest is seen of g1", lambda found: found.of["g1"].q_eoi == 0.0),
    ("it is the arm that hides g1 from a camera all through the lift", lambda found: bool(found.hiding)),
    ("cam2 sees all that is of interest of g5", lambda found: "cam2" in found.see_lift_of_g5),
    ("g1 has a much higher Q_avg than g5", lambda found: found.of["g1"].q_avg - found.of["g5"].q_avg > 20.0),
    ("g6 is too far away", lambda found: "g6" not in found.of and "out of reach" in found.why_not_g6),
    ("cam2 sees g6", lambda found: "cam2" in found.see_g6),
    ("g2 is the fastest", lambda found: found.of["g2"].time == min(one.time for one in found.of.values())),
    ("all that is of interest of g2 and g5 is seen", lambda found: found.of["g2"].q_eoi == found.of["g5"].q_eoi == 100),
    ("g2 is ranked first", lambda found: found.first == "g2"),
    ("g3 and g4 have a high Q_avg and a Q_eoi between 50 and 70 %", lambda found: all(
        found.of[name].q_avg > 70.0 and 50.0 <= found.of[name].q_eoi <= 70.0 for name in ("g3", "g4"))),
    ("5 samples per primitive miss 5 to 15 points of what 10 find of g1",
        lambda found: 5.0 <= found.sampled["10"] - found.sampled["5"] <= 15.0),
    ("20 and 40 samples per primitive agree to 1.5 points for g1",
        lambda found: abs(found.sampled["40"] - found.sampled["20"]) < 1.5),
    ("40 samples per primitive and the default agree to 1.5 points for g1",
        lambda found: abs(found.sampled["default"] - found.sampled["40"]) < 1.5),
])  # fmt: skip

REAL: Findings = dict([
    *(as_reported(name, paper) for name, paper in REAL_WORLD.items()),
    same_time("red1", "red2"),
    ("nothing of interest is seen of red2", lambda found: found.of["red2"].q_eoi == 0.0),
    ("it is the arm that hides red2 all through the lift", lambda found: bool(found.hiding)),
])  # fmt: skip

AFTER_A_SLIP: Findings = {
    "after a slip both screws are picked up by a retry": lambda runs: earlier(runs) is not None,
    f"red1 finishes the retry earlier than red2 by about {RETRY_EARLIER:g} s": lambda runs: (
        abs((earlier(runs) or 0.0) - RETRY_EARLIER) <= 3.0
    ),
}
