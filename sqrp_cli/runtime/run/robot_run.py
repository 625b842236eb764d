"""Running a program in a cell that is reached by messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, Replanner
from sqrp_cli.program.slowed import SlowedReplanner, slowed
from sqrp_cli.ros.connect import connect
from sqrp_cli.runtime.cell.robot_file import RobotFile
from sqrp_cli.runtime.cell.ros_cell import RosCell
from sqrp_cli.runtime.cell.ros_checks import CellCheck, check_cell
from sqrp_cli.runtime.perception.detections import CellModel, DetectionTargets
from sqrp_cli.runtime.perception.detector_pool import DetectorPool
from sqrp_cli.runtime.perception.received_streams import ReceivedStreams
from sqrp_cli.runtime.record.report import RunReport
from sqrp_cli.runtime.robot_body import RobotBody
from sqrp_cli.runtime.run.ground_truth import PlannedTruth
from sqrp_cli.runtime.run.injected_fault import InjectedFault
from sqrp_cli.runtime.run.program_run import Recording, Run, Workcell


@dataclass(frozen=True, eq=False)
class ConnectedRobot:
    """A program, and the cell in which it is to run."""

    program: Program
    workspace: Workspace
    cell: RosCell
    speed: float

    def check(self) -> list[CellCheck]:
        """Compare the cell with the workspace and the program; nothing is commanded."""
        return check_cell(self.cell, self.program.steps[0].before.joints)

    def run(self, replanner: Replanner, recording: Recording, *, moves: bool) -> RunReport:
        """Run the program; without moving, only look at its start. Raises InputError where images cannot be read.

        replanner: plans retries at full speed.
        """
        replanner = replanner if self.speed == 1.0 else SlowedReplanner(replanner, self.speed)
        body = RobotBody.load(self.workspace.robot)
        with DetectorPool(CellModel.of(self.workspace, body)) as detectors:
            streams = ReceivedStreams(self.workspace.cameras, detectors, lambda: self.cell.t)
            workcell = Workcell(self.workspace, body, self.cell, streams, PlannedTruth(), _nothing)
            run = Run(self.program, workcell, replanner, (), recording)
            detectors.watch(DetectionTargets({}, {}, {}))
            detectors.get_ready()
            self.cell.begin()
            return run.run() if moves else run.look()


def _nothing(fault: InjectedFault) -> None:
    raise AssertionError(f"nobody can make {fault.text} happen to a real cell")


@contextmanager
def connected(program: Program, workspace: Workspace, file: RobotFile, speed: float) -> Iterator[ConnectedRobot]:
    """The cell of a file; left, its robot stands and the connection ends. speed: of the program, as a share.

    Raises InputError without a connection.
    """
    transport = connect(file.transport, domain=file.domain, network=file.network, master=file.master)
    with RosCell(file, file.joint_names(program), workspace, transport) as cell:
        yield ConnectedRobot(slowed(program, speed), workspace, cell, speed)
