"""Running a program in a cell that is reached by messages, at its speed or a share of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.files.entries import Entry
from sqrp_cli.logic.image_time import Window
from sqrp_cli.program.record import Program, Replanner, Step
from sqrp_cli.records import dataclass
from sqrp_cli.ros.dds import DdsTransport
from sqrp_cli.run.cell.robot_file import RobotFile
from sqrp_cli.run.cell.ros_cell import RosCell
from sqrp_cli.run.cell.ros_checks import CellCheck, check_cell
from sqrp_cli.run.perception.detections import CellModel, DetectionTargets
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.perception.streams import ReceivedStreams
from sqrp_cli.run.record.report import RunReport
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.run.run import Recording, Run
from sqrp_cli.trajectory import Trajectory


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
        cell, body, cameras = self.cell, RobotBody.load(self.workspace.robot), self.workspace.cameras
        with DetectorPool(CellModel.of(self.workspace, body)) as detectors:
            streams = ReceivedStreams(cameras, detectors, lambda: cell.t, cell.file.mend_of_lateness)
            run = Run(self.program, self.workspace, body, cell, streams, replanner, recording=recording)
            detectors.watch(DetectionTargets({}, {}, {}))
            detectors.get_ready()
            cell.begin()
            return run.run() if moves else run.look()


@contextmanager
def connected(program: Program, workspace: Workspace, file: RobotFile, speed: float) -> Iterator[ConnectedRobot]:
    """The cell of a file; left, its robot stands and the connection ends. speed: of the program, as a share.

    Raises InputError without a connection.
    """
    transport = DdsTransport(file.domain, file.network)
    with RosCell(file, file.joint_names(program), workspace, transport) as cell:
        yield ConnectedRobot(slowed(program, speed), workspace, cell, speed)


_INTERVAL = re.compile(r"(?<=\[)[^\[\]]*(?=\])")
"""The bounds of an interval in the text of a formula."""

_TIMES = ("time", "start", "end", "x", "shown", "seen", "usual", "refuted")
"""Fields with times that are as many times as long; how late an image is, how often one is taken, and how long a
literal may lag stay as they are."""


def slowed(program: Program, speed: float) -> Program:
    """The program at a share of its speed, in 0..1, with its predictions: the same paths, and all times longer."""
    if speed == 1.0:
        return program
    return program.model_copy(update={"steps": tuple(_slowed_step(step, 1.0 / speed) for step in program.steps)})


@dataclass(frozen=True)
class SlowedReplanner:
    """A replanner whose steps are slowed, too."""

    replanner: Replanner
    speed: float

    def replan(self, step: Step, world: World) -> Step | None:
        """As `Replanner` says."""
        planned = self.replanner.replan(step, world)
        return None if planned is None else _slowed_step(planned, 1.0 / self.speed)


def _slowed_step(step: Step, factor: float) -> Step:
    """A step `factor` times as slow. How late faults are noticed is known by its sights alone."""
    found: Step = _longer(step, "", factor)
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
        case Window():
            return replace(value, start=value.start * factor, end=value.end * factor)
        case Entry():
            fields = ((field, getattr(value, field)) for field in type(value).model_fields)
            return value.model_copy(update={field: _longer(part, field, factor) for field, part in fields})
    return value
