"""Waypoints of a skill as poses of the tool frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sqrp_cli.geometry import Array, axis_rotation, pose
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import (
    GraspWaypoint,
    MotionValue,
    PoseWaypoint,
    RaiseWaypoint,
    Reference,
    RetreatWaypoint,
    Setting,
    Waypoint,
)


def setting_value(setting: Setting, values: Mapping[str, MotionValue]) -> MotionValue:
    """A setting with its motion parameter, if it names one, replaced by its value."""
    return values[setting.parameter] if isinstance(setting, Reference) else setting


def setting_number(setting: Setting, values: Mapping[str, MotionValue]) -> float:
    """The value of a setting that is a number, in SI units."""
    return float(setting_value(setting, values))


def ground_waypoint(
    waypoint: Waypoint,
    waypoints: Mapping[str, Waypoint],
    binding: Mapping[str, str],
    values: Mapping[str, MotionValue],
    objects: Mapping[str, SceneObject],
    X_WO: Mapping[str, Array],
) -> Array:
    """The pose X_WT of the tool frame at a waypoint, shape (4, 4).

    waypoints: those that it may refer to. binding: the object that each skill parameter stands for. values: of the
    motion parameters. X_WO: pose of every object that a waypoint may name.

    - grasp: X_WO @ `side_pose`, turned by yaw about the tool's z axis and moved by depth along it;
    - retreat: the other pose, moved by -distance along its own z axis;
    - raise: the other pose, moved by distance along the world's z axis.
    """

    def ground(name: str) -> Array:
        return ground_waypoint(waypoints[name], waypoints, binding, values, objects, X_WO)

    match waypoint:
        case GraspWaypoint(object=parameter, side=side, yaw=yaw, depth=depth):
            name = binding[parameter]
            X_OS = side_pose(objects[name].size, str(setting_value(side, values)))
            X_ST = pose(axis_rotation(2, setting_number(yaw, values)), (0.0, 0.0, setting_number(depth, values)))
            return X_WO[name] @ X_OS @ X_ST
        case RetreatWaypoint(waypoint=other, distance=distance):
            return ground(other) @ pose(position=(0.0, 0.0, -setting_number(distance, values)))
        case RaiseWaypoint(waypoint=other, distance=distance):
            return pose(position=(0.0, 0.0, setting_number(distance, values))) @ ground(other)
        case PoseWaypoint(X_WT=X_WT):
            return X_WT


def needed_objects(name: str, waypoints: Mapping[str, Waypoint], binding: Mapping[str, str]) -> frozenset[str]:
    """Names of the objects whose poses a waypoint needs."""
    match waypoints[name]:
        case GraspWaypoint(object=parameter):
            return frozenset({binding[parameter]})
        case RetreatWaypoint(waypoint=other) | RaiseWaypoint(waypoint=other):
            return needed_objects(other, waypoints, binding)
        case PoseWaypoint():
            return frozenset()


def side_pose(size: tuple[float, float, float], side: str) -> Array:
    """The pose X_OT of a tool frame at yaw 0 in the centre of a side of a box of full extents `size` [m], shape (4, 4).

    side: the side's outward axis, one of `+x -x +y -y +z -z`. The tool's z axis points into the box; its x axis lies
    along the box's x axis, or y axis for the sides +x and -x.
    """
    axis = "xyz".index(side[1])
    outward = np.zeros(3)
    outward[axis] = 1.0 if side[0] == "+" else -1.0
    x = np.eye(3)[1 if axis == 0 else 0]
    return pose(np.column_stack([x, np.cross(-outward, x), -outward]), 0.5 * np.asarray(size) * outward)
