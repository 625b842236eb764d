"""Topics by Cyclone DDS: what one side sends, the other reads, and the library itself writes the same bytes."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds")

from sqrp_cli.errors import InputError
from sqrp_cli.ros import dds
from sqrp_cli.ros.dds import DdsTransport
from sqrp_cli.ros.messages import Inbox, Topic, message_types

STATES = Topic(name="/states", type="sensor_msgs/msg/JointState", depth=50, reliable=True)


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A domain whose tests no other ones on this computer meet: who holds its last port, by TCP, has it."""
    for number in range(50, 100):
        with socket.socket() as held, suppress(OSError):
            held.bind(("127.0.0.1", 7400 + 250 * number + 249))
            yield number
            return
    pytest.fail("no domain is free")


@pytest.fixture(scope="module")
def ends(domain: int) -> Iterator[tuple[DdsTransport, DdsTransport]]:
    one, other = DdsTransport(domain, "127.0.0.1"), DdsTransport(domain, "127.0.0.1")
    yield one, other
    one.close()
    other.close()


def until(so: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not so():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)


def meet(ends: tuple[DdsTransport, DdsTransport], topic: Topic) -> tuple[Callable[[object], None], Inbox]:
    inbox, send = ends[1].subscribe(topic), ends[0].publish(topic)
    until(lambda: ends[0].readers(topic))
    return send, inbox


def test_messages_arrive_whole_and_in_order(ends: tuple[DdsTransport, DdsTransport]) -> None:
    send, inbox = meet(ends, STATES)
    types = message_types(2)
    for number in range(20):
        send(types.make(STATES.type, name=["a"], position=np.array([float(number)])))
    until(lambda: inbox.count == 20)
    assert [message.position[0] for message, _ in inbox.take()] == list(range(20))
    until(lambda: STATES.name in ends[1].senders())
    assert ends[1].senders()[STATES.name] == {"sensor_msgs/msg/JointState"}


def test_a_flood_keeps_the_newest_messages_and_no_more(ends: tuple[DdsTransport, DdsTransport]) -> None:
    topic = Topic(name="/flood", type="std_msgs/msg/Float64", depth=5, reliable=True)
    send, inbox = meet(ends, topic)
    types = message_types(2)
    for number in range(3000):
        send(types.make(topic.type, data=float(number)))
    last = types.encode(types.make(topic.type, data=2999.0))
    until(lambda: inbox.count and inbox._waiting[-1][0] == last)
    found = [message.data for message, _ in inbox.take()]
    assert len(found) <= 5
    assert found[-1] == 2999.0


def test_a_topic_of_another_type_is_named_and_never_heard(ends: tuple[DdsTransport, DdsTransport]) -> None:
    ends[0].publish(Topic(name="/picture", type="sensor_msgs/msg/CompressedImage"))
    wanted = Topic(name="/picture", type="sensor_msgs/msg/Image")
    inbox = ends[1].subscribe(wanted)
    until(lambda: wanted.name in ends[1].senders())
    assert ends[1].senders()[wanted.name] == {"sensor_msgs/msg/CompressedImage"}
    assert inbox.count == 0


def test_the_library_writes_the_same_bytes_of_its_own_objects() -> None:
    """The classes that Cyclone gets are made by machine; filled and written by Cyclone, they give our bytes."""
    types = message_types(2)

    def filled(name: str, said: dict[str, Any]) -> object:
        made = dds._struct.__wrapped__(name, types) if name.endswith("Trajectory") else dds._struct(name, types)
        found = made.__new__(made)
        for field, (_, of) in types.store.fielddefs[name][1]:
            value = said[field]
            if isinstance(value, dict):
                value = filled(of, value)
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                value = [filled(of[0][1], one) for one in value]
            setattr(found, field, value)
        return found

    name, header = "trajectory_msgs/msg/JointTrajectory", {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "base"}
    point = {"positions": [1.0, 2.5], "velocities": [0.5, 0.0], "accelerations": [], "effort": []}
    point["time_from_start"] = {"sec": 3, "nanosec": 7}
    theirs = filled(name, {"header": header, "joint_names": ["a", "elbow"], "points": [point]})
    ours = {key: value if isinstance(value, dict) else np.array(value, float) for key, value in point.items()}
    points = [types.make("trajectory_msgs/msg/JointTrajectoryPoint", **ours)]
    message = types.make(name, header=types.header(1_000_000_002, "base"), joint_names=["a", "elbow"], points=points)
    assert theirs.serialize() == types.encode(message)


def test_a_network_that_this_computer_lacks_is_said(domain: int) -> None:
    with pytest.raises(InputError, match="cannot use domain"):
        DdsTransport(domain + 50, "203.0.113.7")
