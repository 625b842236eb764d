"""Static transforms from `/tf_static` of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import pose
from sqrp_cli.knowledge.camera.static_transforms import StaticTransform, unit_quaternion
from sqrp_cli.ros.bag import Bag
from sqrp_cli.ros.messages import Message

TOPIC = "/tf_static"

MOST_MESSAGES = 10_000
"""Most messages that are read; each node that publishes static transforms sends one."""

_TYPE = "tf2_msgs/msg/TFMessage"


def read_bag(path: Path) -> list[StaticTransform]:
    """The static transforms of a recording, the last of each frame. Raises InputError where it cannot be read."""
    with Bag(path) as bag:
        packed = islice((one for one in bag.messages([TOPIC]) if one.type == _TYPE), MOST_MESSAGES)
        found = {one.child: one for message in packed for one in _of_message(bag.read(message), path)}
    if not found:
        raise InputError(Problem("missing-key", f"the recording has no static transforms on `{TOPIC}`", Place(path)))
    return list(found.values())


def _of_message(message: Message, path: Path) -> Iterator[StaticTransform]:
    for stamped in message.transforms:
        t, r = stamped.transform.translation, stamped.transform.rotation
        R = unit_quaternion((r.x, r.y, r.z, r.w))
        if R is None:
            why = f"the quaternion of `{stamped.child_frame_id}` is not of length 1"
            raise InputError(Problem("not-a-rotation", why, Place(path)))
        frames = (stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/"))
        yield StaticTransform(*frames, pose(R, (t.x, t.y, t.z)), Place(path))
