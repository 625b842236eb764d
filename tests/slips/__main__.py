"""Slips at random times in cells made by seed, measured by images: `python -m tests.slips [CELLS [SLIPS [FIRST]]]`.

By default 20 slips in each of ten cells, half of them with a suction cup and half with fingers. The best way of each
candidate suffers its share of slips at times drawn from the fault's interval, unless no image is predicted to show
any; a run ends as soon as the fault is seen. Asked: at least 99 % of the measured delays within the longest that is
predicted for their time, and their mean at most 5 % above the predicted one, which counts on promised images alone:
images that show more than was promised make it shorter. Its standard error says what so many slips
can tell: each is seen by the next image, so that delays differ by up to a frame period. What is done is kept in
build/slips, so that an interrupted trial goes on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.ask.api.program import LazyReplanner
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.logic.image_time import Onset, delays
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.file import new_program
from sqrp_cli.program.record import Program, ProgramResponse
from sqrp_cli.run.cell.requirements import check_simulator
from sqrp_cli.run.record.report import RunReport
from sqrp_cli.run.start import Simulation, slip_at
from sqrp_cli.study.assessment import Study, study
from sqrp_cli.study.find import BestWay, WantedWay, find_way
from sqrp_cli.study.program_update import make_step
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import verdict
from sqrp_cli.task.task import read_task
from tests.slips.cells import TASK, make_cell

FOLDER = Path("build/slips")

FAULT = "slip"

WITHIN, MEAN = 0.99, 0.05
"""Asked: share of delays within the prediction, and by how much their mean may exceed the predicted one."""

ROUNDED = 2e-3
"""Time step of the simulation, and of the check when a fault has come true [s]."""


class Slip(NamedTuple):
    """What came of a slip, in seconds."""

    name: str
    """Of the candidate."""
    x: float
    """When it was made to happen, from the start of the motion."""
    happened: float | None
    """When the fault came true; None if it never did."""
    seen: float | None
    """When images showed it; None if none did."""


class Compared(NamedTuple):
    """A measured delay beside what was predicted for its time [s]."""

    measured: float
    mean: float
    worst: float


@dataclass(frozen=True)
class Tally:
    """How many slips that must be seen compare with their predictions."""

    slips: tuple[Compared, ...]

    @property
    def within(self) -> int:
        """How many were seen within the longest predicted delay."""
        return sum(one.measured <= one.worst + ROUNDED for one in self.slips)

    @property
    def ratio(self) -> float:
        """The mean of the measured delays, over that of the predicted ones."""
        return sum(one.measured for one in self.slips) / sum(one.mean for one in self.slips)

    @property
    def error(self) -> float:
        """Standard error of the ratio (Cochran, Sampling Techniques, 3rd edition, equation 6.13)."""
        left = np.array([one.measured - self.ratio * one.mean for one in self.slips])
        n, mean = len(left), float(np.mean([one.mean for one in self.slips]))
        return float(np.sqrt((left**2).sum() / (n - 1) / n) / mean) if n > 1 else np.inf

    def __str__(self) -> str:
        if not self.slips:
            return "none that must be seen"
        measured, mean, _ = np.mean(self.slips, axis=0)
        return (
            f"{self.within} of {len(self.slips)} within the worst; mean {1e3 * measured:.0f} ms, predicted "
            f"{1e3 * mean:.0f} ms: {100 * (self.ratio - 1):+.1f} % (standard error {100 * self.error:.1f})"
        )


def slips(folder: Path, seed: int, count: int) -> tuple[dict[str, Study], list[Slip]]:
    """The ways of a cell, and what came of so many slips in those in which images may show them."""
    workspace = load_workspace(folder if folder.exists() else make_cell(folder, seed))
    cell = Cell.load(workspace)
    candidates = read_task(TASK, workspace).candidates
    found = [find_way(cell, candidate, cell.initial_world, Adaptive(), WantedWay()) for candidate in candidates]
    ways = {one.study.candidate.name: one.study for one in found if isinstance(one, BestWay)}
    ways = {name: way for name, way in ways.items() if way.windows[FAULT]}
    kept, rng = folder / "slips.jsonl", np.random.default_rng(seed)
    done = [Slip(*json.loads(line)) for line in kept.read_text().splitlines()] if kept.exists() else []
    if len(done) >= count or not ways:
        return ways, done
    simulations = [Simulation(_program(cell, way), workspace, LazyReplanner(workspace), 0) for way in ways.values()]
    with simulations[0].cell() as simulated:
        for number in range(count):
            name, simulation = list(ways)[number % len(ways)], simulations[number % len(ways)]
            onset = ways[name].onsets[FAULT][0]
            x = float(rng.uniform(onset.x[0], onset.x[-1]))
            if number < len(done):
                continue
            done.append(_slip(name, x, simulation.run([slip_at(x)], cell=simulated)))
            print(f"{folder.name}: slip {number + 1} of {count}", file=sys.stderr, flush=True)
            with kept.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
    return ways, done


def _slip(name: str, x: float, report: RunReport) -> Slip:
    """What came of a slip at time x [s] of the motion, by the report of its run."""
    record = next((fault for fault in report.faults if fault.injected is not None), None)
    if record is None or record.injected is None or record.happened is None:
        return Slip(name, x, None, None)
    start = record.injected - x
    return Slip(name, x, record.happened - start, None if record.detected is None else record.detected - start)


def _program(cell: Cell, way: Study) -> Program:
    """The program of a way, which stops at the first alarm."""
    full = study(cell, way.candidate, cell.initial_world, Adaptive(), full=True)
    assert not isinstance(full, Infeasible)
    step = make_step(TASK, full, full.assessment(verdict(cell, full)), tuple(cell.workspace.cameras))
    stops = [formula.model_copy(update={"response": ProgramResponse(action="stop")}) for formula in step.formulas]
    program = new_program(cell.workspace, cell.model.joints, FOLDER / "program.yaml")
    return program.with_steps([step.model_copy(update={"formulas": tuple(stops)})])


def compared(ways: dict[str, Study], done: Sequence[Slip]) -> Tally:
    """The slips that came true and must be seen, each with its prediction."""
    return Tally(tuple(_compared(ways, done)))


def _compared(ways: dict[str, Study], done: Sequence[Slip]) -> Iterator[Compared]:
    for slip in done:
        way = ways[slip.name]
        onset = way.onsets[FAULT][0]
        if slip.happened is None or not onset.x[0] <= slip.happened <= onset.x[-1]:
            continue
        shown, usual = (np.interp([slip.happened] * 2, onset.x, one) for one in (onset.shown, onset.as_usual.shown))
        at = Onset(np.full(2, slip.happened), shown, usual)
        found = delays(way.windows[FAULT], at, lambda t: t, np.empty(0))
        if found.worst is not None and found.mean is not None:
            measured = np.inf if slip.seen is None else slip.seen - slip.happened
            yield Compared(measured, found.mean, found.worst)


def main(words: Sequence[str]) -> int:
    """Make cells, let parts slip, and compare; 0 if all that is asked holds."""
    check_simulator()
    numbers = [int(word) for word in words]
    cells, count, first = (*numbers, *(10, 20, 0)[len(numbers) :])
    FOLDER.mkdir(parents=True, exist_ok=True)
    of_tools: dict[str, list[Compared]] = {"suction": [], "fingers": []}
    for seed in range(first, first + cells):
        tool, found = "fingers" if seed % 2 else "suction", compared(*slips(FOLDER / f"cell{seed}", seed, count))
        of_tools[tool] += found.slips
        print(f"cell {seed}, {tool}: {found}", flush=True)
    every = Tally(tuple(chain.from_iterable(of_tools.values())))
    for name, tally in [*((tool, Tally(tuple(found))) for tool, found in of_tools.items()), ("all", every)]:
        print(f"{name}: {tally}")
    print(f"asked: within the predicted worst in {100 * WITHIN:.0f} %, mean at most {100 * MEAN:.0f} % above")
    return int(every.within < WITHIN * len(every.slips) or every.ratio - 1.0 > MEAN)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
