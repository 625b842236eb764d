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
    """A tool, whose root link is fixed to a link of the robot.

    model: its links and joints. X_LT: pose of its root link in `link`, shape (4, 4). urdf: the file that describes it,
    None for a tool of boxes.
    """

    model: UrdfModel
    link: str
    X_LT: Array
    urdf: Path | None

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
    """The robot of a cell.

    urdf, srdf: resolved paths. package_roots: folders that `package://NAME/` is looked up in, first hit wins.
    X_WB: pose of the robot's root link in the world, shape (4, 4).
    tool_frame: the link of robot or tool that grasps: its z axis points out of the tool, into the object.
    home: position of each arm joint at the start of a program [rad or m]. Other joints rest at 0, or at the nearest
    limit.
    limits: of every movable joint of the URDF (with acceleration and jerk, which URDF cannot say).
    stop_limits: of the same joints while the robot stops to protect itself and others.
    geometry: which geometry of the links is solid and opaque; a link without collision geometry uses its visual one.
    parts: that geometry, of the robot's links and then of the tool's.
    disabled_pairs: pairs of links whose contact is not checked, each pair in alphabetical order.
    fingers: of its gripper, None if it has none that move. markers: on links, by the link's name.
    """

    urdf: Path
    srdf: Path | None
    package_roots: tuple[Path, ...]
    X_WB: Array
    tool: Tool | None
    tool_frame: str
    home: Mapping[str, float]
    limits: Mapping[str, JointLimits]
    stop_limits: Mapping[str, StopLimits]
    geometry: Geometry
    parts: tuple[Part, ...]
    disabled_pairs: frozenset[tuple[str, str]]
    fingers: Fingers | None = None
    markers: Mapping[str, Marker] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises ValueError if `X_WB` is no pose."""
        check_poses("the robot's base", self.X_WB)
