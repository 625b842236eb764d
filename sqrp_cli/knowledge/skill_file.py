"""The format of skill.yaml. `read_skill` turns it into the records of `skill`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer, Tag, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.knowledge.bounds import LARGEST, SHORTEST_DIRECTION
from sqrp_cli.knowledge.entries import (
    Direction,
    Entry,
    Extents,
    Length,
    Name,
    Pose,
    Text,
    Time,
    mapping_or_else,
    one_of,
    refused,
)
from sqrp_cli.knowledge.skill import Reference
from sqrp_cli.knowledge.source import describe
from sqrp_cli.knowledge.units import Quantity, read_quantity

MAX_VALUES = 1000
"""Most values of one motion parameter."""


def _value(value: object) -> Quantity | str:
    read = read_quantity(value)
    if read is not None and abs(read.value) <= LARGEST:
        return read
    if read is not None:
        raise refused("wrong-value", f"found {describe(value)}, expected a number of at most {LARGEST:g} in size")
    if isinstance(value, str) and value and not any(character.isspace() for character in value):
        return value
    expected = "a number, a number with a unit such as `5 cm`, or a word"
    raise refused("wrong-unit", f"found {describe(value)}, expected {expected}")


def _setting(value: object) -> Quantity | str | Reference:
    if isinstance(value, str) and value.startswith("$"):
        return Reference(value[1:])
    return _value(value)


_ANY = {"anyOf": [{"type": "number", "minimum": -LARGEST, "maximum": LARGEST}, {"type": "string"}]}
Value = Annotated[Any, BeforeValidator(_value), PlainSerializer(str), WithJsonSchema(_ANY)]
"""A quantity or a word; its dimension is checked against what the parameter is used for."""
SettingEntry = Annotated[
    Any,
    BeforeValidator(_setting),
    PlainSerializer(str),
    WithJsonSchema({**_ANY, "description": "A number with its unit, a word, or $PARAMETER."}),
]
"""A value, or a reference to a motion parameter."""


class ListedValues(Entry):
    """The values that candidates try, in order; the first is the default."""

    values: list[Value] = Field(min_length=1, max_length=MAX_VALUES, description="Numbers with their units, or words.")


class ValueRange(Entry):
    """Values spread evenly from one bound to the other, both included."""

    start: Value = Field(alias="from", description="The first.")
    to: Value = Field(description="The last.")
    count: Annotated[int, Field(strict=True, ge=2, le=MAX_VALUES, description="How many.")]


MotionEntry = Annotated[
    Annotated[
        Annotated[ListedValues, Tag("<values>")] | Annotated[ValueRange, Tag("<from>")],
        one_of("values", "from"),
        Tag("<mapping>"),
    ]
    | Annotated[Value, Tag("<else>")],
    mapping_or_else(),
]


class GraspWaypointEntry(Entry):
    """The tool at the centre of one side of an object, pointing into it."""

    object: Name = Field(description="The skill parameter that names the object.")
    side: SettingEntry = Field(description="Outward axis of that side: +x, -x, +y, -y, +z or -z.")
    yaw: SettingEntry = Field(default=Quantity(0.0, None), description="Turn of the tool about its z axis.")
    depth: SettingEntry = Field(
        default=Quantity(0.0, None), description="How far the tool frame goes into the object, between fingers."
    )


class PutWaypointEntry(Entry):
    """The held object standing upright on top of another object."""

    put: Name = Field(description="The skill parameter that names the held object.")
    onto: Name = Field(description="The skill parameter that names what it is put on.")
    along: SettingEntry = Field(
        default=Quantity(0.0, None), description="Where along its x axis: 0 in the middle, -1 and 1 at the edges."
    )
    across: SettingEntry = Field(default=Quantity(0.0, None), description="Where along its y axis, likewise.")
    yaw: SettingEntry = Field(default=Quantity(0.0, None), description="Turn against what it is put on.")


Origin = Annotated[Name, Field(alias="from", description="The other waypoint.")]


class TurnWaypointEntry(Entry):
    """Another waypoint, turned about the tool's axes."""

    origin: Origin
    turn: SettingEntry = Field(description="Turn about the tool's z axis.")
    tilt: SettingEntry = Field(default=Quantity(0.0, None), description="Turn about the tool's x axis after that.")


