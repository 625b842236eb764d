"""Topics of ROS 2 by rclpy, where a sourced ROS 2 has it; messages are bytes of the store.

The only module that uses `rclpy`. It takes messages as bytes and gives them as bytes, so that their types come from one
place. Written by the interface of rclpy in Humble and Jazzy; it needs an installed ROS 2 to run.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from typing import Any

from sqrp_cli.errors import bad_input, needed
from sqrp_cli.ros.messages import Message, MessageTypes, message_types
from sqrp_cli.ros.transport import Inbox, Send, Topic

NODE = f"sqrp_{os.getpid()}"
"""How this process is called: what others send is not what it sends itself."""

SERVED_WITHIN = 5.0
"""How long the server of an action is waited for [s]."""


class RclpyTransport:
    """Topics of a domain of ROS 2, by whatever middleware the sourced ROS uses."""

    def __init__(self, domain: int) -> None:
        """Raises InputError where rclpy cannot be imported."""
        mend = "source /opt/ros/DISTRO/setup.bash, with the Python of that ROS; or transport: dds, which needs none"
        with needed("rclpy cannot be imported: {}", mend):
            import rclpy
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
        self.types: MessageTypes = message_types(2)
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node(NODE, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publishers: dict[str, Any] = {}
        self._heard = threading.Event()
        self._thread = threading.Thread(target=self._executor.spin, name="rclpy", daemon=True)
        self._thread.start()

    def publish(self, topic: Topic) -> Send:
        """As `Transport` says."""
        publisher = self._node.create_publisher(_class_of(topic.type), topic.name, _profile(topic))
        self._publishers[topic.name] = publisher
        return lambda message: publisher.publish(self.types.encode(message))

    def subscribe(self, topic: Topic) -> Inbox:
        """As `Transport` says."""
        inbox = Inbox(topic, self.types, self._heard.set)
        self._node.create_subscription(_class_of(topic.type), topic.name, inbox.put, _profile(topic), raw=True)
        return inbox

    def act(self, name: str, done: Callable[[str | None], None]) -> Send:
        """As `ActingTransport` says."""
        from action_msgs.msg import GoalStatus
        from rclpy.action import ActionClient
        from rclpy.serialization import deserialize_message

        action = import_module("control_msgs.action").FollowJointTrajectory
        client = ActionClient(self._node, action, name)
        if not client.wait_for_server(timeout_sec=SERVED_WITHIN):
            raise bad_input("no-network", f"nobody serves the action `{name}`", mend="ros2 action list -t")
        newest = 0

        def send(message: Message) -> None:
            nonlocal newest
            newest += 1
            number, goal = newest, action.Goal()
            goal.trajectory = deserialize_message(self.types.encode(message), _class_of(message.__msgtype__))

            def finished(future: Any) -> None:  # noqa: ANN401 # of a library without types
                found = future.result()
                if number == newest and found.status in (GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_SUCCEEDED):
                    failed = found.status == GoalStatus.STATUS_ABORTED
                    done((found.result.error_string or f"error code {found.result.error_code}") if failed else None)

            def accepted(future: Any) -> None:  # noqa: ANN401 # as above
                handle = future.result()
                if handle.accepted:
                    handle.get_result_async().add_done_callback(finished)
                elif number == newest:
                    done("the goal was rejected")

            client.send_goal_async(goal).add_done_callback(accepted)

        return send

    def readers(self, topic: Topic) -> int:
        """As `Transport` says."""
        return int(self._publishers[topic.name].get_subscription_count())

    def senders(self) -> Mapping[str, Collection[str]]:
        """As `Transport` says."""
        names = (name for name, _ in self._node.get_topic_names_and_types())
        sent = {name: self._node.get_publishers_info_by_topic(name) for name in names}
        others = {name: {one.topic_type for one in them if one.node_name != NODE} for name, them in sent.items()}
        return {name: types for name, types in others.items() if types}

    def wait(self, seconds: float) -> None:
        """As `Transport` says."""
        self._heard.wait(seconds)
        self._heard.clear()

    def close(self) -> None:
        """As `Transport` says."""
        self._executor.shutdown()
        self._thread.join(2.0)
        self._node.destroy_node()
        self._context.try_shutdown()


def _class_of(name: str) -> Any:  # noqa: ANN401 # a class that ROS has made
    """The class of a type, which rclpy wants even for bytes."""
    package, _, short = name.split("/")
    return getattr(import_module(f"{package}.msg"), short)


def _profile(topic: Topic) -> Any:  # noqa: ANN401 # of a library without types
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=topic.depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )
