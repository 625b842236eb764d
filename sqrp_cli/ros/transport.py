"""What a transport of messages is: topics to publish on and to read from, whatever carries them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from sqrp_cli.ros.messages import Message, MessageTypes

Send = Callable[[Message], None]
"""Sends a message to whoever reads the topic; returns at once."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic, and how its messages are carried."""

    name: str
    """Such as `/joint_states`."""
    type: str
    """Full name of the type of its messages, such as `sensor_msgs/msg/JointState`."""
    depth: int = 10
    """Most messages that wait to be read; of more, the oldest are dropped."""
    reliable: bool = False
    """Whether a lost message is sent again. A reader that asks for it gets nothing from a sender that does not."""
    latched: bool = False
    """Whether a reader that comes later gets the last messages, too."""


class Arrived(NamedTuple):
    """A message, and when it came."""

    message: Message
    t: float
    """By `time.monotonic` [s]."""


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

    def take(self) -> list[Arrived]:
        """The messages that wait, in the order in which they came.

        No more than wait now: who is flooded gets on, too. Raises MessageError for bytes that are no message of the
        topic's type; those before it are gone, too, those after it still wait.
        """
        found = []
        for _ in range(len(self._waiting)):
            data, t = self._waiting.popleft()
            found.append(Arrived(self._types.decode(self.topic.type, data), t))
        return found


class Transport(Protocol):
    """What carries messages between this process and others. `close` ends it."""

    @property
    def types(self) -> MessageTypes:
        """Its types of messages."""

    def publish(self, topic: Topic) -> Send:
        """Announce a topic; returns what sends on it."""

    def subscribe(self, topic: Topic) -> Inbox:
        """Read a topic from now on."""

    def readers(self, topic: Topic) -> int:
        """How many read a topic that is published here."""

    def senders(self) -> Mapping[str, Collection[str]]:
        """The types that others send, by the full name of their topic, as far as is known."""

    def wait(self, seconds: float) -> None:
        """Wait until a message comes, at most for some time [s]."""

    def close(self) -> None:
        """End it; nothing is sent any more."""
