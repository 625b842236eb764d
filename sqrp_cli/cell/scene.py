"""The objects of a cell, their entries in a workspace file, and the markers on them.

A marker has a white margin at least as wide as one of its modules. An object with a marker has it in the middle of its
top (+z), black square and margin together as large as fits there unless the workspace states the black square.
"""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Discriminator, Field, PlainValidator, Tag, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.camera.markers import Marker, ObjectMarker, StatedMarker
from sqrp_cli.files.entries import (
    Angle,
    DescriptionEntry,
    Distance,
    Entry,
    Extents,
    FileRecord,
    Name,
    Pose,
    Scale,
    SerializedAs,
    Size,
    Text,
    refused,
)
from sqrp_cli.files.source import describe
from sqrp_cli.files.units import SMALLEST_SIZE
from sqrp_cli.geometry import Array, check_finite, check_poses, grasp_pose, inverse, pose, read_only
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import FIGURES, Box, Convex, Part, Sphere, shape_of

NO_SIZE = (0.0, 0.0, 0.0)  # the size of an object that is as large as its parts
FLOOR_DEPTH = 0.7  # of the floor below the lowest fixed object: the height of a table [m]
MOST_TURNS = 64  # most turns of a stated symmetry


def _symmetry(value: object) -> int | Literal["round"]:
    if value == "round":
        return "round"
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_TURNS:
        return value
    expected = f"a whole number from 1 to {MOST_TURNS}, or `round`"
    raise refused("wrong-value", f"found {describe(value)}, expected {expected}")


Symmetry = Annotated[
    int | Literal["round"],
    PlainValidator(_symmetry),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 1, "maximum": MOST_TURNS}, {"const": "round"}]}),
]
"""Into how many equal turns about an axis something looks the same, or `round`: any turn."""
BoxSide = Literal["+x", "-x", "+y", "-y", "+z", "-z"]  # a side of a box, by its outward axis


@dataclass(frozen=True, kw_only=True)
class Held(FileRecord):
    """In the tool from the beginning: the tool frame in the centre of one side, as in a waypoint of a skill."""

    held: BoxSide
    """Outward axis of the side it is held by."""
    yaw: Angle = 0.0
    """Turn of the tool about its z axis."""
    depth: Distance = 0.0
    """How far the tool frame goes into the object, between fingers."""
    beside: Distance | None = None
    """The gap to a jaw that stands still, on whose face the tool frame lies; if left out, it is in the middle."""

    def X_TO(self, size: tuple[float, float, float]) -> Array:
        """The pose in the tool frame of an object of a size [m], shape (4, 4), as in `skill.GraspWaypoint`."""
        return read_only(inverse(grasp_pose(size, self.held, self.yaw, self.depth, self.beside)))


