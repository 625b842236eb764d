"""The simulated cell on the wire: it follows trajectories, publishes joint states and images, and suffers faults."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array
from sqrp_cli.program.record import Step
from sqrp_cli.ros.dds import DdsTransport
from sqrp_cli.ros.messages import Message, MessageError, Topic, nanoseconds, transform_message
from sqrp_cli.run.arm_motion import JointStates
from sqrp_cli.run.cell.robot_file import ImageTopicEntry, RobotFile, ToolTopicEntry, TrajectoryEntry
from sqrp_cli.run.cell.ros_cell import CLOCK
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.record.bag_recorder import camera_info, optical_frame

if TYPE_CHECKING:
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell

STEP = 0.004  # How far the cell is simulated at a time [s]; its clock is published as often
JOINTS_EVERY = 2  # Joint states are published with every second step
STANDS, STILL_FOR = 0.002, 5  # An arm whose joints are all slower [rad/s] for so many steps stands
SAME_START = 0.002  # A motion that begins this close to where a step was planned to begin is that step [rad]
MOST = 1e4  # No joint goes so far [rad or m], or moves so [per s, per s^2]
_JOINT_STATE, _IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
_INFO, _TF = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
_TRAJECTORY, _BOOL = "trajectory_msgs/msg/JointTrajectory", "std_msgs/msg/Bool"
_WRENCH = "geometry_msgs/msg/WrenchStamped"


def served_file(workspace: Workspace, joints: Sequence[str], domain: int, network: str) -> RobotFile:
    """How `run --robot` reaches a cell that is served."""
    fingers = workspace.robot.fingers
    return RobotFile(
        domain=domain,
        network=network,
        trajectory=TrajectoryEntry(topic="/joint_trajectory_controller/joint_trajectory"),
        reliable=True,
        use_sim_time=True,
        joints={name: name for name in joints if fingers is None or name not in fingers.open},
        cameras={
            name: ImageTopicEntry(image=f"/{name}/image_raw", info=f"/{name}/camera_info") for name in workspace.cameras
        },
        tool=ToolTopicEntry(topic="/tool"),
        force="/wrench",
    )


class CellServer:
    """A simulated cell whose time passes as fast as that of the world, or slower where the computer is too slow."""

    def __init__(
        self,
        cell: SimulatedCell,
        workspace: Workspace,
        file: RobotFile,
        transport: DdsTransport,
        faults: Faults,
        tell: Callable[[str], None],
    ) -> None:
        """file: what is published where. faults: that are to happen. tell: says what happens."""
        self._cell, self._file, self._transport, self._tell = cell, file, transport, tell
        self._workspace, self._faults, self._types = workspace, faults, transport.types
        self._force, joints = file.force or "/wrench", file.joints or {}
        at = cell.measured_joints()
        fixed = {} if workspace.robot.fingers is None else dict(workspace.robot.fingers.open)
        self.reference = FollowedTrajectory({wire: name for name, wire in joints.items()}, at, fixed)
        self._origin = time.time_ns()
        tell(f"time 0 is {self._origin * 1e-9:.6f} s of `/clock`")
        self._steps, self.t, self._stamp = 0, 0.0, self._origin
        """Steps, and time [s] of the simulation; the same time on the clock that is published [ns]."""
        self._exposures = dict.fromkeys(workspace.cameras, 0)
        self._later: list[tuple[float, int, str, Message]] = []  # messages on their way, by the time of sending
        self._numbers = count()
        self._last: dict[str, ImageArray] = {}
        self._frozen: Mapping[str, float] | None = None
        self._q = np.array([at[name] for name in joints])
        self._stood, self._still = True, STILL_FOR
        self._complaint, self._complained = "", 0.0

        assert file.tool is not None  # noqa: S101 - as `served_file` makes it
        topics = [(CLOCK.name, CLOCK.type, 10), (file.joint_states, _JOINT_STATE, 50), (self._force, _WRENCH, 10)]
        for one in file.cameras.values():
            topics += [(one.image or "", _IMAGE, 4), (one.info or "", _INFO, 4)]
        self._send = {
            name: transport.publish(Topic(name=name, type=kind, depth=depth, reliable=True))
            for name, kind, depth in topics
        }
        self._tool = transport.subscribe(Topic(name=file.tool.topic, type=_BOOL, reliable=True))
        self._trajectories = transport.subscribe(Topic(name=file.trajectory.topic, type=_TRAJECTORY, reliable=True))
        transforms = [
            transform_message(self._types, self._origin, camera.frame, optical_frame(name), camera.X_FC)
            for name, camera in workspace.cameras.items()
        ]
        tell_frames = transport.publish(Topic(name="/tf_static", type=_TF, depth=1, reliable=True, latched=True))
        tell_frames(self._types.make(_TF, transforms=transforms))

    def serve(self, until: Callable[[], bool], factor: float = 1.0) -> None:
        """Let time pass until something is so; factor: at most so fast as that of the world."""
        began, start = time.monotonic(), self.t
        while not until():
            self.step()
            ahead = (self.t - start) / factor - (time.monotonic() - began)
            if ahead > 0:
                time.sleep(ahead)
            elif ahead < -0.1:  # too slow: time lost is not made good
                began, start = time.monotonic(), self.t

    def step(self) -> None:
        """Let a little time pass."""
        try:
            for message, _ in self._trajectories.take():
                self.follow(message)
            for message, _ in self._tool.take():
                (self._cell.grasp if message.data else self._cell.release)()
                self._tell(f"{self.t:.2f} s: the tool {'holds' if message.data else 'lets go'}")
        except MessageError as error:
            self._complain(f"a message is malformed: {error}")
        for fault in self._faults.due(self.t):
            self._tell(f"{self.t:.3f} s: {fault.text} is made to happen")
            match fault.kind:
                case "slip":
                    self._cell.slip()
                case "miss-pick":
                    self._cell.misses_next_grasp = True
                case "joints-frozen":
                    self._frozen = self._cell.measured_joints()
        self._steps += 1
        self.t = self._steps * STEP
        self._stamp = self._origin + round(self.t * 1e9)
        self._cell.advance(self.t, self.reference)
        # Say when the arm begins to move, and when it stands.
        found = self._cell.measured_joints()
        q = np.array([found[name] for name in self._file.joints or {}])
        moves = float(np.abs(q - self._q).max(initial=0.0)) > STANDS * STEP
        self._q = q
        self._still = 0 if moves else self._still + 1
        if moves and self._stood:
            self._tell(f"{self.t:.3f} s: the arm moves")
        elif self._still == STILL_FOR:
            self._tell(f"{self.t - STILL_FOR * STEP:.3f} s: the arm stands")
        self._stood = not moves and (self._stood or self._still >= STILL_FOR)
        self._send[CLOCK.name](self._types.make(CLOCK.type, clock=self._types.time(self._stamp)))
        self._publish()

    def follow(self, message: Message) -> None:
        """Follow a trajectory from now on, unless no controller would."""
        try:
            stamp, stands = nanoseconds(message.header.stamp), self.reference.ends <= self.t
            start = None if stamp == 0 else (stamp - self._origin) * 1e-9
            if self.reference.replace(message, self.t, start) and stands:
                self._faults.motion_begins(self.t, self.reference, self._tell)
        except ValueError as error:
            self._complain(f"a trajectory is refused: {error}")

    def _complain(self, what: str) -> None:
        """Say what is wrong with a message; the same again once a second at most, however many come."""
        if what != self._complaint or self.t - self._complained >= 1.0:
            self._tell(f"{self.t:.2f} s: {what}")
            self._complaint, self._complained = what, self.t

    def _publish(self) -> None:
        """Joint states and force, images that are due, and what was on its way until now."""
        sending: list[tuple[float, str, Message]] = []  # how late each message is [s], and its topic
        header = self._types.header(self._stamp)
        if self._steps % JOINTS_EVERY == 0 and not self._faults.happened("joints-loss"):
            frozen = self._frozen if self._faults.happened("joints-frozen") else None
            found = frozen or self._cell.measured_joints()
            names = {**dict.fromkeys(found, ""), **(self._file.joints or {})}
            wire_names, position = [names[name] or name for name in found], np.array(list(found.values()))
            message = self._types.make(_JOINT_STATE, header=header, name=wire_names, position=position)
            late = max((fault.delay for fault in self._faults.happened("joints-latency")), default=0.0)
            sending.append((late, self._file.joint_states, message))
            wrench = {"force": {"z": self._cell.tool_force()}}
            sending.append((0.0, self._force, self._types.make(_WRENCH, header=header, wrench=wrench)))
        cameras = self._workspace.cameras
        due = [name for name, camera in cameras.items() if self._exposures[name] / camera.rate <= self.t + 1e-9]
        for name in due:
            self._exposures[name] += 1
        wanted = [name for name in due if not self._faults.happened("camera-loss", name)]
        for name, frame in self._cell.frames(wanted).items() if wanted else ():
            image = self._last.get(name, frame.image) if self._faults.happened("frozen", name) else frame.image
            self._last[name] = image
            late = max((fault.delay for fault in self._faults.happened("latency", name)), default=0.0)
            height, width, _ = image.shape
            message = self._types.make(
                _IMAGE,
                header=self._types.header(self._stamp, optical_frame(name)),
                height=height,
                width=width,
                encoding="rgb8",
                step=3 * width,
                data=image.reshape(-1),
            )
            topics, info = self._file.cameras[name], camera_info(self._types, cameras[name], self._stamp)
            sending += [(cameras[name].lag + late, topics.image or "", message), (0.0, topics.info or "", info)]
        for late, topic, message in sending:
            heapq.heappush(self._later, (self.t + late, next(self._numbers), topic, message))
        while self._later and self._later[0][0] <= self.t + 1e-9:
            _, _, topic, message = heapq.heappop(self._later)
            self._send[topic](message)


class FollowedTrajectory:
    """What a joint trajectory controller makes of trajectories: the reference of an arm that stands at first.

    As joint_trajectory_controller of ros2_control: a new trajectory replaces the one before at once, the way from where
    the arm is then wanted leads to its first point, and the arm holds where the last point is. Between points,
    positions alone give lines, with velocities cubics, with accelerations quintics.
    """

    def __init__(self, names: Mapping[str, str], at: Mapping[str, float], fixed: Mapping[str, float]) -> None:
        """names: of the joints, by those in messages. at: where they stand. fixed: other joints, which stay there."""
        self._names = dict(names)
        self.joints: tuple[str, ...] = (*names.values(), *fixed)
        self._fixed = np.array(list(fixed.values()), dtype=float)
        q = np.array([[at[name] for name in names.values()]])
        self._times, self.ends = np.zeros(1), 0.0
        """When the points are reached, and when the last one is [s]."""
        self._points = JointStates(q, np.zeros_like(q), np.zeros_like(q))
        self._order = 5

    def replace(self, message: Message, t: float, start: float | None) -> bool:
        """Follow another trajectory from time t [s] on; returns whether it leads away from where the arm is wanted.

        start: what its times count from [s], None: from now on. Raises ValueError for one that no controller follows.
        """
        if sorted(message.joint_names) != sorted(self._names):
            raise ValueError(f"its joints are {', '.join(message.joint_names)}; expected {', '.join(self._names)}")
        if not message.points:
            raise ValueError("it has no points")
        order = [list(message.joint_names).index(name) for name in self._names]  # from its joints to ours
        rows = []
        for kind in ("positions", "velocities", "accelerations"):
            values = [getattr(point, kind) for point in message.points]
            if any(len(one) not in ((len(order),) if kind == "positions" else (0, len(order))) for one in values):
                raise ValueError(f"its points have not one of the {kind} for each joint")
            rows.append(np.array([one[order] if len(one) else np.zeros(len(order)) for one in values]))
        if not all((np.abs(row) < MOST).all() for row in rows):
            raise ValueError("it holds values that no joint can have")
        times = np.array([nanoseconds(point.time_from_start) * 1e-9 for point in message.points])
        if (np.diff(times) <= 0).any() or times[0] < 0:
            raise ValueError("the times of its points do not rise")
        first, times = message.points[0], times + (t if start is None else start)
        leads_away = bool((np.abs(rows[0] - self._points.positions[-1]) > 1e-9).any())
        before = [values[:, : len(order)] for values in self.states(np.array([t]))]
        self._order = 1 if not len(first.velocities) else 3 if not len(first.accelerations) else 5
        self._points = JointStates(*(np.concatenate([a, b[times > t]]) for a, b in zip(before, rows, strict=True)))
        self._times = np.concatenate([[t], times[times > t]])
        self.ends = float(self._times[-1])
        return leads_away

    def states(self, t: Array) -> JointStates:
        """As `ArmReference` says."""
        last = len(self._times) - 1
        piece = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, last)
        following = np.minimum(piece + 1, last)
        span = np.maximum(self._times[following] - self._times[piece], 1e-9)[:, None]
        u = np.clip((t - self._times[piece])[:, None], 0.0, span)
        begin, end = (JointStates(*(values[i] for values in self._points)) for i in (piece, following))
        # The polynomial of the order, in shares of the piece, that has what is known of both ends.
        powers, known = np.arange(self._order + 1), range((self._order + 1) // 2)

        def terms(x: Array, k: int) -> Array:
            """The k-th derivatives of all powers of x (m,), shape (m, order + 1)."""
            factors = np.prod([powers - i for i in range(k)], axis=0)
            derived: Array = factors * x[:, None] ** np.maximum(powers - k, 0)
            return derived

        fits = np.linalg.inv(np.concatenate([terms(np.array([x]), k) for x in (0.0, 1.0) for k in known]))
        coefficients = np.tensordot(fits, [one[k] * span**k for one in (begin, end) for k in known], 1)
        found = [np.einsum("mp,pmn->mn", terms((u / span)[:, 0], k), coefficients) / span**k for k in range(3)]
        held = (piece == following)[:, None]
        still = np.zeros_like(end.positions)
        moved = [np.where(held, rest, one) for one, rest in zip(found, (end.positions, still, still), strict=True)]
        fixed = np.tile(self._fixed, (len(t), 1))
        return JointStates(*(np.hstack([a, b]) for a, b in zip(moved, (fixed, 0 * fixed, 0 * fixed), strict=True)))


class Faults:
    """The faults of a served cell. The times of each count from when the motion of its step begins."""

    def __init__(self, faults: Sequence[InjectedFault], steps: Sequence[Step], joints: Sequence[str]) -> None:
        """steps: of the program whose motions come. joints: of their trajectories."""
        self._faults, self._steps, self._joints = list(faults), steps, joints
        self._due: list[tuple[float, InjectedFault]] = []
        self._happened: list[InjectedFault] = []
        self._next = 0

    def motion_begins(self, t: float, reference: FollowedTrajectory, tell: Callable[[str], None]) -> None:
        """A motion begins at time t [s]; tells if it is that of a step.

        The first is the first step, the next ones where the arm stands where the next step was planned to begin.
        """
        if self._next >= len(self._steps):
            return
        step = self._steps[self._next]
        if self._next:
            q = dict(zip(reference.joints, reference.states(np.array([t])).positions[0].tolist(), strict=True))
            first = step.primitives[0].trajectory.positions([0.0])[0].tolist()
            planned = dict(zip(self._joints, first, strict=True))
            if any(abs(q[name] - planned[name]) >= SAME_START for name in q if name in planned):
                return
        self._next += 1
        begins = next((one.start for one in step.primitives if not one.trajectory.stands), 0.0)
        mine = [fault for fault in self._faults if fault.step == self._next]
        self._due += [(t - begins + (fault.t or 0.0), fault) for fault in mine]
        self._due.sort(key=lambda one: one[0])
        tell(f"{t:.2f} s: step {self._next} ({step.short_task}) begins")

    def due(self, t: float) -> list[InjectedFault]:
        """The faults that happen by time t [s] and were not given before."""
        found = [fault for at, fault in self._due if at <= t + 1e-9]
        self._due = [one for one in self._due if one[0] > t + 1e-9]
        self._happened += found
        return found

    def happened(self, kind: str, camera: str | None = None) -> list[InjectedFault]:
        """The faults of a kind that have happened, to a camera if it is one of cameras."""
        return [fault for fault in self._happened if fault.kind == kind and fault.camera == camera]