class RetreatWaypointEntry(Entry):
    """Another waypoint, moved back against the tool's z axis."""

    origin: Origin
    retreat: SettingEntry = Field(description="By how much.")


class RaiseWaypointEntry(Entry):
    """Another waypoint, moved up along the world's z axis."""

    origin: Origin
    lift: SettingEntry = Field(alias="raise", description="By how much.")


class PoseWaypointEntry(Entry):
    """The tool frame at a fixed pose in the world."""

    pose: Pose = Field(description="Of the tool frame in the world.")


WaypointEntry = Annotated[
    Annotated[GraspWaypointEntry, Tag("<object>")]
    | Annotated[PutWaypointEntry, Tag("<put>")]
    | Annotated[RetreatWaypointEntry, Tag("<retreat>")]
    | Annotated[RaiseWaypointEntry, Tag("<raise>")]
    | Annotated[TurnWaypointEntry, Tag("<turn>")]
    | Annotated[PoseWaypointEntry, Tag("<pose>")],
    one_of("object", "put", "retreat", "raise", "turn", "pose"),
]


PrimitiveName = Annotated[Name, Field(description="What formulas call it, as in `a1.start`.")]


class JointMoveEntry(Entry):
    """All joints move together to a waypoint."""

    name: PrimitiveName
    joint_move: Name = Field(description="The waypoint to go to; `home` is the robot's home configuration.")
    speed: SettingEntry = Field(default=Quantity(1.0, None), description="Share of the joints' velocity limits.")
    elbow: SettingEntry = Field(default="any", description="How the arm is bent at the end: up, down or any.")
    shoulder: SettingEntry = Field(default="any", description="On which side the shoulder is: left, right or any.")
    wrist: SettingEntry = Field(default="any", description="no_flip: bent as at home; flip or any.")
    via: SettingEntry = Field(default="direct", description="direct, or home: with a stop at home on the way.")


class StraightMoveEntry(Entry):
    """The tool moves to a waypoint on a straight line."""

    name: PrimitiveName
    straight_move: Name = Field(description="The waypoint to go to.")
    speed: SettingEntry = Field(description="Speed of the tool, such as 5 cm/s.")
    acceleration: SettingEntry = Field(default=Quantity(0.5, None), description="Acceleration of the tool [m/s^2].")
    jerk: SettingEntry = Field(default=Quantity(5.0, None), description="Jerk of the tool [m/s^3].")


class GraspEntry(Entry):
    """The tool takes hold of an object, at the end of `duration`."""

    name: PrimitiveName
    grasp: Name = Field(description="The skill parameter that names the object.")
    duration: SettingEntry = Field(description="How long that takes.")


class ReleaseEntry(Entry):
    """The tool lets go of what it holds, at the end of the duration."""

    name: PrimitiveName
    release: SettingEntry = Field(description="The duration.")


class WaitEntry(Entry):
    """The robot stands still."""

    name: PrimitiveName
    wait: SettingEntry = Field(description="The duration.")


PrimitiveEntry = Annotated[
    Annotated[JointMoveEntry, Tag("<joint_move>")]
    | Annotated[StraightMoveEntry, Tag("<straight_move>")]
    | Annotated[GraspEntry, Tag("<grasp>")]
    | Annotated[ReleaseEntry, Tag("<release>")]
    | Annotated[WaitEntry, Tag("<wait>")],
    one_of("joint_move", "straight_move", "grasp", "release", "wait"),
]


class RetryEntry(Entry):
    """Try the skill again."""

    retry: Annotated[int, Field(strict=True, ge=1, le=100)] = Field(description="How often at most.")
    when: Text | None = Field(default=None, description="What must be seen before a retry starts, as a formula.")


