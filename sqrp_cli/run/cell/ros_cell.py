"""A cell that is reached by messages of ROS: a real one, or a simulated one in another process."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from functools import partialmethod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.geometry import Array
from sqrp_cli.ros.dds import DdsTransport
from sqrp_cli.ros.messages import MessageError, Pauses, Send, Topic, nanoseconds
from sqrp_cli.run.arm_motion import ArmMotion, JointStates
from sqrp_cli.run.cell.portions import AHEAD, JointLog, Portions
from sqrp_cli.run.cell.robot_file import RobotFile
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.record.packed_image import image_of
from sqrp_cli.run.record.report import Stopped

if TYPE_CHECKING:
    from sqrp_cli.run.cell.simulated_cell import CellState

TICK = 0.004  # Longest wait for a message [s]
JOINTS_OVERDUE = 0.12  # How old the newest joint states may get [s]
PAUSE, SETTLE = 0.1, 0.05
"""After a pause of our own this long [s], `/clock` is believed so much later [s]: what was sent has to be received."""
STILL, MOVED = 0.1, 0.01
"""Joint states are frozen if they stay the same for this long [s] while the arm is wanted to move so far [rad]."""
CLOCK_STOPS = 2.0  # Without a message on `/clock` for this long [s], time stands still
FLOOD_FACTOR, FLOOD_WINDOW, MOST_JOINT_STATES = 20.0, 0.5, 5000.0
"""A flood: so many times more images than a camera takes, or so many joint states a second, over a window [s]."""
LONGEST_JUMP = 300.0
"""A `/clock` that goes on by so much more than the time of this computer [s] has jumped, even where the arm stands."""
_NO_TIME = "`/clock` stands still"
CLOCK = Topic(name="/clock", type="rosgraph_msgs/msg/Clock", depth=1)
_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


class RosClock:
    """The time of a cell: that of this computer, or of `/clock`."""

    def __init__(self, transport: DdsTransport, *, simulated: bool) -> None:
        self.inbox = transport.subscribe(CLOCK) if simulated else None
        """What comes on `/clock`, where that is the time."""
        self._newest = 0
        self._ahead = time.time_ns() - _steady_ns()
        self._heard = self._looked = self._settles = time.monotonic()
        self.origin = 0
        """What counts as time 0 [ns]."""
        self.is_settled, self.stands_still = True, False
        """Whether what was read last is the time now, also after a pause of our own; and whether `/clock` has nothing
        new to say any more."""

    def read(self) -> None:
        """Take note of what has come. Raises MessageError for what is no time."""
        looked, self._looked = self._looked, time.monotonic()
        if self._looked - looked > PAUSE:
            self._heard, self._settles = self._looked, self._looked + SETTLE
        self.is_settled = self.inbox is None or self._looked >= self._settles
        try:
            for message, t in self.inbox.take() if self.inbox is not None else ():
                if (newest := nanoseconds(message.clock)) > self._newest:
                    self._newest, self._heard = newest, max(self._heard, t)
        finally:
            self.stands_still = self.inbox is not None and self._looked - self._heard > CLOCK_STOPS

    @property
    def ns(self) -> int:
        """The time since the epoch of the clock [ns]; 0 before any is known. That of this computer never steps."""
        return _steady_ns() + self._ahead if self.inbox is None else self._newest


def _steady_ns() -> int:
    """A time that goes on while this computer sleeps, and that nobody sets [ns]."""
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


class RosCell(AbstractContextManager["RosCell"]):
    """A cell behind topics; a context manager that leaves the robot standing."""

    def __init__(
        self, file: RobotFile, joints: Mapping[str, str], workspace: Workspace, transport: DdsTransport
    ) -> None:
        """joints: that are moved, with their names in messages."""
        self.file, self.transport, self.cameras, self.moved = file, transport, workspace.cameras, tuple(joints)
        self._wire_names, fingers = tuple(joints.values()), workspace.robot.fingers
        self._mend = f" ({file.mend_of_lateness})" if file.mend_of_lateness else ""  # at the end of a reason
        self.clock = RosClock(transport, simulated=file.use_sim_time)
        self.joints = JointLog({wire: name for name, wire in joints.items()})
        reliable = file.reliable
        states = Topic(name=file.joint_states, type="sensor_msgs/msg/JointState", depth=500, reliable=reliable)
        self.states = transport.subscribe(states)
        self.images = {
            name: transport.subscribe(Topic(name=one.image, type=one.type, depth=4, reliable=reliable))
            for name, one in file.cameras.items()
        }
        self._force, self._newton = None, 0.0
        if file.force is not None:
            self._force = transport.subscribe(Topic(name=file.force, type="geometry_msgs/msg/WrenchStamped"))
        self.presence = Topic(name=f"{file.trajectory.topic.rstrip('/')}/sqrp_run", type="std_msgs/msg/Bool")
        """Each run sends and reads it, never a message: so that another one knows."""
        transport.publish(self.presence)
        transport.subscribe(self.presence)
        self.commands: list[Topic] = []
        """The topics that the robot obeys."""
        self._send_tool: Send | None = None
        if file.tool is not None:
            self.commands.append(Topic(name=file.tool.topic, type=file.tool.type, depth=1, reliable=True))
            self._send_tool = transport.publish(self.commands[-1])
        self.commands.append(Topic(name=file.trajectory.topic, type=_TRAJECTORY, depth=1, reliable=True))
        self._send_trajectory = transport.publish(self.commands[-1])
        rates = {name: FLOOD_FACTOR * max(workspace.cameras[name].rate, 5.0) for name in self.images}
        self._floods = [(self.states, MOST_JOINT_STATES)]  # most messages a second
        self._floods += [(inbox, rates[name]) for name, inbox in self.images.items()]
        self._counts, self._counted = [0] * len(self._floods), time.monotonic()
        self.ages: dict[str, deque[tuple[float, float]]] = {name: deque(maxlen=100) for name in self.images}
        """When images were taken, and when they came, lately [s]."""
        self._waiting: dict[str, deque[CameraImage]] = {name: deque(maxlen=4) for name in self.images}
        self._portions = Portions(self._send, () if fingers is None else tuple(fingers.open))
        self._reference: ArmMotion | None = None
        self.malformed: Stopped | None = None
        """What is wrong with the messages themselves, or with the time that passes; the first counts."""
        self._pauses = Pauses()
        self._followed, self._followed_ns = 0.0, _steady_ns()

    @property
    def t(self) -> float:
        """The time on the cell's clock [s]."""
        return (self.clock.ns - self.clock.origin) * 1e-9

    def begin(self) -> None:
        """Count time from now on."""
        self.clock.read()
        self.clock.origin, self._followed, self._followed_ns = self.clock.ns, 0.0, _steady_ns()
        self.joints, self._pauses = JointLog(self.joints.names), Pauses()
        for waiting in self._waiting.values():
            waiting.clear()

    def advance(self, t: float, reference: ArmMotion) -> float:
        """Let time pass until t [s] while the arm follows the reference; returns the time then.

        That may be later; and sooner where no time passes any more.
        """
        self._reference = reference
        while True:
            self.read()
            if self.clock.stands_still:
                self._end(_NO_TIME)
                return self.t
            if self.clock.is_settled:
                now = self.t
                silent, paused = now - self._followed, (_steady_ns() - self._followed_ns) * 1e-9
                self._followed, self._followed_ns = now, _steady_ns()
                if self._portions.begins(reference, now):
                    wanted, limit = reference.states(np.array([now])).positions[0], self.file.tolerances.start
                    if (off := self._off(reference.joints, wanted, limit, "where the motion begins")) is not None:
                        self._end(off)
                # Send what is due; where that would be a jump, nothing more is sent, and that is trouble.
                self._portions.follow(reference, now)
                far = silent - paused > LONGEST_JUMP
                if self._portions.over or far:
                    if self.malformed is None:  # time that nobody has seen is none of the run
                        self.clock.origin += round(silent * 1e9)
                        self._followed = self.t
                    why = (
                        f"this computer was too busy to send the next part of the motion for {silent:.1f} s{self._mend}"
                    )
                    if far or (self.file.use_sim_time and silent > AHEAD and paused < PAUSE):
                        why = f"`/clock` jumped ahead by {silent:.1f} s"
                    self._end(why)
            if (now := self.t) >= t and self.clock.is_settled:
                return now
            self.transport.wait(TICK)

    def _end(self, why: str) -> None:
        """Send no motion any more."""
        self._portions.over, self.malformed = True, self.malformed or Stopped(why)

    def read(self) -> None:
        """Take in what has come. What is wrong with it is told by `trouble`."""
        try:
            self.clock.read()
            now = self.t
            self._pauses.look(now)
            for message, _ in self.states.take():
                self.joints.add((nanoseconds(message.header.stamp) - self.clock.origin) * 1e-9, message, now)
            for message, _ in self._force.take() if self._force is not None else ():
                force = message.wrench.force
                self._newton = float(np.linalg.norm([force.x, force.y, force.z]))
            for name, inbox in self.images.items():
                about, camera = self.file.cameras[name], self.cameras[name]
                for message, _ in inbox.take():
                    image = image_of(message, camera, Place(Path(about.image)), f"`{name}`")
                    if isinstance(image, str):
                        raise bad_input("unreadable", image)
                    t = (nanoseconds(message.header.stamp) - self.clock.origin) * 1e-9 - about.clock_offset
                    self._waiting[name].append(CameraImage(name, t, image))
                    self.ages[name].append((t, now))
        except MessageError as error:
            self.malformed = self.malformed or Stopped(f"a message is malformed: {error}")
        except InputError as error:
            self.malformed = self.malformed or Stopped(error.problems[0].message)
        if (passed := time.monotonic() - self._counted) >= FLOOD_WINDOW:
            for (inbox, most), count in zip(self._floods, self._counts, strict=True):
                if (rate := (inbox.count - count) / passed) > most:
                    self.malformed = self.malformed or Stopped(
                        f"a flood on `{inbox.topic.name}`: {rate:,.0f} messages a second"
                    )
            self._counts, self._counted = [inbox.count for inbox, _ in self._floods], time.monotonic()

    def grasp(self, *, holding: bool = True) -> None:
        """Have the tool hold what is there, or let go; not where there is trouble: the robot may be elsewhere."""
        tool = self.file.tool
        if tool is not None and self._send_tool is not None and self.trouble() is None:
            value = tool.hold if holding else tool.release
            data = np.array(value, dtype=float) if isinstance(value, list) else value
            self._send_tool(self.transport.types.make(tool.type, data=data))

    release = partialmethod(grasp, holding=False)
    """Have the tool let go, unless there is trouble."""

    def tool_force(self) -> float:
        """How hard the tool pushes against anything, by the last message of the force sensor [N]."""
        return self._newton

    def frames(self, cameras: Sequence[str]) -> Mapping[str, CameraImage]:
        """The oldest image that has come of each of some cameras and was not given before; it may be missing."""
        return {name: self._waiting[name].popleft() for name in cameras if self._waiting[name]}

    def measured_joints(self, t: float | None = None) -> Mapping[str, float]:
        """Position of every movable joint by its encoder [rad or m], at a time [s] or now."""
        return self.joints.at(t)

    def trouble(self) -> Stopped | None:
        """Why nobody may go on: malformed messages, floods, joint states that stay out, are old, or do not follow."""
        if self.malformed is not None or self.clock.stands_still:
            return self.malformed or Stopped(_NO_TIME)
        topic, reference, waited = f"on `{self.file.joint_states}`", self._reference, self._pauses.waited
        if (silent := waited(self.joints.came)) > JOINTS_OVERDUE:
            return Stopped(f"the joint states are lost: none {topic} for {silent:.2f} s")
        if (old := waited(self.joints.newest)) > JOINTS_OVERDUE:
            return Stopped(f"the joint states {topic} come too late: the newest are {old:.2f} s old{self._mend}")
        if reference is None:
            return None
        then, changed = self.joints.newest, self.joints.changed
        wanted, before = reference.states(np.array([then, changed])).positions
        if then - changed > STILL and float(np.abs(wanted - before).max()) > MOVED:
            return Stopped(f"the joint states {topic} are frozen: the same for {then - changed:.2f} s of motion")
        off = self._off(reference.joints, wanted, self.file.tolerances.tracking, "where it should be")
        return None if off is None else Stopped(off)

    def _off(self, joints: Sequence[str], wanted: Array, limit: float, where: str) -> str | None:
        """The joint that by the newest joint states is further from where it is wanted than a limit [rad]."""
        found = self.joints.at()
        for name, q in zip(joints, wanted.tolist(), strict=True):
            if name in found and name in self.moved and abs(found[name] - q) > limit:
                off = np.degrees(abs(found[name] - q))
                return f"`{name}` is {off:.1f} deg from {where}, more than {np.degrees(limit):.1f}"
        return None

    def truth(self) -> CellState | None:
        """None: nobody knows the ground truth, nor measures where the tool is."""
        return None

    def _send(self, times: Array, states: JointStates) -> None:
        types = self.transport.types
        assert self._reference is not None  # noqa: S101 - a portion is of a reference
        columns = [list(self._reference.joints).index(name) for name in self.moved]
        points = [
            types.make(
                "trajectory_msgs/msg/JointTrajectoryPoint",
                positions=states.positions[row, columns],
                velocities=states.velocities[row, columns],
                accelerations=states.accelerations[row, columns],
                time_from_start=types.time(round(t * 1e9)),
            )
            for row, t in enumerate(times.tolist())
        ]
        self._send_trajectory(types.make(_TRAJECTORY, joint_names=list(self._wire_names), points=points))

    def __exit__(self, *_: object) -> None:
        """Have the robot stand, and wait until it does; then end the connection."""
        stands, patience = None, time.monotonic() + 2.0
        try:
            while stands is None or (self.t < stands and time.monotonic() < patience):
                with suppress(MessageError):  # know the time now, also after a pause of our own
                    self.clock.read()
                    while not self.clock.is_settled:
                        self.transport.wait(TICK)
                        self.clock.read()
                if stands is None:
                    stands = self._portions.stop(self.t)
                else:
                    self.transport.wait(TICK)
        finally:
            self.transport.close()
