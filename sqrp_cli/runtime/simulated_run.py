"""Running a program in a simulated cell, once or many times with a fault at other instants."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.program import Program, Replanner
from sqrp_cli.runtime.execution import Execution
from sqrp_cli.runtime.faults import InjectedFault
from sqrp_cli.runtime.outcome import Event, FaultRecord, Listener, RunReport
from sqrp_cli.runtime.perception.pool import PerceptionPool
from sqrp_cli.runtime.perception.sighting import CellKnowledge
from sqrp_cli.runtime.recording import Gallery
from sqrp_cli.runtime.simulation.cell import SimulatedCell
from sqrp_cli.runtime.twin import Twin

SWEPT = ("slip",)
"""Faults whose instant can be swept."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """What runs of a program need; `replanner` plans retries."""

    program: Program
    workspace: Workspace
    replanner: Replanner
    seed: int

    def run(
        self, faults: Sequence[InjectedFault] = (), listeners: Sequence[Listener] = (), gallery: Gallery | None = None
    ) -> RunReport:
        """One run. Raises InputError where the simulator cannot be used."""
        twin = Twin.load(self.workspace.robot)
        with PerceptionPool(knowledge_of(self.workspace, twin)) as pool, self.cell() as cell:
            execution = Execution(
                self.program, self.workspace, twin, cell, pool, self.replanner, faults, listeners, gallery
            )
            return execution.run()

    def runs(self, faults: Iterable[InjectedFault]) -> Iterator[RunReport]:
        """One run for each fault, as `run` but in the same cell, which saves the time to make it."""
        twin = Twin.load(self.workspace.robot)
        with self.cell() as cell:
            for fault in faults:
                cell.reset(self.program.steps[0].before.world)
                with PerceptionPool(knowledge_of(self.workspace, twin)) as pool:
                    yield Execution(self.program, self.workspace, twin, cell, pool, self.replanner, [fault]).run()

    def cell(self) -> SimulatedCell:
        """A cell at the start of the program."""
        return SimulatedCell(self.workspace, self.program.steps[0].before.world, self.seed)


def knowledge_of(workspace: Workspace, twin: Twin) -> CellKnowledge:
    """What perception may know of a cell."""
    return CellKnowledge(workspace.cameras, workspace.detectors, workspace.objects, twin, workspace.robot.markers)


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep: when the fault was injected, from the start of the step [s], and what came of it."""

    x: float
    fault: FaultRecord
    report: RunReport


def sweep(simulation: Simulation, text: str, count: int, step_done: Callable[[], None]) -> Iterator[SweepRun]:
    """Runs with a fault such as `slip@a4` at `count` instants, in the middle of as many equal parts of the primitive.

    step_done: called after each run. Raises InputError for a fault that cannot be swept.
    """
    kind, _, name = text.partition("@")
    step = simulation.program.steps[0]
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in step.primitives}
    if kind not in SWEPT or name not in spans:
        hint = f"; {expected_names(name, spans)}" if kind in SWEPT else ""
        raise InputError(Problem("bad-fault", f"--sweep {text}: expected `slip@` and a primitive of the program{hint}"))
    start, end = spans[name]
    instants = [start + (index + 0.5) / count * (end - start) for index in range(count)]
    reports = simulation.runs(InjectedFault("slip", f"slip@{x:.3f}", x) for x in instants)
    for x, report in zip(instants, reports, strict=True):
        step_done()
        yield SweepRun(x, report.faults[0], report)


def header(program: Program, workspace: Workspace, seed: int, faults: Sequence[InjectedFault]) -> Event:
    """What a log begins with."""
    steps = [{"skill": step.skill, "parameters": dict(step.parameters), "time": step.time} for step in program.steps]
    fields = {
        "workspace": workspace.name,
        "digest": workspace.digest,
        "seed": seed,
        "cameras": list(workspace.cameras),
        "faults": [fault.text for fault in faults],
        "steps": steps,
    }
    return Event(0.0, "run", fields)
