"""What is asked of rclpy, by a stand-in with its interface: there is no ROS 2 here to ask."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

pytest.importorskip("rosbags")

from sqrp_cli.errors import InputError
from sqrp_cli.ros.connect import connect
from sqrp_cli.ros.messages import message_types
from sqrp_cli.ros.transport import Topic

TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MODULES = (
    "rclpy", "rclpy.context", "rclpy.executors", "rclpy.qos", "rclpy.action", "rclpy.serialization", "action_msgs",
    "action_msgs.msg", "control_msgs", "control_msgs.action", "trajectory_msgs", "trajectory_msgs.msg", "sensor_msgs",
    "sensor_msgs.msg",
)  # fmt: skip


@pytest.fixture
def rclpy(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, MagicMock())
    status = SimpleNamespace(STATUS_SUCCEEDED=4, STATUS_CANCELED=5, STATUS_ABORTED=6)
    sys.modules["action_msgs.msg"].GoalStatus = status
    return sys.modules["rclpy"]


def test_messages_go_out_and_come_in_as_bytes_of_the_store(rclpy: MagicMock) -> None:
    wire, types = connect("rclpy", domain=7), message_types(2)
    assert rclpy.init.call_args.kwargs["domain_id"] == 7
    node = rclpy.create_node.return_value
    topic = Topic(name="/t", type=TRAJECTORY, reliable=True)
    message = types.make(TRAJECTORY, joint_names=["a"])
    wire.publish(topic)(message)
    node.create_publisher.return_value.publish.assert_called_once_with(types.encode(message))
    inbox = wire.subscribe(topic)
    assert node.create_subscription.call_args.kwargs == {"raw": True}
    node.create_subscription.call_args.args[2](types.encode(message))
    assert inbox.take()[0].message.joint_names == ["a"]
    wire.close()


@pytest.mark.usefixtures("rclpy")
def test_only_the_newest_goal_of_an_action_can_fail() -> None:
    client = sys.modules["rclpy.action"].ActionClient.return_value
    ends: list[str | None] = []
    send = connect("rclpy").act("/arm/follow", ends.append)
    goals = []
    for _ in range(2):
        send(message_types(2).make(TRAJECTORY))
        handle = SimpleNamespace(accepted=True, get_result_async=MagicMock())
        client.send_goal_async.return_value.add_done_callback.call_args.args[0](
            SimpleNamespace(result=lambda handle=handle: handle)
        )
        goals.append(handle.get_result_async.return_value.add_done_callback.call_args.args[0])
    failed = SimpleNamespace(status=6, result=SimpleNamespace(error_string="off the path", error_code=-4))
    for finished in goals:
        finished(SimpleNamespace(result=lambda: failed))
    assert ends == ["off the path"]


@pytest.mark.usefixtures("rclpy")
def test_an_action_that_nobody_serves_is_said() -> None:
    sys.modules["rclpy.action"].ActionClient.return_value.wait_for_server.return_value = False
    with pytest.raises(InputError, match="nobody serves the action `/arm/follow`"):
        connect("rclpy").act("/arm/follow", print)


def test_without_ros_2_it_is_said_what_needs_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(InputError) as caught:
        connect("rclpy")
    assert "transport: dds" in str(caught.value.problems[0].mend)
