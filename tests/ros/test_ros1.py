"""Topics and an action of ROS 1, with a real master and Debian's own client; skipped where they are not installed."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
if shutil.which("rosmaster") is None or not Path("/usr/lib/python3/dist-packages/actionlib").is_dir():
    pytest.skip("no ROS 1: apt install ros-core python3-rospy python3-actionlib", allow_module_level=True)

DEBIAN = "/usr/bin/python3"
"""The interpreter that Debian's packages are made for."""


@pytest.fixture(scope="module")
def environment() -> Iterator[dict[str, str]]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    found = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    plain = {key: value for key, value in found.items() if key != "PYTHONPATH"}
    core = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], env=plain, stdout=-3, stderr=-3)  # noqa: S607
    end = time.monotonic() + 20
    while socket.socket().connect_ex(("127.0.0.1", port)):
        assert time.monotonic() < end
        time.sleep(0.05)
    yield found
    core.terminate()
    core.wait()


def python(environment: dict[str, str], program: str, interpreter: str = sys.executable) -> subprocess.Popen[str]:
    """A program in a process of its own: a process connects to one master only."""
    if interpreter == DEBIAN:
        environment = {key: value for key, value in environment.items() if key != "PYTHONPATH"}
    command = [interpreter, "-c", textwrap.dedent(program)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_messages_are_those_that_rospy_itself_reads_and_writes(environment: dict[str, str]) -> None:
    ours = python(
        environment,
        """
        import time
        import numpy as np
        from sqrp_cli.ros.connect import connect
        from sqrp_cli.ros.transport import Topic
        wire = connect("ros1")
        to, back = (Topic(name=name, type="rosgraph_msgs/msg/Log", depth=50) for name in ("/to", "/back"))
        inbox, send = wire.subscribe(back), wire.publish(to)
        while not wire.readers(to) or "/back" not in wire.senders():
            time.sleep(0.01)
        for number in range(5):
            header = wire.types.header(3_000_000_007, "x")
            send(wire.types.make(to.type, header=header, msg=f"word {number}", topics=["a"]))
        end = time.monotonic() + 30
        while inbox.count < 5 and time.monotonic() < end:
            wire.wait(0.1)
        found = [one.message for one in inbox.take()]
        print([(one.msg, one.topics, one.header.stamp.nanosec) for one in found], sorted(wire.senders()["/back"]))
        """,
    )
    theirs = python(
        environment,
        """
        import rospy
        from rosgraph_msgs.msg import Log
        rospy.init_node("theirs", disable_signals=True)
        send = rospy.Publisher("/back", Log, queue_size=50)
        def back(message):
            message.msg = message.msg.upper()
            send.publish(message)
        while not send.get_num_connections():
            rospy.sleep(0.01)
        rospy.Subscriber("/to", Log, back)
        rospy.spin()
        """,
        DEBIAN,
    )
    said, _ = ours.communicate(timeout=60)
    theirs.kill()
    expected = [(f"WORD {number}", ["a"], 7) for number in range(5)]
    assert said.splitlines()[-1] == f"{expected} ['rosgraph_msgs/msg/Log']"


def test_an_action_client_of_actionlib_is_answered_and_can_cancel(environment: dict[str, str]) -> None:
    serving = python(
        environment,
        """
        import threading, time
        from sqrp_cli.ros.connect import connect
        from sqrp_cli.ros.transport import Inbox, Topic
        wire = connect("ros1")
        inbox = Inbox(Topic(name="/t", type="trajectory_msgs/msg/JointTrajectory"), wire.types, lambda: None)
        cancelled = threading.Event()
        server = wire.serve_trajectories("/arm/follow", inbox, cancelled.set)
        print("serving", flush=True)
        while not inbox.count:
            time.sleep(0.01)
        print([one.message.joint_names for one in inbox.take()], flush=True)
        server.succeed()
        cancelled.wait(60)
        print("cancelled", flush=True)
        while inbox.count < 3:
            time.sleep(0.01)
        server.refuse("no such joint")
        time.sleep(600)
        """,
    )
    assert serving.stdout is not None
    assert serving.stdout.readline() == "serving\n"
    client = python(
        {
            **environment,
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), "/usr/lib/python3/dist-packages"]),
        },
        """
        import actionlib, rospy
        import genpy.dynamic
        from sqrp_cli.ros.messages import MessageTypes
        text = MessageTypes(1).definition("control_msgs/msg/FollowJointTrajectoryAction").text
        made = genpy.dynamic.generate_dynamic("control_msgs/FollowJointTrajectoryAction", text)
        rospy.init_node("client", disable_signals=True)
        client = actionlib.SimpleActionClient("/arm/follow", made["control_msgs/FollowJointTrajectoryAction"])
        client.wait_for_server(rospy.Duration(30))
        goal = made["control_msgs/FollowJointTrajectoryGoal"]()
        goal.trajectory.joint_names = ["a", "b"]
        states = []
        client.send_goal_and_wait(goal, rospy.Duration(30))
        states.append(client.get_state())
        client.send_goal(goal)
        while client.get_state() == actionlib.GoalStatus.PENDING:
            rospy.sleep(0.01)
        client.cancel_goal()
        client.wait_for_result(rospy.Duration(30))
        states.append(client.get_state())
        client.send_goal_and_wait(goal, rospy.Duration(30))
        states.append(client.get_state())
        print(states, client.get_result().error_string)
        """,
    )
    said, _ = client.communicate(timeout=90)
    serving.kill()
    succeeded, preempted, aborted = 3, 2, 4
    assert said.splitlines()[-1] == f"{[succeeded, preempted, aborted]} no such joint"


def test_without_a_master_it_is_said_how_to_get_one(environment: dict[str, str]) -> None:
    lost = python(
        {**environment, "ROS_MASTER_URI": "http://127.0.0.1:1"},
        """
        from sqrp_cli.errors import InputError
        from sqrp_cli.ros.connect import connect
        try:
            connect("ros1")
        except InputError as error:
            print(error.problems[0].message, "|", error.problems[0].mend)
        """,
    )
    said, _ = lost.communicate(timeout=30)
    assert said.splitlines()[-1] == "no master of ROS 1 answers at http://127.0.0.1:1 | roscore"