_StatedPose = Annotated[
    Annotated[Pose, Tag("<mapping>")] | Annotated[Held, Tag("<held>")] | Annotated[Literal["unknown"], Tag("<else>")],
    Discriminator(
        lambda data: (
            "<else>"
            if not isinstance(data, dict)
            else "<held>"
            if data.keys() & {"held", "yaw", "depth"}
            else "<mapping>"
        )
    ),
]
_Placement = SerializedAs(
    _StatedPose,
    lambda stated: (
        read_only(stated.matrix()) if isinstance(stated, Pose) else stated if isinstance(stated, Held) else None
    ),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ObjectTraits(FileRecord):
    """The properties of an object, taken unchanged from the workspace file."""

    type: Name
    """A type of the skills or any other noun, such as `cube`. Besides, every object is a `fixture` or a `movable`, by
    `fixed`."""
    color: Text | None = None
    """What a task calls it, and what detectors of colours look for."""
    attributes: Annotated[tuple[Name, ...], Field(description="Further words that a task may use for it.")] = ()
    size: Annotated[Extents, Field(description="Full extents of the box around it, along its own axes.")]
    pose: Annotated[Array | Held | None, _Placement]
    """Pose of the centre of that box in the world, `{held: SIDE}` in the tool, or `unknown`."""
    fixed: Annotated[bool, Field(description="Whether it never moves.")] = False
    on: Annotated[Name | None, Field(description="The object that it stands on.")] = None
    symmetry: Symmetry | None = None
    """How often it looks the same in a full turn about its z axis: 1, 2, 4, ... or `round`; by default as its shape
    does."""
    marker: Annotated[
        ObjectMarker | None,
        SerializedAs(
            StatedMarker | None, lambda stated: ObjectMarker(id=stated) if isinstance(stated, int) else stated
        ),
        Field(description="The marker on it: its id in `aruco_original`, or {id, dictionary, side}."),
    ] = None

    @property
    def types(self) -> tuple[str, ...]:
        """Its PDDL types: its own (PDDL knows lower case only), and `fixture` or `movable`."""
        return self.type.lower(), "fixture" if self.fixed else "movable"

    @property
    def X_WO(self) -> Array | None:
        """The pose of the centre of its box in the world, shape (4, 4); None in the tool or while it is unknown."""
        return None if isinstance(self.pose, Held) else self.pose

    @property
    def X_TO(self) -> Array | None:
        """The same in the tool frame, if the tool holds it at the beginning."""
        return self.pose.X_TO(self.size) if isinstance(self.pose, Held) else None

    @property
    def printed_marker(self) -> Marker | None:
        """The marker on it, with its side; None if there is none."""
        return None if self.marker is None else self.marker.on(self.size)


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneObject(ObjectTraits):
    """An object of the cell."""

    name: str
    parts: tuple[Part, ...]
    """Its solid pieces, in its own frame; a plain box of `size` unless the workspace says otherwise."""
    X_FO: Array = field(default_factory=lambda: read_only(pose()))
    """Its own frame, the middle of its box, in the frame whose pose the workspace states, shape (4, 4)."""

    def __post_init__(self) -> None:
        """Raises ValueError for an invalid pose and for a size that is not finite."""
        check_poses(f"object `{self.name}`", self.X_WO, self.X_TO)
        check_finite(f"object `{self.name}`", self.size)


class RoundEntry(Entry):
    """Radius and length along z of a cylinder or capsule (its straight part)."""

    radius: Size
    length: Size


class PartEntry(Entry):
    """A solid piece of an object: a box (full extents), sphere (radius), cylinder, capsule or mesh."""

    name: Name | None = Field(default=None, description="What output calls it; default: the object and a number.")
    box: Extents | None = Field(default=None, description="Full extents.")
    sphere: Size | None = Field(default=None, description="Its radius.")
    cylinder: RoundEntry | None = Field(default=None, description="About its z axis.")
    capsule: RoundEntry | None = None
    """About its z axis; the length is of the straight part."""
    mesh: Text | None = None
    """STL, OBJ or DAE file; relative to this file, or package://. The unit of a DAE counts."""
    scale: Scale = Field(default=(1.0, 1.0, 1.0), description="Scale of the mesh, one for all axes or one for each.")
    pose: Pose = Field(default=Pose(), description="Pose of the piece in the object's frame.")

    @model_validator(mode="after")
    def _one_shape(self) -> PartEntry:
        self.check_only_one(*FIGURES, "mesh")
        if min(map(abs, self.scale)) < SMALLEST_SIZE:
            raise PydanticCustomError("wrong-value", "`scale` has a zero, which would flatten the mesh")
        return self

    def shape(self) -> Convex | None:
        """Its shape; None for a mesh."""
        round_one = self.cylinder or self.capsule
        if round_one is not None:
            return shape_of("cylinder" if self.cylinder else "capsule", (round_one.radius, round_one.length))
        return Box(self.box) if self.box is not None else None if self.sphere is None else Sphere(self.sphere)


@dataclass(frozen=True, eq=False, kw_only=True)
class ObjectEntry(ObjectTraits):
    """An object in the cell.

    Without `size`, the size is that of its parts or its URDF, and `pose` is the pose of their frame.
    """

    size: Annotated[Extents, Field(json_schema_extra=lambda schema: schema.pop("default", None))] = NO_SIZE
    """Full extents of the box around it, along its own axes; default: those of its parts."""
    parts: tuple[PartEntry, ...] = ()
    """Its solid pieces; default: the box."""
    urdf: DescriptionEntry | None = None
    """A URDF or xacro with its solid pieces, joints at 0; relative to this file, or package://."""
