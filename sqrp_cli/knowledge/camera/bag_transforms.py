"""Static transforms from `/tf_static` of a recording: rosbag2 (a folder, `.mcap` or `.db3`) and ROS 1 (`.bag`).

The only module that uses `rosbags`. Messages are read with the types that ROS ships, not with those that a bag brings.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import pose
from sqrp_cli.knowledge.camera.static_transforms import StaticTransform, unit_quaternion

TOPIC = "/tf_static"

METADATA = "metadata.yaml"
"""The file of a rosbag2 folder that tells what is in it."""

MOST_MESSAGES = 10_000
"""Most messages that are read; each node that publishes static transforms sends one."""

_TYPE = "tf2_msgs/msg/TFMessage"
_DEFINITION = "geometry_msgs/TransformStamped[] transforms"


_ROS1, _ROS2 = b"#ROSBAG V", (b"\x89MCAP", b"SQLite format 3\0")
"""How recordings begin."""


def is_bag(path: Path) -> bool:
    """Whether a file is a recording, or the metadata of one."""
    head = _head(path)
    return head.startswith((_ROS1, *_ROS2)) or (path.name == METADATA and b"rosbag2_bagfile_information" in head)


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(1000)


def read_bag(path: Path) -> list[StaticTransform]:
    """The static transforms of a recording, the last of each frame. Raises InputError where it cannot be read."""
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        message = f"reading `{TOPIC}` of a recording needs the package rosbags"
        raise InputError(Problem("missing-extra", message, Place(path), mend="pip install 'sqrp[bags]'")) from error
    types, of_ros1 = get_typestore(Stores.ROS2_HUMBLE), _head(path).startswith(_ROS1)
    if of_ros1:  # the library's types of ROS 1 lack this one
        types = get_typestore(Stores.ROS1_NOETIC)
        types.register(get_types_from_msg(_DEFINITION, _TYPE))
    read = types.deserialize_ros1 if of_ros1 else types.deserialize_cdr
    try:
        reader: Any = (
            rosbag1.Reader(path) if of_ros1 else rosbag2.Reader(path.parent if path.name == METADATA else path)
        )
        with reader:
            about = [one for one in reader.connections if one.topic == TOPIC and one.msgtype == _TYPE]
            raw = [data for _, (_, _, data) in zip(range(MOST_MESSAGES), reader.messages(about), strict=False)]
            found = {one.child: one for data in raw for one in _of_message(read(data, _TYPE), path)} if about else {}
    except InputError:
        raise
    except Exception as error:  # a damaged recording gives errors of every library below
        message = f"this recording cannot be read: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
        raise InputError(Problem("unreadable-file", message, Place(path))) from error
    if not found:
        raise InputError(Problem("missing-key", f"the recording has no static transforms on `{TOPIC}`", Place(path)))
    return list(found.values())


def _of_message(message: Any, path: Path) -> Iterator[StaticTransform]:  # noqa: ANN401 # of a type made at run time
    for stamped in message.transforms:
        t, r = stamped.transform.translation, stamped.transform.rotation
        R = unit_quaternion((r.x, r.y, r.z, r.w))
        if R is None:
            why = f"the quaternion of `{stamped.child_frame_id}` is not of length 1"
            raise InputError(Problem("not-a-rotation", why, Place(path)))
        frames = (stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/"))
        yield StaticTransform(*frames, pose(R, (t.x, t.y, t.z)), Place(path))