ResponseEntry = Annotated[
    Annotated[RetryEntry, Tag("<mapping>")] | Annotated[Literal["stop", "continue"], Tag("<else>")], mapping_or_else()
]


class FormulaEntry(Entry):
    """An MTL formula with the response to its violation."""

    formula: Text = Field(description="Such as always[a1.start, a2.end] (not hold and obj_on_table).")
    response: ResponseEntry = Field(default="stop", description="stop, continue, or {retry: N, when: FORMULA}.")
    settle: Time = Field(default=0.5, description="Time that a literal may lag behind its expected change.")


FormulaOrText = Annotated[Annotated[FormulaEntry, Tag("<mapping>")] | Annotated[Text, Tag("<else>")], mapping_or_else()]


class BoxEntry(Entry):
    """A box of a target: where to look for what."""

    name: Name = Field(description="What output calls it.")
    frame: Text = Field(
        description="`world`, a link, `tool`, a skill parameter or object (moves with it), or either of them with "
        "`@start` (where it was when the skill began)."
    )
    fits: Name | None = Field(default=None, description="The skill parameter or object that gives the box its size.")
    at: Name | None = Field(default=None, description="With `fits`: the waypoint at which it is held.")
    margin: Length = Field(default=0.0, description="With `fits`: enlargement on every side.")
    size: Extents | None = Field(default=None, description="Full extents, instead of `fits`.")
    pose: Pose = Field(default=Pose(), description="Pose of the box in the frame.")
    detector: Name = Field(description="The detector of the workspace that looks for it.")
    normal: Direction | None = Field(
        default=None, description="Direction away from the surface that it lies on (markers)."
    )
    encloses: list[Text] | None = Field(
        default=None,
        description="Links, objects, skill parameters or `tool` that it encloses; default: the object of its frame.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> BoxEntry:
        if (self.fits is None) == (self.size is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `fits`, `size`")
        if self.fits is None and (self.at is not None or self.margin):
            raise PydanticCustomError("conflicting-keys", "`at` and `margin` go with `fits`, not with `size`")
        if self.at is None and self.fits is not None and self.frame == "tool":
            raise PydanticCustomError("conflicting-keys", "`at` is needed with `fits` in frame `tool`")
        if self.normal is not None and max(map(abs, self.normal)) < SHORTEST_DIRECTION:
            raise PydanticCustomError("wrong-value", "`normal` has length 0")
        if self.size is not None and min(self.size) < 0.002 and self.normal is None:
            raise PydanticCustomError("missing-key", "a box with a side under 2 mm needs a `normal`")
        return self


class TargetEntry(Entry):
    """What decides a predicate."""

    cameras: Annotated[int, Field(strict=True, ge=1, le=200)] = Field(
        default=1, description="How many cameras must each see all boxes."
    )
    boxes: list[BoxEntry] = Field(min_length=1, max_length=20, description="All of them decide it together.")


MOST_ENTRIES = 200
"""Of a kind in a skill."""


class SkillFile(Entry):
    """How a skill moves, and what the cameras must see while it does."""

    motion: dict[Name, MotionEntry] = Field(
        default={}, max_length=MOST_ENTRIES, description="Parameters of the motion with the values to try."
    )
    waypoints: dict[Name, WaypointEntry] = Field(
        default={}, max_length=MOST_ENTRIES, description="Poses of the tool frame."
    )
    primitives: list[PrimitiveEntry] = Field(
        min_length=1, max_length=100, description="What the robot does, one after the other."
    )
    formulas: list[FormulaOrText] = Field(
        default=[], max_length=MOST_ENTRIES, description="What must hold while all goes well."
    )
    faults: dict[Name, FormulaEntry] = Field(default={}, max_length=MOST_ENTRIES, description="What may go wrong.")
    targets: dict[Name, TargetEntry] = Field(
        default={}, max_length=MOST_ENTRIES, description="What decides each predicate, and where to look."
    )
