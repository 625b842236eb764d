"""Topics of ROS 1 by rospy, which Debian packages and sourced workspaces have; messages are bytes of the store.

The only module that uses `rospy`, `rosgraph`, `genpy` and `actionlib`. An action is five topics: nothing else of ROS is
needed to use one.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Collection, Mapping
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

from sqrp_cli.errors import bad_input, needed
from sqrp_cli.ros.messages import Message, MessageTypes, message_types
from sqrp_cli.ros.transport import Inbox, Send, Topic

_ACTION = "control_msgs/msg/FollowJointTrajectoryAction"


class TrajectoryActionServer:
    """Accepts each goal in place of the one before, and puts its trajectory into an inbox."""

    def __init__(self, name: str, types: MessageTypes, inbox: Inbox, cancel: Callable[[], None]) -> None:
        """cancel: called, in another thread, where the goal that is followed is cancelled."""
        import actionlib
        import genpy.dynamic

        made = genpy.dynamic.generate_dynamic(_ACTION.replace("/msg/", "/"), types.definition(_ACTION).text)
        self._inbox, self._cancel = inbox, cancel
        self._result = made["control_msgs/FollowJointTrajectoryResult"]
        self._goal: Any = None
        self._lock = Lock()
        self._server = actionlib.ActionServer(
            name, made[_ACTION.replace("/msg/", "/")], self._accept, self._cancelled, auto_start=False
        )
        self._server.start()

    def succeed(self) -> None:
        """The goal that is followed is reached."""
        with self._lock:
            if self._goal is not None:
                self._goal.set_succeeded(self._result(error_code=0))
                self._goal = None

    def refuse(self, reason: str) -> None:
        """The newest goal is not followed."""
        with self._lock:
            if self._goal is not None:
                self._goal.set_aborted(self._result(error_code=-1, error_string=reason), reason)
                self._goal = None

    @property
    def busy(self) -> bool:
        """Whether a goal is followed."""
        return self._goal is not None

    def _accept(self, goal: Any) -> None:  # noqa: ANN401 # of a library without types
        with self._lock:
            if self._goal is not None:
                self._goal.set_canceled(self._result(error_code=0), "another goal has replaced it")
            goal.set_accepted()
            self._goal = goal
            packed = BytesIO()
            goal.get_goal().trajectory.serialize(packed)
            self._inbox.put(packed.getvalue())

    def _cancelled(self, goal: Any) -> None:  # noqa: ANN401 # as above
        with self._lock:
            if goal == self._goal:
                goal.set_canceled(self._result(error_code=0))
                self._goal = None
                self._cancel()


DEBIAN = Path("/usr/lib/python3/dist-packages")
"""Where Debian has the packages, which Python of another place does not look at."""

LARGEST = 1 << 26
"""Most bytes that a connection holds for us."""


class Ros1Transport:
    """Topics of a master of ROS 1."""

    def __init__(self, master: str | None = None) -> None:
        """master: its address, by default ROS_MASTER_URI. Raises InputError without rospy or a master."""
        if master is not None:
            os.environ["ROS_MASTER_URI"] = master
        here = urlsplit(os.environ.get("ROS_MASTER_URI", "")).hostname in ("localhost", "127.0.0.1")
        if here and not os.environ.get("ROS_HOSTNAME"):
            os.environ.setdefault("ROS_IP", "127.0.0.1")  # the name of this computer may lead nowhere
        self._rospy = _rospy()
        self.types: MessageTypes = message_types(1)
        self._heard = threading.Event()
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        self._master = _master()
        if not self._rospy.core.is_initialized():
            self._rospy.init_node("sqrp", anonymous=True, disable_signals=True, disable_rosout=True)

    def publish(self, topic: Topic) -> Send:
        """As `Transport` says."""
        carrier = _carrier(topic.type, self.types)
        publisher = self._rospy.Publisher(topic.name, carrier, queue_size=topic.depth, latch=topic.latched)
        self._publishers[topic.name] = publisher

        def send(message: Message) -> None:
            publisher.publish(carrier(self.types.encode(message)))

        return send

    def subscribe(self, topic: Topic) -> Inbox:
        """As `Transport` says. A sender of another type is never heard."""
        inbox = Inbox(topic, self.types, self._heard.set)
        receive: Callable[[Any], None] = lambda message: inbox.put(message.data)  # noqa: E731 - it has a type
        carrier = _carrier(topic.type, self.types)
        subscriber = self._rospy.Subscriber(
            topic.name, carrier, receive, queue_size=topic.depth, buff_size=LARGEST, tcp_nodelay=True
        )
        self._subscribers.append(subscriber)
        return inbox

    def serve_trajectories(self, name: str, inbox: Inbox, cancel: Callable[[], None]) -> TrajectoryActionServer:
        """An action server whose trajectories go to an inbox; cancel: called where the last one is cancelled."""
        return TrajectoryActionServer(name, self.types, inbox, cancel)

    def readers(self, topic: Topic) -> int:
        """As `Transport` says."""
        return int(self._publishers[topic.name].get_num_connections())

    def senders(self) -> Mapping[str, Collection[str]]:
        """As `Transport` says: by the master, which remembers also nodes that were killed."""
        publishers, _, _ = self._master.getSystemState()
        kinds = {name: kind.replace("/", "/msg/") for name, kind in self._master.getTopicTypes()}
        own = self._rospy.get_name()
        return {name: {kinds[name]} for name, nodes in publishers if name in kinds and set(nodes) - {own}}

    def wait(self, seconds: float) -> None:
        """As `Transport` says."""
        self._heard.wait(seconds)
        self._heard.clear()

    def close(self) -> None:
        """As `Transport` says. A process connects once: rospy cannot be started again."""
        for one in (*self._subscribers, *self._publishers.values()):
            one.unregister()


def _rospy() -> Any:  # noqa: ANN401 # a module without types
    """The module. Raises InputError where it is not installed."""
    try:
        import rospy
    except ImportError:
        if str(DEBIAN) not in sys.path and (DEBIAN / "rospy").is_dir():
            sys.path.append(str(DEBIAN))
        mend = "apt install python3-rospy python3-rosgraph-msgs, or source a workspace of ROS 1"
        with needed("ROS 1 needs rospy, which cannot be imported: {}", mend):
            import rospy
    return rospy


def _master() -> Any:  # noqa: ANN401 # of a library without types
    """The master. Raises InputError where there is none."""
    import rosgraph

    uri = os.environ.get("ROS_MASTER_URI", "")
    try:
        master = rosgraph.Master("/sqrp")
        master.getPid()
    except Exception as error:  # whatever XML-RPC makes of a wrong address
        message = f"no master of ROS 1 answers at {uri or 'ROS_MASTER_URI, which is not set'}"
        raise bad_input("no-network", message, mend="roscore") from error
    return master


def _carrier(name: str, types: MessageTypes) -> Any:  # noqa: ANN401 # a class made at run time
    """The class of a type for rospy, whose messages are bytes: rospy only learns from it what they are."""
    import genpy

    text, md5 = types.definition(name)

    class Carrier(genpy.Message):  # type: ignore[misc]
        """A message as bytes."""

        _type, _md5sum, _full_text, _has_header = name.replace("/msg/", "/"), md5, text, False
        __slots__ = ("data",)
        _slot_types = ("string",)

        def __init__(self, data: bytes = b"") -> None:
            self.data = data

        def serialize(self, buff: Any) -> None:  # noqa: ANN401 # of a library without types
            buff.write(self.data)

        def deserialize(self, data: bytes) -> Any:  # noqa: ANN401 # as above
            self.data = bytes(data)
            return self

    return Carrier
