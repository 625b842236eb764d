"""Waypoints of a skill as poses of the tool frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.files.frames import TOOL, WORLD
from sqrp_cli.geometry import Array, axis_rotation, grasp_pose, inverse, pose
from sqrp_cli.records import dataclass
from sqrp_cli.skill import skill
from sqrp_cli.skill.settings import MotionValue, Reference, Setting, number_of, side_of


def setting_value(setting: Setting, values: Mapping[str, MotionValue]) -> MotionValue:
    """A setting with its motion parameter, if it names one, replaced by its value."""
    return values[setting.parameter] if isinstance(setting, Reference) else setting


class UnknownPlaceError(Exception):
    """Why the pose of a waypoint is unknown."""


@dataclass(frozen=True, eq=False)
class WaypointGrounder:
    """Waypoints of a skill in one binding and one world."""

    waypoints: Mapping[str, skill.Waypoint]  # of the skill
    binding: Mapping[str, str]  # the object of each skill parameter
    values: Mapping[str, MotionValue]  # of the motion parameters
    objects: Mapping[str, SceneObject]
    X_WH: Array  # Pose of the tool frame at home
    X_WO: Mapping[str, Array]  # poses of the objects whose place is known
    X_TO: Mapping[str, Array]  # poses in the tool frame of the objects that are held, or were last
    _found: dict[str, Array] = field(default_factory=dict, init=False)
    """Poses that were asked for: several waypoints may be defined by the same one."""

    def pose(self, name: str) -> Array:
        """The pose X_WT of the tool frame at a waypoint, shape (4, 4). Raises UnknownPlaceError.

        - grasp: X_WO @ `grasp_pose`;
        - put: the held object as `put_pose` says;
        - retreat: the other pose, moved by -distance along its own z axis;
        - raise: the other pose, moved by distance along the world's z axis;
        - turn: the other pose, turned about its own z axis, then about its own x axis;
        - offset: the other pose, moved along the axes of itself, the world or an object;
        - pose: that of the tool frame, or of a held object, in the world or relative to an object.
        """
        if name == skill.HOME:
            return self.X_WH
        if name in self._found:
            return self._found[name]
        number = self.number
        match self.waypoints[name]:
            case skill.GraspWaypoint(object=parameter) as grasp:
                X_WO, beside = self.placed(parameter), None if grasp.beside is None else number(grasp.beside)
                size, side = self.objects[self.binding[parameter]].size, side_of(setting_value(grasp.side, self.values))
                X_WT = X_WO @ grasp_pose(size, side, number(grasp.yaw), number(grasp.depth), beside)
            case skill.PutWaypoint(object=parameter, on=surface) as put:
                X_TO, X_WB = self._held(parameter), self.placed(surface)
                size, below = (self.objects[self.binding[name]].size for name in (parameter, surface))
                X_BO = put_pose(size, below, number(put.along), number(put.across), number(put.yaw))
                X_WT = X_WB @ X_BO @ inverse(X_TO)
            case skill.RetreatWaypoint(waypoint=other, distance=distance):
                X_WT = self.pose(other) @ pose(position=(0.0, 0.0, -number(distance)))
            case skill.RaiseWaypoint(waypoint=other, distance=distance):
                X_WT = pose(position=(0.0, 0.0, number(distance))) @ self.pose(other)
            case skill.TurnWaypoint(waypoint=other, turn=turn, tilt=tilt):
                X_WT = self.pose(other) @ pose(axis_rotation(2, number(turn))) @ pose(axis_rotation(0, number(tilt)))
            case skill.OffsetWaypoint(waypoint=other, offset=offset, along=along):
                axes = None if along == TOOL else self.placed(along)
                X_WT = self.pose(other)
                shift = np.array([number(part) for part in offset])
                X_WT = pose(position=(X_WT if axes is None else axes)[:3, :3] @ shift) @ X_WT
            case skill.PoseWaypoint(pose=stated, frame=frame, of=held):
                of_tool = pose() if held is None else inverse(self._held(held))
                X_WT = self.placed(frame) @ stated.matrix() @ of_tool
        self._found[name] = X_WT
        return X_WT

    def number(self, setting: Setting) -> float:
        """The value of a setting that is a number, in SI units."""
        return number_of(setting_value(setting, self.values))

    def placed(self, frame: str) -> Array:
        """The pose X_WF of the world, or of an object that a skill names, shape (4, 4). Raises UnknownPlaceError."""
        name = self.binding.get(frame, frame)
        if frame != WORLD and name not in self.X_WO:
            raise UnknownPlaceError(f"it is not known where `{name}` is")
        return pose() if frame == WORLD else self.X_WO[name]

    def _held(self, parameter: str) -> Array:
        """The pose X_TO of an object that is held, or was last, shape (4, 4)."""
        name = self.binding[parameter]
        if name not in self.X_TO:
            raise UnknownPlaceError(f"the tool does not hold `{name}`")
        return self.X_TO[name]


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
