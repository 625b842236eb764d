"""The findings of the paper, as relations that the pipeline's own figures must satisfy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from sqrp_cli.geometry import displacement
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.observer import Observer
from tests.reproduction.paper import REAL_WORLD, SIMULATION, Reported
from tests.reproduction.screws import Screws
from tests.reproduction.simulation import Simulation
from tests.reproduction.summary import Summary

Outcome = TypeVar("Outcome")

DRAWS = 20
"""How often all cameras are moved at random, to see which findings survive."""


@dataclass(frozen=True)
class Finding(Generic[Outcome]):
    """A statement of the paper, and whether it holds in an outcome of ours."""

    text: str
    holds: Callable[[Outcome], bool]


def failing(findings: Sequence[Finding[Outcome]], outcome: Outcome) -> list[str]:
    """The findings that do not hold."""
    return [finding.text for finding in findings if not finding.holds(outcome)]


def moved(cell: Cell, draw: int) -> Cell:
    """The cell with every camera moved by 2 mm and turned by 0.2 degrees at random."""
    random, cameras = np.random.default_rng(draw), []
    for camera in cell.observer.cameras:
        position, axis = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
        cameras.append(replace(camera, X_FC=camera.X_FC @ displacement(0.002 * position, np.radians(0.2) * axis)))
    return replace(cell, observer=Observer(tuple(cameras), cell.observer.solids))


def _as_reported(found: Summary | None, reported: Reported) -> bool:
    """Each quality within 5 points, the time within 10 %."""
    return (
        found is not None
        and abs(found.q_avg - reported.q_avg) <= 5.0
        and abs(found.q_eoi - reported.q_eoi) <= 5.0
        and abs(found.time - reported.time) <= 0.1 * reported.time
    )


def _same_time(first: float, second: float) -> bool:
    return abs(first - second) <= 0.01 * min(first, second)


def _reproduces(name: str) -> Finding[Simulation]:
    return Finding(
        f"{name} has the qualities of the paper to 5 points and its time to 10 %",
        lambda found: _as_reported(found.of.get(name), SIMULATION[name]),
    )


SIMULATED: tuple[Finding[Simulation], ...] = (
    *(_reproduces(name) for name in SIMULATION),
    Finding("g1 and g5 take the same time", lambda found: _same_time(found.of["g1"].time, found.of["g5"].time)),
    Finding("nothing of interest is seen of g1", lambda found: found.of["g1"].q_eoi == 0.0),
    Finding("it is the arm that hides g1 from a camera all through the lift", lambda found: bool(found.hide_g1)),
    Finding("cam2 sees all that is of interest of g5", lambda found: "cam2" in found.see_lift_of_g5),
    Finding("g1 has a much higher Q_avg than g5", lambda found: found.of["g1"].q_avg - found.of["g5"].q_avg > 20.0),
    Finding("g6 is too far away", lambda found: "g6" not in found.of and "too far" in found.why_not_g6),
    Finding("cam2 sees g6", lambda found: "cam2" in found.see_g6),
    Finding("g2 is the fastest", lambda found: found.of["g2"].time == min(one.time for one in found.of.values())),
    Finding(
        "all that is of interest of g2 and g5 is seen",
        lambda found: found.of["g2"].q_eoi == found.of["g5"].q_eoi == 100.0,
    ),
    Finding("g2 is ranked first", lambda found: found.first == "g2"),
    Finding(
        "g3 and g4 have a high Q_avg and a Q_eoi between 50 and 70 %",
        lambda found: all(
            found.of[name].q_avg > 70.0 and 50.0 <= found.of[name].q_eoi <= 70.0 for name in ("g3", "g4")
        ),
    ),
    Finding(
        "5 samples per primitive miss 5 to 15 points of what 10 find of g1",
        lambda found: 5.0 <= found.sampled["10"] - found.sampled["5"] <= 15.0,
    ),
    Finding(
        "20 and 40 samples per primitive agree to 1.5 points for g1",
        lambda found: abs(found.sampled["40"] - found.sampled["20"]) < 1.5,
    ),
    Finding(
        "40 samples per primitive and the default agree to 1.5 points for g1",
        lambda found: abs(found.sampled["default"] - found.sampled["40"]) < 1.5,
    ),
)

REAL: tuple[Finding[Screws], ...] = (
    *(
        Finding(
            f"{name} has the qualities of the paper to 5 points and its time to 10 %",
            lambda found, name=name: _as_reported(found.of.get(name), REAL_WORLD[name]),  # type: ignore[misc]
        )
        for name in REAL_WORLD
    ),
    Finding("red1 and red2 take the same time", lambda found: _same_time(found.of["red1"].time, found.of["red2"].time)),
    Finding("nothing of interest is seen of red2", lambda found: found.of["red2"].q_eoi == 0.0),
    Finding("it is the arm that hides red2 all through the lift", lambda found: bool(found.hide_red2)),
)
