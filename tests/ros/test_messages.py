"""Messages of ROS: whole without a word said, and the bytes that others write."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags")

from sqrp_cli.ros.messages import MessageError, message_types, nanoseconds

USED = (
    "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo", "trajectory_msgs/msg/JointTrajectory", "trajectory_msgs/msg/JointTrajectoryPoint",
    "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Clock", "std_msgs/msg/Bool", "std_msgs/msg/String",
)  # fmt: skip


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("name", USED)
def test_an_empty_message_of_each_type_survives_its_bytes(ros: int, name: str) -> None:
    types = message_types(ros)
    assert types.encode(types.decode(name, types.encode(types.make(name)))) == types.encode(types.make(name))


@pytest.mark.parametrize("ros", [1, 2])
def test_bytes_that_are_no_such_message_are_refused(ros: int) -> None:
    types = message_types(ros)
    whole = types.encode(types.make("sensor_msgs/msg/Image", data=np.arange(100, dtype=np.uint8)))
    huge = whole[:-104] + b"\xff\xff\xff\x7f" + whole[-100:]
    for data in (b"", whole[:-40], huge, b"\x00" * 7):
        with pytest.raises(MessageError, match="no sensor_msgs/msg/Image"):
            types.decode("sensor_msgs/msg/Image", data)


def test_a_field_that_the_type_lacks_is_an_error_of_ours() -> None:
    with pytest.raises(TypeError, match="no field postition"):
        message_types(2).make("sensor_msgs/msg/JointState", postition=[])


def test_times_keep_their_nanoseconds() -> None:
    types = message_types(2)
    for ns in (0, 1_700_000_000_123_456_789, -1, -2_500_000_000):
        assert nanoseconds(types.make("builtin_interfaces/msg/Duration", **types.time(ns))) == ns
