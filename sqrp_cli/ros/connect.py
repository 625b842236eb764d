"""The transports by name."""

from __future__ import annotations

from typing import Literal

from sqrp_cli.ros.transport import Transport


def connect(
    name: Literal["dds", "rclpy", "ros1"], *, domain: int = 0, network: str | None = None, master: str | None = None
) -> Transport:
    """A transport. domain, network: of ROS 2; master: of ROS 1, as ROS_MASTER_URI.

    Raises InputError where it cannot be used.
    """
    if name == "ros1":
        from sqrp_cli.ros.ros1 import Ros1Transport

        return Ros1Transport(master)
    if name == "rclpy":
        from sqrp_cli.ros.rclpy_topics import RclpyTransport

        return RclpyTransport(domain)
    from sqrp_cli.ros.dds import DdsTransport

    return DdsTransport(domain, network)
