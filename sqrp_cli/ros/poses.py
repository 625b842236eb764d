"""Poses in messages of ROS."""

from __future__ import annotations

from sqrp_cli.geometry import Array, matrix_to_quaternion
from sqrp_cli.ros.messages import Message, MessageTypes


def pose_message(types: MessageTypes, X: Array) -> Message:
    """A geometry_msgs/Pose of a pose (4, 4)."""
    x, y, z = X[:3, 3].tolist()
    point = types.make("geometry_msgs/msg/Point", x=x, y=y, z=z)
    return types.make("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(types, X))


def transform_message(types: MessageTypes, ns: int, parent: str, child: str, X: Array) -> Message:
    """A geometry_msgs/TransformStamped: the pose (4, 4) of a frame in its parent; ns: the stamp [ns]."""
    x, y, z = X[:3, 3].tolist()
    vector = types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
    transform = types.make("geometry_msgs/msg/Transform", translation=vector, rotation=_quaternion(types, X))
    header = types.header(ns, parent)
    return types.make("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform)


def _quaternion(types: MessageTypes, X: Array) -> Message:
    x, y, z, w = matrix_to_quaternion(X[:3, :3]).tolist()
    return types.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
