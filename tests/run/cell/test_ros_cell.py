"""A cell behind topics: what comes is taken in, what is wrong is told, and the robot is left standing."""

from __future__ import annotations

import itertools
import re
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags")

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import pose
from sqrp_cli.ros.messages import Inbox, Message, MessageError, Topic, message_types, nanoseconds, transform_message
from sqrp_cli.run.cell import ros_cell, ros_checks
from sqrp_cli.run.cell.robot_file import RobotFile, read_robot_file
from sqrp_cli.run.cell.ros_cell import CLOCK, RosCell
from sqrp_cli.run.cell.ros_checks import check_cell
from tests.run.test_arm_motion import Q0, playback

NS = 1_000_000_000
START = 1_700_000_000 * NS
K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
CAMERA = SimpleNamespace(
    name="cam", width=8, height=6, rate=10.0, latency=0.05, lag=0.05, matrix=K, distortion=(), frame="world",
    X_FC=np.eye(4),
)  # fmt: skip
WORKSPACE = SimpleNamespace(cameras={"cam": CAMERA}, robot=SimpleNamespace(fingers=None))
FILE = {
    "use_sim_time": True, "reliable": True, "trajectory": {"topic": "/arm/joint_trajectory"},
    "joint_states": "/joint_states", "cameras": {"cam": {"image": "/cam/image", "info": "/cam/info"}},
    "tool": {"topic": "/suction"},
}  # fmt: skip


