"""What a served cell makes of what others send: it says what is wrong, and goes on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from sqrp_cli.field.cell_server import CellServer, Faults
from sqrp_cli.ros.messages import Message
from sqrp_cli.run.cell.robot_file import RobotFile
from tests.run.cell.test_ros_cell import FILE, WORKSPACE, Wire

SLIP = SimpleNamespace(step=1, t=0.5, kind="slip")


class Served:
    """A server of an arm that stands, with one step in which something slips."""

    def __init__(self) -> None:
        self.wire, self.told = Wire(), []
        file = RobotFile.model_validate({**FILE, "joints": {"a": "a", "b": "b"}})
        cell = SimpleNamespace(measured_joints=lambda: {"a": 0.0, "b": 0.5})
        steps = (SimpleNamespace(short_task="pick", primitives=()),)
        self.faults = Faults([SLIP], steps, ("a", "b"))
        self.server = CellServer(cell, WORKSPACE, file, self.wire, self.faults, self.told.append)
        self.told.clear()

    def trajectory(self, seconds: float, *positions: list[float]) -> Message:
        """Points at equal times."""
        make, types = self.wire.types.make, self.wire.types
        points = [
            make(
                "trajectory_msgs/msg/JointTrajectoryPoint",
                positions=np.array(q),
                time_from_start=types.time(round(seconds * 1e9)),
            )
            for q in positions
        ]
        return make("trajectory_msgs/msg/JointTrajectory", joint_names=["a", "b"], points=points)


def test_a_flood_of_trajectories_that_are_refused_is_told_once() -> None:
    served = Served()
    bad = served.trajectory(1.0, [0.1, 0.5], [0.2, 0.5])
    for _ in range(50):
        served.server.follow(bad)
    assert served.told == ["0.00 s: a trajectory is refused: the times of its points do not rise"]


def test_a_trajectory_that_is_refused_begins_no_step() -> None:
    served = Served()
    served.server.follow(served.trajectory(1.0, [0.1, 0.5], [0.2, 0.5]))
    assert served.faults.due(10.0) == []
    served.server.follow(served.trajectory(1.0, [0.1, 0.5]))
    assert served.told[-1] == "0.00 s: step 1 (pick) begins"
    assert served.faults.due(0.5) == [SLIP]
