"""Slips at random times in cells made by seed, measured by images, against what is predicted for their time.

Half of the cells have a suction cup, half have fingers. The best way of each candidate suffers its share of slips at
times drawn from the fault's interval, unless no image is predicted to show any; a run ends as soon as the fault is
seen. The mean is predicted from promised images alone: images that show more make it shorter. Its standard error says
what so many slips can tell: each is seen by the next image, so that delays differ by up to a frame period.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.program import OpenProgram
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.logic.image_time import Onset, delays
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.file import new_program
from sqrp_cli.program.record import Program, ProgramResponse
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.record.report import RunReport
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.find import BestWay, WantedWay, find_way
from sqrp_cli.study.program_update import make_step
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import with_verdict
from sqrp_cli.task.task import read_task
from tests.cells import ROOT, shipped_cell, write_cell
from tests.random_cell import Crowd, random_cell

FAULT, TASK = "slip", "pickup"
WITHIN, MEAN = 0.99, 0.05
"""Asked: share of delays within the predicted worst, and by how much their mean may exceed the predicted one."""
ROUNDED = 2e-3
"""Time step of the simulation, and of the check when a fault has come true [s]."""
SCREWS, CAMERAS = 3, 3
LIMITS = {"velocity": "60 deg/s", "acceleration": "300 deg/s^2", "jerk": "3000 deg/s^3"}
"""Of the arm with fingers: faster than that of `screws`, so that a trial takes less time."""


def slips(number: int, folder: Path, n: int = 20) -> dict[str, Any] | None:
    """So many slips in a cell; `delays`: of each that must be seen, as measured, its mean and its worst [s]."""
    path = _cell(folder / "cell", number)
    opened = open_cell(path)
    cell = Cell.load(opened.workspace)
    candidates = read_task(TASK, opened.workspace).candidates
    found = [find_way(cell, candidate, cell.initial_world, Adaptive(), WantedWay()) for candidate in candidates]
    ways = [one.analysis for one in found if isinstance(one, BestWay) and one.analysis.windows[FAULT]]
    if not ways:
        return None
    programs = [OpenProgram(path, _program(cell, way), opened) for way in ways]
    compared, rng = [], np.random.default_rng(number)
    with programs[0].simulated_cell() as simulated:
        for turn in range(n):
            way, program = ways[turn % len(ways)], programs[turn % len(ways)]
            x = float(rng.uniform(*way.onsets[FAULT][0].x[[0, -1]]))
            compared += _compared(way, x, program.simulate(simulated, [InjectedFault("slip", f"slip@{x:.3f}", x)]))
    tool = "fingers" if number % 2 else "suction"
    return {"said": f"{tool}: {_tally(compared)[0]}", "tool": tool, "delays": compared}


def slips_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    for tool in ("suction", "fingers", ""):
        those = [slip for one in found if tool in one["tool"] for slip in one["delays"]]
        said, good = _tally(those)
        yield f"{tool or 'all'}: {said}", good or bool(tool)


def _tally(slips: Sequence[Sequence[float]]) -> tuple[str, bool]:
    if not slips:
        return "none that must be seen", False
    measured, mean, worst = np.array(slips).T
    within, ratio = int((measured <= worst + ROUNDED).sum()), float(measured.sum() / mean.sum())
    # Cochran, Sampling Techniques, 3rd edition, equation 6.13.
    n, left = len(slips), measured - ratio * mean
    error = float(np.sqrt((left**2).sum() / (n - 1) / n) / mean.mean()) if n > 1 else np.inf
    words = (
        f"{within} of {n} within the worst; mean {1e3 * measured.mean():.0f} ms, predicted {1e3 * mean.mean():.0f} ms"
    )
    good = within >= WITHIN * n and (n < 10 or ratio - 1.0 <= MEAN)
    return f"{words}: {100 * (ratio - 1):+.1f} % (standard error {100 * error:.1f})", good


def _compared(way: Analysis, x: float, report: RunReport) -> Iterator[list[float]]:
    """Measured, mean and worst delay of a slip at time x [s] of the motion that came true and must be seen."""
    record = next((fault for fault in report.faults if fault.injected is not None), None)
    onset = way.onsets[FAULT][0]
    if record is None or record.injected is None or record.happened is None:
        return
    happened = record.happened - record.injected + x
    if onset.x[0] <= happened <= onset.x[-1]:
        shown, usual = (np.interp([happened] * 2, onset.x, one) for one in (onset.shown, onset.as_usual.shown))
        found = delays(way.windows[FAULT], Onset(np.full(2, happened), shown, usual), lambda t: t, np.empty(0))
        if found.worst is not None and found.mean is not None:
            yield [np.inf if record.detected is None else record.detected - record.happened, found.mean, found.worst]


def _program(cell: Cell, way: Analysis) -> Program:
    """The program of a way, which stops at the first alarm."""
    full = analyse(cell, way.planned.candidate, cell.initial_world, Adaptive(), full=True)
    assert not isinstance(full, Infeasible)
    step = make_step(TASK, full, with_verdict(cell, full.timeline, full.result), tuple(cell.workspace.cameras))
    stops = [formula.model_copy(update={"response": ProgramResponse(action="stop")}) for formula in step.formulas]
    program = new_program(cell.workspace, cell.model.joints, cell.workspace.path.parent / "program.yaml")
    return program.model_copy(update={"steps": (*program.steps, step.model_copy(update={"formulas": tuple(stops)}))})


def _cell(folder: Path, seed: int) -> Path:
    """A new cell in a folder; the even seeds have a suction cup and cubes, the odd ones two fingers and screws."""
    if seed % 2 == 0:
        return random_cell(folder, Crowd(seed, 4, CAMERAS))
    folder.mkdir()
    rng = np.random.default_rng(seed)
    cell = shipped_cell("screws")
    cell["skills"] = [str(ROOT / "skills" / "pickup")]
    for key, value in LIMITS.items():
        limits = cell["robot"]["limits"][key]
        limits.update({joint: value for joint in limits if "finger" not in joint})
    places: list[Array] = []
    while len(places) < SCREWS:  # in a ring around the robot, apart from each other
        turn, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.65)
        place = np.array([far * np.cos(turn), far * np.sin(turn), 0.03]).round(3)
        if all(np.hypot(*(place - other)[:2]) > 0.2 for other in places):
            places.append(place)
    screw = {"type": "screw", "color": "red", "size": ["3 cm", "3 cm", "6 cm"], "on": "table"}
    screws = {f"red{i + 1}": {**screw, "pose": {"position": place.tolist()}} for i, place in enumerate(places)}
    cell["objects"] = {"table": cell["objects"]["table"], **screws}
    cell["state"] = ["open", *(f"obj_on_table({name})" for name in screws)]
    cell["cameras"] = {f"cam{i + 1}": _camera(rng, places) for i in range(CAMERAS)}
    cell["tasks"] = [{"task": TASK}]
    write_cell(cell, folder)
    return folder


def _camera(rng: np.random.Generator, places: list[Array]) -> dict[str, object]:
    """A camera on a dome over one of the screws, which looks at some place beside it."""
    turn, height, far = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 1.0), rng.uniform(0.8, 1.3)
    target = places[rng.integers(len(places))] + rng.uniform(-0.08, 0.08, 3) + [0, 0, 0.08]
    ray = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
    return {
        "pose": {"position": (target + far * ray).round(3).tolist(), "look_at": target.round(3).tolist()},
        "image": {"width": 1024, "height": 768, "horizontal_fov": "48 deg"},
        "near": "20 cm", "far": "4 m", "rate": "10 Hz", "latency": "50 ms",
    }  # fmt: skip
