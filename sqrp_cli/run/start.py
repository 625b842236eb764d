"""Starts runs of a program in a simulated cell, once or many times with a fault at other instants.

And programs at a share of their speed, as robots run them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.files.entries import Entry
from sqrp_cli.logic.image_time import Onset, Window
from sqrp_cli.program.record import Program, ProgramPrimitive, Replanner, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.record.events import VERSION, Event, ProgramStep, event
from sqrp_cli.run.record.report import FaultRecord, RunReport, SweptRun
from sqrp_cli.run.run import Recording, Run
from sqrp_cli.trajectory import Trajectory

if TYPE_CHECKING:
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell


@dataclass(frozen=True, eq=False)
class Simulation:
    """What runs of a program in a simulated cell need; `replanner` plans retries."""

    program: Program
    workspace: Workspace
    replanner: Replanner
    seed: int

    def cell(self) -> SimulatedCell:
        """A cell at the start of the program. Raises InputError where the simulator cannot be used."""
        from sqrp_cli.run.cell.simulated_cell import SimulatedCell  # MuJoCo is not needed to command a real cell

        return SimulatedCell(self.workspace, self.program.steps[0].before, self.seed)

    def run(
        self,
        faults: Sequence[InjectedFault] = (),
        recording: Recording | None = None,
        cell: SimulatedCell | None = None,
    ) -> RunReport:
        """One run; cell: that `cell` made and which is used again, which saves the time to make it."""
        if cell is None:
            with self.cell() as cell:
                return self.run(faults, recording, cell)
        cell.reset(self.program.steps[0].before)
        return Run(self.program, self.workspace, cell, self.replanner, faults, recording).run()


def sweep(
    simulation: Simulation, step: int, primitive: ProgramPrimitive, count: int, step_done: Callable[[], None]
) -> Iterator[SweptRun]:
    """Runs with a slip at `count` instants, in the middle of as many equal parts of a primitive.

    step: its number, from 1. step_done: called after each run.
    """
    with simulation.cell() as cell:
        for index in range(count):
            x = primitive.start + (index + 0.5) / count * (primitive.end - primitive.start)
            report = simulation.run([slip_at(x, step)], cell=cell)
            step_done()
            # A run may see a fault that was not injected, or stop, before the step begins.
            slip = next((fault for fault in report.faults if fault.injected is not None), FaultRecord("slip"))
            yield SweptRun(**vars(slip), x=x, outcome=report.outcome, reason=report.reason, time=report.time)


def slip_at(x: float, step: int = 1) -> InjectedFault:
    """A slip at time x [s] of a step; step: its number, from 1."""
    return InjectedFault("slip", f"{'' if step == 1 else f'{step}:'}slip@{x:.3f}", x, step=step)


def header(program: Program, workspace: Workspace, seed: int, faults: Sequence[InjectedFault]) -> Event:
    """What a log begins with."""
    steps = [ProgramStep(skill=step.skill, parameters=dict(step.parameters), time=step.time) for step in program.steps]
    return event(
        "run",
        0.0,
        sqrp_log=VERSION,
        workspace=workspace.name,
        digest=workspace.digest,
        seed=seed,
        cameras=list(workspace.cameras),
        rates={name: camera.rate for name, camera in workspace.cameras.items()},
        faults=[fault.text for fault in faults],
        steps=steps,
    )


_INTERVAL = re.compile(r"(?<=\[)[^\[\]]*(?=\])")
"""The bounds of an interval in the text of a formula."""
_TIMES = ("time", "start", "end", "seen", "usual", "refuted")
"""Fields with times that are as many times as long; how late an image is, how often one is taken, and how long a
literal may lag stay as they are."""


def slowed(step: Step, speed: float) -> Step:
    """A step at a share of its speed, in 0..1, with its predictions: the same paths, and all times longer.

    How late faults are noticed is known by its sights alone.
    """
    if speed == 1.0:
        return step
    found: Step = _longer(step, "", 1.0 / speed)
    return found.model_copy(update={"faults": {}})


def _longer(value: Any, name: str, factor: float) -> Any:  # noqa: ANN401 - of any field of a step
    """The value of a field of that name with all times in it `factor` times as long."""
    match value:
        case float() if name in _TIMES:
            return value * factor
        case str() if name == "formula":
            return _INTERVAL.sub(lambda bounds: ", ".join(repr(float(t) * factor) for t in bounds[0].split(",")), value)
        case tuple():
            return tuple(_longer(part, name, factor) for part in value)
        case Mapping():
            return {key: _longer(part, name, factor) for key, part in value.items()}
        case Trajectory():
            return Trajectory(value.path, value.law.stretched(factor))
        case Onset():
            return Onset(value.x * factor, value.shown * factor)
        case Window():
            return replace(value, start=value.start * factor, end=value.end * factor)
        case Entry():
            fields = ((field, getattr(value, field)) for field in type(value).model_fields)
            return value.model_copy(update={field: _longer(part, field, factor) for field, part in fields})
    return value
