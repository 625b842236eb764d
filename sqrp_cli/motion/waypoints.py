"""Waypoints of a skill as poses of the tool frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.files.frames import TOOL, WORLD
from sqrp_cli.geometry import Array, axis_rotation, inverse, pose, side_pose
from sqrp_cli.records import dataclass
from sqrp_cli.skill import skill
from sqrp_cli.skill.settings import MotionValue, Reference, Setting, number_of, side_of


def setting_value(setting: Setting, values: Mapping[str, MotionValue]) -> MotionValue:
    """A setting with its motion parameter, if it names one, replaced by its value."""
    return values[setting.parameter] if isinstance(setting, Reference) else setting


def setting_number(setting: Setting, values: Mapping[str, MotionValue]) -> float:
    """The value of a setting that is a number, in SI units."""
    return number_of(setting_value(setting, values))


@dataclass(frozen=True, eq=False)
class WaypointGrounder:
    """Waypoints of a skill in one binding and one world."""

    waypoints: Mapping[str, skill.Waypoint]
    """Of the skill."""
    binding: Mapping[str, str]
    """The object of each skill parameter."""
    values: Mapping[str, MotionValue]
    """Of the motion parameters."""
    objects: Mapping[str, SceneObject]
    X_WH: Array
    """Pose of the tool frame at home."""
    X_WO: Mapping[str, Array]
    """Poses of the objects whose place is known."""
    X_TO: Mapping[str, Array]
    """Poses in the tool frame of the objects that are held, or were last."""
    _found: dict[str, Array] = field(default_factory=dict, init=False)
    """Poses that were asked for: several waypoints may be defined by the same one."""

    def pose(self, name: str) -> Array:
        """The pose X_WT of the tool frame at a waypoint without `missing` data, shape (4, 4).

        - grasp: X_WO @ `side_pose`, turned by yaw about the tool's z axis and moved by depth along it;
        - put: the held object as `put_pose` says;
        - retreat: the other pose, moved by -distance along its own z axis;
        - raise: the other pose, moved by distance along the world's z axis;
        - turn: the other pose, turned about its own z axis, then about its own x axis;
        - offset: the other pose, moved along the axes of itself, the world or an object;
        - pose: that of the tool frame, or of a held object, in the world or relative to an object.
        """
        if name == skill.HOME:
            return self.X_WH
        if name not in self._found:
            self._found[name] = self._pose(name)
        return self._found[name]

    def _pose(self, name: str) -> Array:
        match self.waypoints[name]:
            case skill.GraspWaypoint(object=parameter, side=side, yaw=yaw, depth=depth):
                grasped = self.binding[parameter]
                X_OS = side_pose(self.objects[grasped].size, side_of(setting_value(side, self.values)))
                return (
                    self.X_WO[grasped] @ X_OS @ pose(axis_rotation(2, self._number(yaw)), (0, 0, self._number(depth)))
                )
            case skill.PutWaypoint(object=parameter, on=surface) as put:
                held, carrier = self.binding[parameter], self.binding[surface]
                settings = (self._number(setting) for setting in (put.along, put.across, put.yaw))
                X_BO = put_pose(self.objects[held].size, self.objects[carrier].size, *settings)
                return self.X_WO[carrier] @ X_BO @ inverse(self.X_TO[held])
            case skill.RetreatWaypoint(waypoint=other, distance=distance):
                return self.pose(other) @ pose(position=(0.0, 0.0, -self._number(distance)))
            case skill.RaiseWaypoint(waypoint=other, distance=distance):
                return pose(position=(0.0, 0.0, self._number(distance))) @ self.pose(other)
            case skill.TurnWaypoint(waypoint=other, turn=turn, tilt=tilt):
                return (
                    self.pose(other)
                    @ pose(axis_rotation(2, self._number(turn)))
                    @ pose(axis_rotation(0, self._number(tilt)))
                )
            case skill.OffsetWaypoint(waypoint=other, offset=offset, along=along):
                X_WT, shift = self.pose(other), np.array([self._number(part) for part in offset])
                axes = X_WT if along == TOOL else self._frame(along)
                return pose(position=axes[:3, :3] @ shift) @ X_WT
            case skill.PoseWaypoint(X_FT=X_FT, frame=frame, of=held):
                of_tool = pose() if held is None else inverse(self.X_TO[self.binding[held]])
                return self._frame(frame) @ X_FT @ of_tool

    def _frame(self, name: str) -> Array:
        """The pose X_WF of the world, or of an object that a skill names, shape (4, 4)."""
        return pose() if name == WORLD else self.X_WO[self.binding.get(name, name)]

    def missing(self, name: str) -> str | None:
        """Why the pose of a waypoint is unknown; None if it is known."""
        names = [] if name == skill.HOME else [name]
        for known in names:
            names += [other for other in skill.origins(self.waypoints[known]) if other not in names]
        return next(filter(None, map(self._lack, names)), None)

    def _lack(self, name: str) -> str | None:
        """What a waypoint itself lacks, apart from its origins."""
        match self.waypoints[name]:
            case skill.GraspWaypoint(object=parameter):
                return self._unplaced(parameter)
            case skill.PutWaypoint(object=parameter, on=surface):
                return self._not_held(parameter) or self._unplaced(surface)
            case skill.OffsetWaypoint(along=frame) if frame not in (TOOL, WORLD):
                return self._unplaced(frame)
            case skill.PoseWaypoint(frame=frame, of=held):
                lost = None if held is None else self._not_held(held)
                return lost or (None if frame == WORLD else self._unplaced(frame))
        return None

    def _not_held(self, parameter: str) -> str | None:
        name = self.binding[parameter]
        return None if name in self.X_TO else f"the tool does not hold `{name}`"

    def _unplaced(self, parameter: str) -> str | None:
        name = self.binding.get(parameter, parameter)
        return None if name in self.X_WO else f"it is not known where `{name}` is"

    def _number(self, setting: Setting) -> float:
        return setting_number(setting, self.values)


def put_pose(
    size: tuple[float, float, float], surface: tuple[float, float, float], along: float, across: float, yaw: float
) -> Array:
    """The pose X_BO of an object that stands upright on top of another one, both boxes of full extents [m], (4, 4).

    along, across: where, along the x and the y axis of the lower one: at 0 in the middle, at -1 and 1 flush with its
    edges. An object wider than its support stays in the middle. yaw: turn about z [rad].
    """
    width, depth, height = size
    c, s = abs(np.cos(yaw)), abs(np.sin(yaw))
    free_x = max(0.0, surface[0] - c * width - s * depth)
    free_y = max(0.0, surface[1] - s * width - c * depth)
    return pose(axis_rotation(2, yaw), (0.5 * along * free_x, 0.5 * across * free_y, 0.5 * (surface[2] + height)))
