"""Running a program in a simulated cell, once or many times with a fault at other instants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.program.record import Program, ProgramPrimitive, Replanner
from sqrp_cli.records import dataclass
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.perception.detections import CellModel
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.perception.streams import ImageStreams
from sqrp_cli.run.record.events import VERSION, ProgramStep, RunBegan
from sqrp_cli.run.record.report import FaultRecord, RunReport, SweptRun
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.run.run import Recording, Run


@dataclass(frozen=True, eq=False)
class Simulation:
    """What runs of a program need; `replanner` plans retries."""

    program: Program
    workspace: Workspace
    replanner: Replanner
    seed: int

    def cell(self) -> SimulatedCell:
        """A cell at the start of the program."""
        return SimulatedCell(self.workspace, self.program.steps[0].before, self.seed)

    def run(self, faults: Sequence[InjectedFault] = (), recording: Recording | None = None) -> RunReport:
        """One run. Raises InputError where the simulator cannot be used."""
        with self.cell() as cell:
            return self._run(cell, faults, recording)

    def run_in(self, cell: SimulatedCell, faults: Sequence[InjectedFault] = ()) -> RunReport:
        """One run, as `run` but in a cell that `cell` made, which saves the time to make it."""
        cell.reset(self.program.steps[0].before)
        return self._run(cell, faults, None)

    def _run(self, cell: SimulatedCell, faults: Sequence[InjectedFault], recording: Recording | None) -> RunReport:
        body = RobotBody.load(self.workspace.robot)
        with DetectorPool(CellModel.of(self.workspace, body)) as detectors:
            streams = ImageStreams(self.workspace.cameras, detectors)
            return Run(self.program, self.workspace, body, cell, streams, self.replanner, faults, recording).run()


def sweep(
    simulation: Simulation, step: int, primitive: ProgramPrimitive, count: int, step_done: Callable[[], None]
) -> Iterator[SweptRun]:
    """Runs with a slip at `count` instants, in the middle of as many equal parts of a primitive.

    step: its number, from 1. step_done: called after each run.
    """
    with simulation.cell() as cell:
        for x in instants(primitive.start, primitive.end, count):
            report = simulation.run_in(cell, [slip_at(x, step)])
            step_done()
            # A run may see a fault that was not injected, or stop, before the step begins.
            slip = next((fault for fault in report.faults if fault.injected is not None), FaultRecord("slip"))
            yield SweptRun(**vars(slip), x=x, outcome=report.outcome, reason=report.reason, time=report.time)


def instants(start: float, end: float, count: int) -> list[float]:
    """The middles of `count` equal parts of a time [s]."""
    return [start + (index + 0.5) / count * (end - start) for index in range(count)]


def slip_at(x: float, step: int = 1) -> InjectedFault:
    """A slip at time x [s] of a step; step: its number, from 1."""
    return InjectedFault("slip", f"{'' if step == 1 else f'{step}:'}slip@{x:.3f}", x, step=step)


def header(program: Program, workspace: Workspace, seed: int, faults: Sequence[InjectedFault]) -> RunBegan:
    """What a log begins with."""
    steps = [ProgramStep(skill=step.skill, parameters=dict(step.parameters), time=step.time) for step in program.steps]
    return RunBegan(
        t=0.0,
        sqrp_log=VERSION,
        workspace=workspace.name,
        digest=workspace.digest,
        seed=seed,
        cameras=list(workspace.cameras),
        rates={name: camera.rate for name, camera in workspace.cameras.items()},
        faults=[fault.text for fault in faults],
        steps=steps,
    )
