"""The robot of a cell, as files and settings; `programming.kinematics` makes a moving model of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sqrp_cli.geometry import Array, check_poses
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.shapes import Geometry, Part


@dataclass(frozen=True)
class JointLimits:
    """Limits of one joint in rad (or m for a prismatic joint) and seconds; position limits may be infinite."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float


@dataclass(frozen=True)
class StopLimits:
    """Limits of one joint during a protective stop, in rad (or m for a prismatic joint) and seconds."""

    acceleration: float
    jerk: float


@dataclass(frozen=True, eq=False)
class Tool:
    """A tool, whose root link is fixed to a link of the robot."""

    urdf: UrdfModel
    """Its links and joints."""
    link: str
    X_LT: Array
    """Pose of its root link in `link`, shape (4, 4)."""
    file: Path | None
    """The URDF that describes it; None for a tool of boxes."""

    def __post_init__(self) -> None:
        """Raises ValueError if `X_LT` is no pose."""
        check_poses("the tool", self.X_LT)


@dataclass(frozen=True)
class Fingers:
    """The fingers of a gripper: where the joints that drive them are when it is open and when it is closed [rad or m].

    Both name the same joints. Joints that mimic them follow; on the way between the two, all move in step.
    """

    open: Mapping[str, float]
    closed: Mapping[str, float]


@dataclass(frozen=True)
class Marker:
    """An ArUco marker on a link: square, around the origin of the link's frame, facing along its z axis; side [m]."""

    id: int
    side: float


@dataclass(frozen=True, eq=False)
class Robot:
    """The robot of a cell."""

    urdf: UrdfModel
    """Its links and joints, without those of the tool."""
    srdf: Path | None
    """Resolved path."""
    package_roots: tuple[Path, ...]
    """Folders that `package://NAME/` is looked up in, first hit wins."""
    X_WB: Array
    """Pose of the robot's root link in the world, shape (4, 4)."""
    tool: Tool | None
    tool_frame: str
    """The link of robot or tool that grasps: its z axis points out of the tool, into the object."""
    home: Mapping[str, float]
    """Position of each arm joint at the start of a program [rad or m]; other joints rest at 0, or at the nearest
    limit."""
    limits: Mapping[str, JointLimits]
    """Of every movable joint of the URDF (with acceleration and jerk, which URDF cannot say)."""
    stop_limits: Mapping[str, StopLimits]
    """Of the same joints while the robot stops to protect itself and others."""
    geometry: Geometry
    """Which geometry of the links is solid and opaque; a link without collision geometry uses its visual one."""
    parts: tuple[Part, ...]
    """That geometry, of the robot's links and then of the tool's."""
    disabled_pairs: frozenset[tuple[str, str]]
    """Pairs of links whose contact is not checked, each pair in alphabetical order."""
    fingers: Fingers | None = None
    """Of its gripper; None if it has none that move."""
    markers: Mapping[str, Marker] = field(default_factory=dict)
    """On links, by the link's name."""

    def __post_init__(self) -> None:
        """Raises ValueError if `X_WB` is no pose."""
        check_poses("the robot's base", self.X_WB)

    @property
    def urdfs(self) -> tuple[UrdfModel, ...]:
        """The robot's description, and its tool's if it has one."""
        return (self.urdf,) if self.tool is None else (self.urdf, self.tool.urdf)

    @property
    def rest(self) -> Mapping[str, float]:
        """Position of joints while nothing moves them [rad or m]: the arm's at home, the fingers' when open."""
        return {**self.home, **(self.fingers.open if self.fingers else {})}
