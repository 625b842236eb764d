"""The robot of a cell, and its entries in a workspace file.

`robot.kinematics` makes a moving model of it. Numbers are in SI units and angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Generic, TypeVar

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.camera.markers import Marker as Marker
from sqrp_cli.files import units
from sqrp_cli.files.entries import (
    AnyQuantity,
    DescriptionEntry,
    Entry,
    Extents,
    In,
    MappingOr,
    Pose,
    Size,
    Text,
    refused,
)
from sqrp_cli.geometry import Array, check_poses
from sqrp_cli.records import dataclass
from sqrp_cli.robot.urdf import UrdfModel
from sqrp_cli.shapes import Geometry, Part

Limit = TypeVar("Limit", float, Array)


@dataclass(frozen=True, eq=False)
class JointLimits(Generic[Limit]):
    """Limits of one joint, or of n joints, shape (n,) each, in rad (or m where they slide) and seconds.

    Position limits may be infinite.
    """

    lower: Limit
    upper: Limit
    velocity: Limit
    acceleration: Limit
    jerk: Limit


@dataclass(frozen=True, eq=False)
class Tool:
    """A tool, whose root link is fixed to a link of the robot."""

    urdf: UrdfModel  # its links and joints
    link: str
    X_LT: Array  # Pose of its root link in `link`, shape (4, 4)
    file: Path | None  # the URDF that describes it; None for a tool of boxes


@dataclass(frozen=True)
class Fingers:
    """The fingers of a gripper: positions of their driven joints when open and when closed [rad or m].

    Both name the same joints. Joints that mimic them follow; between the two positions, all move in step.
    """

    open: Mapping[str, float]
    """By the joint's name."""
    closed: Mapping[str, float]
    """By the joint's name, with nothing between the fingers."""
    width: float | None = None
    """Clear width between them when open [m]; None where it is not stated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotTraits:
    """What of a robot is as the workspace states it."""

    tool_frame: str
    """The link of robot or tool that grasps; its z axis points out of the tool, into the object."""
    home: Mapping[str, float]
    """Position of each joint at the start of a program [rad or m]."""
    fingers: Fingers | None
    """Of the gripper; null if it has none that move."""
    markers: Mapping[str, Marker]
    """By link."""
    angle_tolerance: float
    """By how much the tool may be turned away from a pose, of an arm with fewer than six axes [rad]; else 0."""
    geometry: Geometry
    """The geometry of the links that is solid and opaque; a link without collision geometry uses its visual one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Robot(RobotTraits):
    """The robot of a cell; `home` is of the arm's joints, others rest at 0, or at the nearest limit."""

    urdf: UrdfModel  # its links and joints, without those of the tool
    srdf: Path | None  # resolved path
    package_roots: tuple[Path, ...]  # folders that `package://NAME/` is looked up in, first hit wins
    X_WB: Array  # pose of the robot's root link in the world, shape (4, 4)
    tool: Tool | None
    limits: Mapping[str, JointLimits[float]]
    """Of every movable joint of the URDF (with acceleration and jerk, which URDF cannot say)."""
    stop_limits: Mapping[str, JointLimits[float]]
    """Of the same joints while the robot stops to protect itself and others."""
    parts: tuple[Part, ...]  # that geometry, of the robot's links and then of the tool's
    disabled_pairs: frozenset[tuple[str, str]]
    """Pairs of links whose contact is not checked, each pair in alphabetical order."""

    def __post_init__(self) -> None:
        """Raises ValueError if `X_WB` or that of the tool is not a pose."""
        check_poses("the robot's base", self.X_WB)
        check_poses("the tool", None if self.tool is None else self.tool.X_LT)

    @property
    def urdfs(self) -> tuple[UrdfModel, ...]:
        """The robot's description, and its tool's if it has one."""
        return (self.urdf,) if self.tool is None else (self.urdf, self.tool.urdf)

    @property
    def rest(self) -> Mapping[str, float]:
        """Position of joints while nothing moves them [rad or m]: the arm's at home, the fingers' when open."""
        return {**self.home, **(self.fingers.open if self.fingers else {})}


class ToolBoxEntry(Entry):
    """A box of a tool."""

    size: Extents = Field(description="Full extents along its own axes.")
    pose: Pose = Field(default=Pose(), description="Pose of its centre in the tool's root link.")


class ToolEntry(Entry):
    """A tool that is fixed to the robot: a URDF, boxes, or just the frame that grasps, between fingers of the robot."""

    urdf: DescriptionEntry | None = None
    """The tool's own URDF or xacro; relative to this file, or package://."""
    boxes: list[ToolBoxEntry] | None = Field(default=None, min_length=1, max_length=100)
    """Boxes that enclose the tool, instead of a URDF."""
    frame: Pose | None = None
    """The frame that grasps, as a pose in the tool's root link or, without URDF and boxes, from `pose` on; its z
    axis points out of the tool. It is the tool frame, called `tool_tip`. A tool without a URDF must have one."""
    link: Text = Field(description="The link of the robot that carries the tool's root link.")
    pose: Pose = Field(default=Pose(), description="Pose of the tool's root link in that link.")
    prefix: str = Field(default="", max_length=100)
    """Put before the names of the tool's links and joints, for a robot that has links or joints of the same names. The
    workspace calls them by the longer names."""

    @model_validator(mode="after")
    def _one_description(self) -> ToolEntry:
        if self.urdf is not None and self.boxes is not None:
            raise PydanticCustomError("ambiguous-entry", "expected only one of the keys `urdf`, `boxes`")
        if self.urdf is None and self.frame is None:
            raise PydanticCustomError("conflicting-keys", "a tool without `urdf` needs `frame`, where it grasps")
        return self