@pytest.fixture(autouse=True)
def _unpaused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clocks of these cells pass as fast as they are waited for: there is no time to settle."""
    monkeypatch.setattr(ros_cell, "SETTLE", 0.0)


class Wire:
    """Topics within one process, with a clock that passes while the cell waits."""

    def __init__(self, ros: int = 2) -> None:
        self.types = message_types(ros)
        self.inboxes: dict[str, Inbox] = {}
        self.sent: list[tuple[str, Message]] = []
        self.t, self.closed, self.each = 0.0, False, lambda: None
        self.kinds: dict[str, set[str]] = {"/joint_states": {"sensor_msgs/msg/JointState"}}
        self.runs = 1

    def publish(self, topic: Topic):
        return lambda message: self.sent.append((topic.name, message))

    def subscribe(self, topic: Topic) -> Inbox:
        return self.inboxes.setdefault(topic.name, Inbox(topic, self.types, lambda: None))

    def readers(self, topic: Topic) -> int:
        return self.runs if topic.name.endswith("/sqrp_run") else 1

    def senders(self) -> dict[str, set[str]]:
        return self.kinds

    def wait(self, _seconds: float) -> None:
        self.tick()

    def close(self) -> None:
        self.closed = True

    def say(self, topic: str, kind: str, **fields: Message) -> None:
        self.inboxes[topic].put(self.types.encode(self.types.make(kind, **fields)))

    def tick(self) -> None:
        self.t = round(self.t + 0.004, 6)
        self.say("/clock", CLOCK.type, clock=self.types.time(START + round(self.t * NS)))
        self.each()

    def joints(self, q: np.ndarray, late: float = 0.0) -> None:
        header = self.types.header(START + round((self.t - late) * NS))
        self.say("/joint_states", "sensor_msgs/msg/JointState", header=header, name=["a", "b"], position=np.array(q))

    def image(self, late: float = 0.05, **fields: Message) -> None:
        header = self.types.header(START + round((self.t - late) * NS), "cam_optical")
        data = np.zeros(8 * 6 * 3, np.uint8)
        whole = {"height": 6, "width": 8, "step": 24, "encoding": "rgb8", "data": data, **fields}
        self.say("/cam/image", "sensor_msgs/msg/Image", header=header, **whole)


def cell(wire: Wire, **more: object) -> RosCell:
    file = RobotFile.model_validate({**FILE, **more})
    found = RosCell(file, {"a": "a", "b": "b"}, WORKSPACE, wire)
    if file.use_sim_time:
        wire.tick()
    found.begin()
    wire.t0 = wire.t
    return found


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def robot(wire: Wire) -> RosCell:
    return cell(wire)


def follow(wire: Wire, robot: RosCell, until: float, states=None) -> None:
    """A motion that begins at 1 s, followed by joint states as they should be unless `states` gives others."""
    motion, now = playback(), 0.0
    states = states or (lambda t, _: wire.joints(motion.state(t - 0.01)[0]))
    wire.each = lambda: states(wire.t - wire.t0, motion.state(wire.t - wire.t0)[0])
    wire.each()
    while now < until and robot.trouble() is None:
        now = robot.advance(now + 0.02, motion)


def test_a_motion_is_sent_in_portions_and_ctrl_c_leaves_the_robot_braking(wire: Wire, robot: RosCell) -> None:
    follow(wire, robot, 2.0)
    assert robot.trouble() is None
    sent = [message for name, message in wire.sent if name == "/arm/joint_trajectory"]
    with pytest.raises(KeyboardInterrupt), robot:
        raise KeyboardInterrupt
    last = wire.sent[-1][1]
    assert wire.closed
    assert len(wire.sent) == len(sent) + 1
    for message in (*sent[1:], last):  # every one of them ends in standing, in less than a second
        assert not message.points[-1].velocities.any()
        assert nanoseconds(message.points[-1].time_from_start) < NS
    assert nanoseconds(last.points[-1].time_from_start) < 0.4 * NS
    assert wire.t - wire.t0 > 2.0  # until it stands


def test_the_tool_is_told_what_the_file_says(wire: Wire) -> None:
    tool = {"topic": "/gripper", "type": "std_msgs/msg/Float64MultiArray", "hold": [0.0], "release": [0.04]}
    robot = cell(wire, tool=tool)
    robot.grasp()
    robot.release()
    assert [(name, list(message.data)) for name, message in wire.sent] == [("/gripper", [0.0]), ("/gripper", [0.04])]


@pytest.mark.parametrize(
    ("states", "reason"),
    [
        (lambda wire: lambda t, q: wire.joints(q) if t < 1.5 else None, "joint states are lost: none on"),
        (lambda wire: lambda t, q: wire.joints(q, 0.0 if t < 1.5 else 0.3), "come too late: the newest are 0."),
        (lambda wire: lambda t, q: wire.joints(q if t < 1.5 else np.ones(2)), "`a` is .* deg from where it should be"),
        (lambda wire: lambda t, q: wire.joints(q if t < 1.5 else Q0 + 0.001), "frozen: the same for"),
    ],
)
def test_joint_states_that_stay_out_are_old_or_do_not_follow_are_told_within_a_fifth_of_a_second(
    wire: Wire, states, reason
) -> None:
    robot = cell(wire, tolerances={"tracking": "40 deg"} if "frozen" in reason else {})
    follow(wire, robot, 3.0, states(wire))
    assert re.search(reason, str(robot.trouble()))
    assert 1.5 <= robot.t <= 1.5 + 0.21


@pytest.mark.parametrize("how", ["read before time counts", "pauses again and again"])
def test_no_loss_of_joint_states_is_hidden(wire: Wire, how: str) -> None:
    robot, late = RosCell(RobotFile.model_validate(FILE), {"a": "a", "b": "b"}, WORKSPACE, wire), 0.21
    wire.tick()
    if how == "read before time counts":
        robot.read()  # as the checks before a run do, while the clock still shows the time of day
    else:
        wire.wait, late = lambda _seconds: [wire.tick() for _ in range(15)], 0.31  # 60 ms pass between two looks
    robot.begin()
    wire.t0 = wire.t
    follow(wire, robot, 3.0, lambda t, q: wire.joints(q) if t < 1.5 else None)
    assert "joint states are lost" in str(robot.trouble())
    assert robot.t <= 1.5 + late


@pytest.mark.parametrize("pause", [0.1, 0.2, 0.3])
def test_a_pause_of_our_own_is_no_loss_of_joint_states(wire: Wire, robot: RosCell, pause: float) -> None:
    follow(wire, robot, 1.5)
    wire.t += pause  # nothing of it is received yet
    robot.read()
    assert robot.trouble() is None
    follow(wire, robot, 1.5 + pause + 0.1)
    assert robot.trouble() is None


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda wire: wire.inboxes["/joint_states"].put(b"\0\1\0\0rubbish"), "11 bytes that are no sensor_msgs"),
        (lambda wire: wire.joints(np.array([np.nan, 0.0])), "positions of joints that are no numbers"),
        (lambda wire: wire.joints(np.zeros(3)), "2 names of joints with 3 positions"),
        (lambda wire: wire.image(height=5), "is 8x5, the workspace says 8x6"),
        (lambda wire: wire.image(data=np.zeros(50, np.uint8)), "fewer bytes than its 8x6 pixels need"),
        (lambda wire: wire.image(encoding="16UC1"), "has the encoding `16UC1`"),
    ],
)
def test_what_is_no_message_or_no_image_stops_the_robot(wire: Wire, robot: RosCell, spoil, reason) -> None:
    wire.joints(Q0)
    spoil(wire)
    robot.read()
    assert reason in str(robot.trouble())


def test_a_flood_is_told_and_keeps_little(wire: Wire, robot: RosCell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_cell, "FLOOD_WINDOW", 0.02)
    end = time.monotonic() + 0.05
    while time.monotonic() < end:
        wire.image()
    robot.read()
    assert "a flood on `/cam/image`" in str(robot.trouble())
    assert len(robot._waiting["cam"]) <= 4


@pytest.mark.parametrize("says_the_same", [False, True])
def test_a_clock_that_stands_still_ends_the_wait(
    wire: Wire, robot: RosCell, monkeypatch: pytest.MonkeyPatch, says_the_same: bool
) -> None:
    monkeypatch.setattr(ros_cell, "CLOCK_STOPS", 0.03)
    same = lambda _seconds: wire.say("/clock", CLOCK.type, clock=wire.types.time(START))  # noqa: E731
    wire.wait = same if says_the_same else time.sleep
    assert robot.advance(5.0, playback()) < 1.0
    assert "stands still" in str(robot.trouble())


def checked(
    wire: Wire, robot: RosCell, q=Q0, info: dict | None = None, late: float = 0.05, since: float = 0.0, images=np.inf
) -> list[str]:
    """What the checks find, with a camera whose `CameraInfo` differs as said; it and TF come from a time [s] on.

    images: as many come.
    """
    left = itertools.count() if images == np.inf else iter(range(int(images)))
    fields = {"width": 8, "height": 6, "k": K.reshape(-1), **(info or {})}

    def each() -> None:
        wire.joints(q)
        if round(wire.t / 0.004) % 25 == 0:
            if next(left, None) is not None:
                wire.image(late)
            if wire.t < since:
                return
            header = wire.types.header(0, "cam_optical")
            wire.say("/cam/info", "sensor_msgs/msg/CameraInfo", header=header, **fields)
            transform = transform_message(wire.types, 0, "world", "cam_optical", pose(position=(wire.moved, 0.0, 0.0)))
            wire.say("/tf_static", "tf2_msgs/msg/TFMessage", transforms=[transform])

    wire.each, wire.moved = each, getattr(wire, "moved", 0.0)
    start = dict(zip("ab", Q0.tolist(), strict=True))
    return [one.problem for one in check_cell(robot, start) if one.problem is not None]


@pytest.mark.parametrize(
    ("differs", "problem"),
    [
        ({}, None),
        ({"q": Q0 + np.radians([0.0, 1.0])}, "`b` is 1.00 deg from where the program starts; 0.50 deg are allowed"),
        ({"info": {"width": 640, "height": 480}}, "`cam` has images of 640x480 pixels, the workspace says 8x6"),
        ({"info": {"k": (K * [[1.02], [1], [1]]).reshape(-1)}}, "`cam`: fx of its CameraInfo is 306.0 px, the"),
        ({"late": 0.35}, "350 ms old when they come, the workspace says 50 ms; their clock is 300 ms behind"),
        ({"late": -0.2}, "their clock is 250 ms ahead"),
        ({"late": 1.7e9}, "`use_sim_time: true`"),
    ],
)  # fmt: skip
def test_what_differs_is_named_with_its_figure(wire: Wire, robot: RosCell, differs: dict, problem: str | None) -> None:
    found = checked(wire, robot, **differs)
    assert len(found) == (problem is not None)
    assert problem is None or problem in found[0]


@pytest.mark.parametrize(
    ("known", "more", "problem"),
    [
        ({"moved": 0.02}, {"since": since}, "TF has `cam` 20.0 mm and 0.00 deg from where the workspace has it")
        for since in (0.0, 4.0)
    ] + [({"runs": 2}, {}, "another `sqrp run` is connected to this robot, or was killed within the last 10 s"),
         ({}, {"images": 3}, "`cam` hardly sends images")],
)  # fmt: skip
def test_a_camera_elsewhere_another_run_and_a_camera_that_stops_are_named(
    wire: Wire, monkeypatch: pytest.MonkeyPatch, known: dict, more: dict, problem: str
) -> None:
    if "images" in more:
        monkeypatch.setattr(ros_checks, "PATIENCE", 0.3)
        monkeypatch.setattr(ros_cell, "MOST_JOINT_STATES", np.inf)  # time is that of the test, and passes quickly
    wire.kinds = {"/tf_static": {"tf2_msgs/msg/TFMessage"}} if "moved" in known else wire.kinds
    vars(wire).update(known)
    assert checked(wire, cell(wire), **more) == [problem]


@pytest.mark.parametrize(
    ("senders", "said"),
    [
        ({"": "CompressedImage"}, "`/cam/image` carries sensor_msgs/msg/CompressedImage, not sensor_msgs/msg/Image"),
        ({"_raw": "Image", "_info": "CameraInfo"}, "nobody sends on `/cam/image`; did you mean `/cam/image_raw`?"),
        ({"": "Image"}, "nothing comes on `/cam/image`; its sender may not be reliable: set `reliable: false`"),
        ({"2/other": "Imu"}, "nothing comes on `/cam/image`"),
        ({}, "nobody sends anything in domain 7 on lo"),
    ],
)
def test_why_nothing_comes_on_a_topic_is_said(
    wire: Wire, monkeypatch: pytest.MonkeyPatch, senders: dict[str, str], said: str
) -> None:
    """senders: kind of message, by how a topic goes on after `/cam/image`."""
    monkeypatch.setattr(ros_checks, "PATIENCE", 0.1)
    robot = cell(wire, domain=7, network="lo")
    wire.kinds = {f"/cam/image{name}": {f"sensor_msgs/msg/{kind}"} for name, kind in senders.items()}
    wire.each = (lambda: wire.joints(Q0)) if senders else lambda: None
    found = [one.problem for one in check_cell(robot, {"a": 0.0, "b": 0.5}) if one.problem]
    assert said in found
    assert senders or len(found) == 1


def test_a_robot_that_was_moved_since_it_was_checked_is_not_moved(wire: Wire, robot: RosCell) -> None:
    follow(wire, robot, 2.0, lambda _now, _q: wire.joints(Q0 + np.radians([1.0, 0.0])))
    assert str(robot.trouble()) == "`a` is 1.0 deg from where the motion begins, more than 0.5"
    assert "/arm/joint_trajectory" not in [name for name, _ in wire.sent]


@pytest.fixture
def inbox() -> Inbox:
    return Inbox(Topic(name="/clock", type=CLOCK.type), message_types(2), lambda: None)


def test_who_is_flooded_takes_no_more_than_waits(inbox: Inbox) -> None:
    data = inbox._types.encode(inbox._types.make(CLOCK.type))
    inbox._types = SimpleNamespace(decode=lambda *_: inbox.put(data))  # another comes while one is read
    inbox.put(data)
    assert len(inbox.take()) == 1


def test_a_malformed_message_takes_none_after_it_along(inbox: Inbox) -> None:
    types = inbox._types
    for number in range(5):
        inbox.put(b"\0\1" if number == 2 else types.encode(types.make(CLOCK.type, clock=types.time(number * NS))))
    with pytest.raises(MessageError, match="2 bytes that are no rosgraph_msgs/msg/Clock"):
        inbox.take()
    assert [message.clock.sec for message, _ in inbox.take()] == [3, 4]
    assert inbox.take() == []


TOPICS = "trajectory: {topic: /a}\ncameras:\n  cam: {image: '%s'}\n"
WRONG = "trajectory: {topic: /a}\njoints: {a: e, elbwo: e}\ncameras:\n  cma: {image: /i}\njoint_states: /joint_states\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *((f"{key}\nsteps: []\ncameras: {{}}\n", {f"this is {what}, expected a file that says how to reach a r": None})
          for key, what in (("sqrp_program: 1", "a program"), ("skills: [pickup]", "a workspace"))),
        *((TOPICS % name, {f"`cameras.cam.image`: found `{name}`, expected a topic such as": 3})
          for name in ("/cam 1/image", "cam-1/image", "/", "/cam//image", "/1/image", "/cam1/image/")),
        (WRONG, {"no camera `cma`": 4, "lacks `cam`": 3, "no joint `elbwo`": 2, "2 joints are called `e`": 2,
                 "lacks `elbow`, which the program moves": 2, "has no `tool`": None}),
    ],
)  # fmt: skip
def test_a_file_that_does_not_fit_says_everything_that_is_wrong(
    tmp_path: Path, text: str, said: dict[str, int | None]
) -> None:
    """said: parts of messages, with their lines."""
    (tmp_path / "robot.yaml").write_text(text)
    step = SimpleNamespace(primitives=(SimpleNamespace(action="Grasp", guard=None),))
    with pytest.raises(InputError) as caught:
        read_robot_file(tmp_path / "robot.yaml", WORKSPACE, SimpleNamespace(joints=("a", "elbow"), steps=(step,)))
    found = {problem.message: problem.place.line for problem in caught.value.problems}
    for part, line in said.items():
        assert [found[message] for message in found if part in message] == [line]


def test_only_a_simulated_cell_may_be_slower() -> None:
    assert f" ({RobotFile.model_validate({**FILE, 'use_sim_time': True}).mend_of_lateness})" == SLOWER
    assert not RobotFile.model_validate({**FILE, "use_sim_time": False}).mend_of_lateness


def test_without_a_simulated_clock_time_is_that_of_this_computer(wire: Wire) -> None:
    wire.wait = time.sleep
    robot = cell(wire, use_sim_time=False)
    began, motion = time.monotonic(), playback()
    assert robot.advance(0.1, motion) == pytest.approx(time.monotonic() - began, abs=0.03)
    stamp = wire.types.header(time.time_ns())
    wire.say("/joint_states", "sensor_msgs/msg/JointState", header=stamp, name=["a", "b"], position=Q0)
    robot.read()
    assert robot.joints.newest == pytest.approx(robot.t, abs=0.03)
    assert robot.trouble() is None


SLOWER = " (if computers are busy, let the simulated time pass more slowly, as with `sqrp cell --pace 0.1`)"


@pytest.mark.parametrize(
    ("least", "pause", "reason"),
    [
        (0.1, 0.5, f"this computer was too busy to send the next part of the motion for 0.5 s{SLOWER}"),
        (0.1, 1.3, f"this computer was too busy to send the next part of the motion for 1.3 s{SLOWER}"),
        (99.0, 1.3, "`/clock` jumped ahead by 1.3 s"),
        (99.0, 1.5, None),  # for Ctrl-C
    ],
)
def test_after_a_pause_nothing_that_moves_is_sent(
    wire: Wire, robot: RosCell, monkeypatch: pytest.MonkeyPatch, least: float, pause: float, reason: str | None
) -> None:
    monkeypatch.setattr(ros_cell, "PAUSE", least)
    follow(wire, robot, 1.8)
    motion, before = playback(), len(wire.sent)
    wire.t += pause  # the cell goes on, we do not
    time.sleep(0.11)
    wire.tick()
    if reason is not None:
        now = robot.advance(1.82, motion)
        assert str(robot.trouble()) == reason
        robot.release()
        motion.stop(now, protective=True)
        robot.advance(now + 0.3, motion)
    robot.__exit__()
    assert len(wire.sent) == before


def test_what_clock_says_right_after_a_pause_is_not_believed(
    wire: Wire, robot: RosCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    follow(wire, robot, 1.8)
    before = len(wire.sent)
    monkeypatch.setattr(ros_cell, "SETTLE", 0.05)
    steps, passed = iter([0.1, 0.1, 1.1]), [time.monotonic() + 0.11]  # one message after another, late
    boot = ros_cell._steady_ns() - time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic", lambda: passed[0])
    monkeypatch.setattr(ros_cell, "_steady_ns", lambda: boot + int(passed[0] * NS))

    def wait(_seconds: float) -> None:
        passed[0] += 0.02
        wire.t += next(steps, 0.0)
        wire.tick()

    wire.wait = wait
    wire.tick()
    robot.advance(1.9, playback())
    assert "too busy to send" in str(robot.trouble())
    assert len(wire.sent) == before


def test_a_pause_of_our_own_is_no_clock_that_stands_still(robot: RosCell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_cell, "SETTLE", 0.05)
    monkeypatch.setattr(ros_cell, "CLOCK_STOPS", 0.05)
    time.sleep(0.11)
    robot.clock.read()
    assert not robot.clock.stands_still
    assert not robot.clock.is_settled


@pytest.mark.parametrize("moves", [True, False])
def test_a_clock_that_jumps_far_takes_no_run_with_it(wire: Wire, robot: RosCell, moves: bool) -> None:
    follow(wire, robot, 1.8 if moves else 0.5)
    wire.t += 1e6
    assert robot.advance(1.82, playback()) < 3.0
    assert "`/clock` jumped ahead by 100000" in str(robot.trouble())


@pytest.mark.parametrize("step", [-4.0, 4.0])
def test_the_clock_of_this_computer_may_be_set(wire: Wire, monkeypatch: pytest.MonkeyPatch, step: float) -> None:
    wire.wait = lambda _seconds: time.sleep(0.001)
    robot = cell(wire, use_sim_time=False)
    motion, real = playback(), time.time_ns
    robot.advance(0.05, motion)
    monkeypatch.setattr(time, "time_ns", lambda: real() + int(step * NS))
    assert robot.advance(0.1, motion) < 0.3
    assert robot.malformed is None
