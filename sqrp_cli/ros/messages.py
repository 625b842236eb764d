"""Messages of ROS 1 and ROS 2, all from the type store of `rosbags`: nothing of ROS needs to be installed.

And what a transport of messages is: topics to publish on and to read from, whatever carries them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

import numpy as np

from sqrp_cli.errors import SqrpError, needed
from sqrp_cli.geometry import Array, matrix_to_quaternion
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

Message: TypeAlias = Any
"""A record of a type that the store made, with the fields that its definition names; arrays of numbers are NumPy's."""
Ros = Literal[1, 2]  # Which ROS: its types differ a little, its bytes much
LONGEST_LOOK = 0.03
"""Of the time between two looks for messages so much counts [s]; the rest is a pause of this process."""
LONGEST_SEQUENCE = 1 << 26  # Most elements of a sequence in a message that is read: an image of 64 million bytes
_TF = "geometry_msgs/TransformStamped[] transforms"  # Of tf2_msgs/TFMessage, which the store lacks in ROS 1


class MessageError(SqrpError):
    """Bytes that are no message of the type that they are said to be."""


class MessageTypes:
    """The types of one ROS, each by its full name such as `sensor_msgs/msg/JointState`."""

    def __init__(self, ros: Ros) -> None:
        """Raises InputError where rosbags is not installed."""
        with needed("messages of ROS need the package rosbags", "pip install 'sqrp[ros2]'"):
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        self.ros: Ros = ros
        self.store: Typestore = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        self.store.max_sequence_length = LONGEST_SEQUENCE
        if ros == 1:
            self.store.register(get_types_from_msg(_TF, "tf2_msgs/msg/TFMessage"))

    def make(self, name: str, /, **fields: Message) -> Message:
        """A message of a type; what is not given is zero or empty, what is given as a mapping is a message, too."""
        from rosbags.interfaces import Nodetype

        given = {}
        for field, of in self.store.fielddefs[name][1]:
            kind, about = cast("tuple[Nodetype, Any]", of)
            value = fields.pop(field, None)
            if value is None or isinstance(value, dict):
                if kind == Nodetype.NAME:
                    value = self.make(about, **(value or {}))
                elif kind == Nodetype.BASE:
                    value = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}.get(about[0], 0)
                else:
                    (inner, what), length = about
                    count = length if kind == Nodetype.ARRAY else 0
                    if inner == Nodetype.NAME:
                        value = [self.make(what) for _ in range(count)]
                    elif what[0] == "string":
                        value = [""] * count
                    else:
                        numbers = {"byte": "uint8", "octet": "uint8", "char": "uint8"}.get(what[0], what[0])
                        value = np.zeros(count, dtype=numbers)
            given[field] = value
        if fields:
            raise TypeError(f"{name} has no field {next(iter(fields))}")
        return self.store.types[name](**given)

    def header(self, ns: int, frame: str = "") -> Message:
        """A std_msgs/Header; ns: the stamp since the epoch of its clock [ns]."""
        return self.make("std_msgs/msg/Header", stamp=self.time(ns), frame_id=frame)

    def time(self, ns: int) -> Message:
        """Nanoseconds as the fields of a Time or a Duration."""
        return {"sec": ns // 1_000_000_000, "nanosec": ns % 1_000_000_000}

    def encode(self, message: Message) -> bytes:
        """The message as bytes: CDR (little endian, with its header) in ROS 2, the bytes of ROS 1 there."""
        write = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        return bytes(write(message, message.__msgtype__))

    def decode(self, name: str, data: bytes | memoryview) -> Message:
        """The message of a type that bytes hold. Raises MessageError for others."""
        read = self.store.deserialize_ros1 if self.ros == 1 else self.store.deserialize_cdr
        try:
            return read(data, name)
        except Exception as error:  # the code that the store makes of a type raises whatever it stumbles over
            raise MessageError(f"{len(data):,} bytes that are no {name}") from error


message_types = cache(MessageTypes)
"""The types of one ROS, made once. Raises InputError where rosbags is not installed."""


def nanoseconds(time: Message) -> int:
    """Nanoseconds of a Time or a Duration."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def pose_fields(X: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Position and quaternion of a pose (4, 4), as the fields of messages."""
    quaternion = matrix_to_quaternion(X[:3, :3]).tolist()
    return dict(zip("xyz", X[:3, 3].tolist(), strict=True)), dict(zip("xyzw", quaternion, strict=True))


def transform_message(types: MessageTypes, ns: int, parent: str, child: str, X: Array) -> Message:
    """A geometry_msgs/TransformStamped: the pose (4, 4) of a frame in its parent; ns: the stamp [ns]."""
    translation, rotation = pose_fields(X)
    transform = {"translation": translation, "rotation": rotation}
    name, header = "geometry_msgs/msg/TransformStamped", types.header(ns, parent)
    return types.make(name, header=header, child_frame_id=child, transform=transform)


Send = Callable[[Message], None]  # Sends a message to whoever reads the topic; returns at once


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic, such as `/joint_states`, and how its messages are carried.

    type: full name of the type of its messages, such as `sensor_msgs/msg/JointState`. depth: most messages that wait to
    be read; of more, the oldest are dropped. reliable: whether a lost message is sent again; a reader that asks for it
    gets nothing from a sender that does not. latched: whether a reader that comes later gets the last messages, too.
    """

    name: str
    type: str
    depth: int = 10
    reliable: bool = False
    latched: bool = False


class Inbox:
    """The newest messages of a topic, which another thread puts there as bytes; no more than the topic's depth."""

    def __init__(self, topic: Topic, types: MessageTypes, heard: Callable[[], None]) -> None:
        """heard: called with each message that comes, in the thread that brings it."""
        self.topic, self._types, self._heard = topic, types, heard
        self._waiting: deque[tuple[bytes, float]] = deque(maxlen=topic.depth)
        self.count = 0
        """How many messages ever came."""

    def put(self, data: bytes) -> None:
        """A message has come."""
        self._waiting.append((data, time.monotonic()))
        self.count += 1
        self._heard()

    def take(self) -> list[tuple[Message, float]]:
        """The messages that wait, in the order in which they came, each with when it did by `time.monotonic` [s].

        No more than wait now: who is flooded gets on, too. Raises MessageError for bytes that are no message of the
        topic's type; those before it are gone, too, those after it still wait.
        """
        found = []
        for _ in range(len(self._waiting)):
            data, t = self._waiting.popleft()
            found.append((self._types.decode(self.topic.type, data), t))
        return found


@dataclass
class Pauses:
    """How long one has really waited for something, on any clock [s]: without pauses, as of a busy computer.

    Only what was sent in the last pause may not have been received yet, so that who pauses again and again still
    notices what stays out.
    """

    _now: float = 0.0
    _begin: float = 0.0
    _end: float = 0.0

    def look(self, t: float) -> None:
        """It is looked for messages at time t [s]."""
        if t > self._now + LONGEST_LOOK:
            self._begin, self._end = self._now + LONGEST_LOOK, t
        self._now = t

    def waited(self, since: float) -> float:
        """The time from then to the last look, without the last pause [s]; negative for times that are to come."""
        return self._now - since - max(0.0, self._end - max(self._begin, since))