ANGLE_TOLERANCE = math.radians(0.5)
"""Of an arm with fewer than six axes, unless the workspace states another: URDFs round right angles to 1.57 or 3.14."""
MOST_TOLERANCE = math.radians(10)  # largest tolerance that may be stated
AXES_OF_A_POSE = 6  # an arm with this many axes takes any pose within its reach, exactly
PositionsEntry = MappingOr[dict[str, AnyQuantity], Text]
"""Positions of joints by name, or the name of a state of the SRDF that has them."""


class FingersEntry(Entry):
    """The fingers of a gripper: closed by `grasp` until they touch the object, opened by `release`."""

    open: PositionsEntry
    """Position of each joint that drives the fingers when they are open, or the name of a state of the SRDF. Joints
    that mimic them follow."""
    closed: PositionsEntry = Field(description="The same when they are closed with nothing between them.")
    width: Size | None = None
    """Clear width between open fingers, for skills that open them by a width."""


LIMITS = {
    "velocity": (units.ANGULAR_SPEED, units.SPEED, 1.0),
    "acceleration": (units.ANGULAR_ACCELERATION, units.ACCELERATION, 5.0),
    "jerk": (units.ANGULAR_JERK, units.JERK, 50.0),
}
"""Limits of joints: the dimension for one that turns and for one that slides, and what is assumed where neither the
workspace nor the URDF states one, in rad (or m) and s."""


PerJoint = MappingOr[dict[str, AnyQuantity], AnyQuantity]  # a limit of joints by name, or of all of them
Factor = Annotated[float, In(None, 1e-3, 1.0)]


class LimitsEntry(Entry):
    """Limits of the joints: one value for all of them, or one for each joint by name.

    What is stated here goes before what a file of MoveIt says.
    """

    moveit: Text | None = None
    """A joint_limits.yaml of MoveIt: its velocities, accelerations and jerks, with its default scaling factors;
    position limits where they are narrower than the URDF's."""
    velocity_scaling: Factor | None = None
    """Of velocities of that file and the URDF; default: as the file says, else 1."""
    acceleration_scaling: Factor | None = None
    """Of accelerations of that file; default: as the file says, else 1."""
    velocity: PerJoint | None = Field(default=None, description="Default: the URDF's.")
    acceleration: PerJoint | None = None
    """Default: 5 rad/s^2 or m/s^2."""
    jerk: PerJoint | None = Field(default=None, description="Default: 50 rad/s^3 or m/s^3.")
    stop_acceleration: PerJoint | None = None
    """Of a stop because nobody watches any more. Default, and least: as of every motion."""
    stop_jerk: PerJoint | None = None
    """Of such a stop. Default, and least: as of every motion."""

    @model_validator(mode="after")
    def _scaling_of_moveit(self) -> LimitsEntry:
        if self.moveit is None and (self.velocity_scaling or self.acceleration_scaling):
            raise PydanticCustomError("conflicting-keys", "scaling has a meaning only together with `moveit`")
        return self


class RobotEntry(Entry):
    """The robot, its tool and where it stands."""

    urdf: DescriptionEntry | None = None
    """The robot's URDF or xacro; relative to this file, or package://."""
    mjcf: Text | None = Field(default=None, description="Its MJCF, a file of MuJoCo, instead of a URDF.")
    srdf: DescriptionEntry | None = None
    """Its SRDF, also as xacro: named states and collision pairs that need no check."""
    package_roots: list[Text] = Field(default=[], description="Folders in which package://NAME/ is looked up first.")
    base: Pose = Field(default=Pose(), description="Pose of the robot's root link in the world.")
    tool: ToolEntry | None = Field(default=None, description="A tool on the robot, with a URDF of its own.")
    tool_frame: Text | None = None
    """The link that grasps; its z axis points out of the tool, into the object. A tool of boxes has its own."""
    home: PositionsEntry
    """Position of every joint of the arm by its name, or the name of a state of the SRDF."""
    fingers: FingersEntry | None = Field(default=None, description="The fingers of its gripper, if they move.")
    markers: dict[str, Marker] = Field(default={}, description="ArUco markers on links, by the link's name.")
    limits: LimitsEntry = Field(default=LimitsEntry(), description="Limits of velocity, acceleration and jerk.")
    angle_tolerance: Annotated[float, In(units.ANGLE, 0.0, MOST_TOLERANCE)] | None = None
    """By how much the tool may be turned away from a pose where joints or their limits do not allow it. Default: 0.5
    deg for an arm of fewer than six axes, else 0."""
    geometry: Geometry = Field(default="collision", description="Which geometry of the links is solid and opaque.")

    @model_validator(mode="after")
    def _one_file_and_tool_frame(self) -> RobotEntry:
        if (self.urdf is None) == (self.mjcf is None):
            code, found = ("missing-key", "neither") if self.urdf is None else ("ambiguous-entry", "both; keep one")
            raise PydanticCustomError(code, "expected `urdf` or `mjcf`, found {found}", {"found": found})
        if self.tool is not None and self.tool.frame is not None and self.tool_frame is not None:
            raise refused("conflicting-keys", "`tool_frame` and `tool.frame` both say what grasps; keep one")
        return self
