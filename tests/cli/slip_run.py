"""A run with a slip in the lift in a small, fast cell: two cameras, few frames, a quick arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from sqrp_cli.geometry import Array
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from tests.cells import made_cell

RATE = 8.0  # of its cameras [Hz]


@dataclass(frozen=True)
class Cell:
    program: Path
    folder: Path


@dataclass(frozen=True)
class Moment:
    """What MuJoCo itself says of a time: of the tool frame and of `g2`."""

    t: float
    tool: Array
    turn: Array
    thing: Array
    held: str | None


@dataclass(frozen=True)
class SlipRun:
    """What a run left behind; the folder of its cell has its log, its frames and its page.

    moments: what the simulation says, apart from all that is told; by time.
    """

    cell: Cell
    outcome: Any
    moments: list[Moment]


def quick_cell(sqrp: Callable[..., Any], folder: Path) -> Cell:
    """A program for the tabletop with two of its cameras and a faster arm."""
    made_cell("quick", folder)
    program = folder / "pick.yaml"
    assert sqrp("rank", folder, "pickup g2", "--ways", "fastest", "--program", program).code == 0
    return Cell(program, folder)


def run_with_slip(sqrp: Callable[..., Any], cell: Cell) -> SlipRun:
    """Run the program and keep all that can be kept."""
    moments = {}
    real = SimulatedCell.advance

    def advance(self: SimulatedCell, t: float, reference: object) -> float:
        passed = real(self, t, reference)
        moments[round(self.t, 6)] = _moment(self)
        return passed

    folder = cell.folder
    outputs = ("--log", folder / "run.jsonl", "--frames", folder / "frames", "--report", folder / "page.html")
    outputs += ("--record", folder / "run.mcap")
    with mock.patch.object(SimulatedCell, "advance", advance):
        outcome = sqrp("run", cell.program, "--sim", "--fault", "slip@a4+1", "--json", *outputs)
    return SlipRun(cell, outcome, [moments[t] for t in sorted(moments)])


def _moment(physics: SimulatedCell) -> Moment:
    data = physics._data
    thing = data.body("g2")
    return Moment(
        physics.t,
        data.body("suction_tip").xpos.copy(),
        thing.xmat.reshape(3, 3).copy(),
        thing.xpos.copy(),
        physics.held(),
    )
