"""A skill: its action (PDDL), how it moves, and what must be seen during the motion.

The models here, from `SkillFile` down, are both the format of skill.yaml and the records.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import field
from pathlib import Path
from string import digits
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field, StringConstraints, Tag, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.errors import Place, Problem
from sqrp_cli.files.entries import Entry, ListOr, MappingOr, Name, Pose, Text, Time, one_of
from sqrp_cli.files.frames import TOOL, WORLD
from sqrp_cli.files.source import KeyPath, dotted
from sqrp_cli.geometry import Array
from sqrp_cli.logic.domain import Action, Domain
from sqrp_cli.logic.formula import Formula
from sqrp_cli.records import dataclass
from sqrp_cli.skill import settings
from sqrp_cli.skill.settings import Kind, MotionParameter, MotionValue, MotionValues
from sqrp_cli.skill.target_box import TargetSpec

HOME = "home"  # the waypoint that every skill has: the robot's home configuration


@dataclass(frozen=True)
class Names:
    """Marks a field that names a part of the skill, or several in a list; also: further names that are allowed."""

    what: Literal["skill parameter", "waypoint", "frame"]
    also: tuple[str, ...] = ()


def marked(entry: Entry, path: KeyPath = ()) -> Iterator[tuple[KeyPath, object, Names | Kind]]:
    """The names and settings of an entry at `path`, also those in lists, each with its path and its field's mark."""
    for name, info in type(entry).model_fields.items():
        value, at = getattr(entry, name), (*path, info.alias or name)
        items = [((*at, index), item) for index, item in enumerate(value)] if isinstance(value, list) else [(at, value)]
        marks = [mark for mark in (*info.metadata, *marks_in(info.annotation)) if isinstance(mark, Names | Kind)]
        yield from ((key, item, mark) for key, item in items if item is not None for mark in marks)


def marks_in(annotation: object) -> Iterator[object]:
    """The marks in the type of a field, of the items of its list and of the members of its union."""
    yield from getattr(annotation, "__metadata__", ())
    for part in get_args(annotation):
        yield from marks_in(part)


ParameterName = Annotated[Name, Names("skill parameter")]
StaticFrame = Annotated[Text, Names("frame")]
Origin = Annotated[Name, Names("waypoint", (HOME,)), Field(alias="from", description="The other waypoint.")]


class GraspWaypoint(Entry):
    """The tool at the centre of one side of an object, pointing into it."""

    object: ParameterName = Field(description="The skill parameter that names the object.")
    side: settings.Side
    """Outward axis of that side: +x, -x, +y, -y, +z or -z; any: each that looks like +z to the tool."""
    yaw: settings.Yaw = 0.0
    """Turn of the tool about its z axis; at 0 its x axis lies along the object's x axis (y axis for the sides +x and
    -x). any: each at which the object looks the same to the tool."""
    depth: settings.Distance = 0.0
    """How far the tool frame goes into the object, between fingers."""
    beside: settings.Distance | None = None
    """The gap to a jaw that stands still, on whose face the tool frame lies; `grasp` pushes the object over it. If left
    out, the frame is in the middle of the object."""


class PutWaypoint(Entry):
    """The held object standing upright on top of another object."""

    object: ParameterName = Field(alias="put", description="The skill parameter that names the held object.")
    on: ParameterName = Field(alias="onto", description="The skill parameter that names what it is put on.")
    along: settings.OffsetShare = 0.0
    """Where along its x axis: 0 in the middle, -1 and 1 at the edges."""
    across: settings.OffsetShare = Field(default=0.0, description="Where along its y axis, likewise.")
    yaw: settings.Yaw = 0.0
    """Turn against what it is put on; any: each at which it looks the same."""


class TurnWaypoint(Entry):
    """Another waypoint, turned about the tool's axes."""

    waypoint: Origin
    turn: settings.Turn = Field(description="Turn about the tool's z axis.")
    tilt: settings.Turn = Field(default=0.0, description="Turn about the tool's x axis after that.")


class RetreatWaypoint(Entry):
    """Another waypoint, moved back against the tool's z axis."""

    waypoint: Origin
    distance: settings.Distance = Field(alias="retreat", description="By how much.")


class RaiseWaypoint(Entry):
    """Another waypoint, moved up along the world's z axis."""

    waypoint: Origin
    distance: settings.Distance = Field(alias="raise", description="By how much.")


class OffsetWaypoint(Entry):
    """Another waypoint, moved in any direction."""

    waypoint: Origin
    offset: Annotated[list[settings.Offset], Field(min_length=3, max_length=3, description="Along x, y and z.")]
    along: Annotated[Text, Names("frame", (TOOL,))] = TOOL
    """Whose axes these are: `tool` (of the other waypoint), `world`, a skill parameter or an object."""


class PoseWaypoint(Entry):
    """The tool frame, or a held object, at a pose in the world or relative to an object."""

    pose: Pose = Field(description="Of the tool frame, or of the object in `of`, in the frame.")
    frame: StaticFrame = Field(default=WORLD, description="`world`, a skill parameter or an object.")
    of: ParameterName | None = None
    """The skill parameter that names the held object whose pose it is, not the tool's."""


Waypoint = Annotated[
    Annotated[GraspWaypoint, Tag("<object>")]
    | Annotated[PutWaypoint, Tag("<put>")]
    | Annotated[RetreatWaypoint, Tag("<retreat>")]
    | Annotated[RaiseWaypoint, Tag("<raise>")]
    | Annotated[TurnWaypoint, Tag("<turn>")]
    | Annotated[OffsetWaypoint, Tag("<offset>")]
    | Annotated[PoseWaypoint, Tag("<pose>")],
    one_of("object", "put", "retreat", "raise", "turn", "offset", "pose"),
]


class Primitive(Entry):
    """What all primitive actions have in common."""

    name: Name = Field(description="What formulas call it, as in `a1.start`.")
    does: Annotated[str, StringConstraints(min_length=1, max_length=40)] | None = None
    """What it does, in a word or two for people, such as `lift`; by default its kind."""
    _kind: ClassVar[str]
    """What actions of its kind do."""

    @property
    def words(self) -> str:
        """What it does, in a word or two."""
        return self.does or self._kind.format(self)


class JointMove(Primitive):
    """All joints move together to a waypoint."""

    _kind = "to {0.to}"
    to: Annotated[Name, Names("waypoint", (HOME,))] = Field(
        alias="joint_move", description="The waypoint to go to; `home` is the robot's home configuration."
    )
    speed: settings.SpeedShare = Field(default=1.0, description="Share of the joints' velocity limits.")
    elbow: settings.Elbow = "any"
    """How the arm is bent at the end: up, down, any (each is tried) or fastest."""
    shoulder: settings.Shoulder = "any"
    """On which side the shoulder is: left, right, any or fastest."""
    wrist: settings.Wrist = Field(default="any", description="no_flip: bent as at home; flip, any or fastest.")
    via: settings.Via = Field(default="direct", description="direct, home: with a stop at home on the way; or any.")
    path: settings.Path = Field(default="$path", validate_default=True)
    """direct: straight in joint space; seen: where the cameras lose least; any: the better. By default as a task says,
    `path=seen`, and else direct."""


class ToolMove(Primitive):
    """What moves of the tool along a curve have in common."""

    speed: settings.Speed = Field(description="Speed of the tool, such as 5 cm/s.")
    acceleration: settings.Acceleration = Field(default=0.5, description="Acceleration of the tool [m/s^2].")
    jerk: settings.Jerk = Field(default=5.0, description="Jerk of the tool [m/s^3].")
    turn_speed: settings.TurnSpeed | None = None
    """How fast the tool may turn, such as 90 deg/s; by default as fast as the joints can."""
    touching: list[ParameterName] = Field(default=[], max_length=20)
    """Skill parameters of the objects that tool and held object may touch from here to the next joint move."""


WaypointName = Annotated[Name, Names("waypoint")]


class StraightMove(ToolMove):
    """The tool moves to a waypoint on a straight line, or through several, with a stop at each."""

    _kind = "straight"
    to: ListOr[Annotated[list[WaypointName], Field(min_length=1, max_length=100)], WaypointName] = Field(
        alias="straight_move", description="The waypoint to go to, or a list of them."
    )
    until_contact: ParameterName | None = None
    """The skill parameter of an object: the move ends where tool or held object touch it, at the waypoint if they do
    not."""
    force: settings.Force = Field(default=5.0, description="With `until_contact`: what counts as contact [N].")

    @model_validator(mode="after")
    def _one_guarded_line(self) -> StraightMove:
        if self.until_contact is not None and len(self.waypoints) > 1:
            raise PydanticCustomError("conflicting-keys", "`until_contact` goes with one waypoint, not with a list")
        return self

    @property
    def waypoints(self) -> tuple[str, ...]:
        """Where it goes, in order."""
        return tuple(self.to) if isinstance(self.to, list) else (self.to,)


class ArcMove(ToolMove):
    """The tool moves on an arc of a circle; it turns evenly from its present orientation to that at the end."""

    _kind = "arc"
    to: Annotated[list[WaypointName], Field(min_length=2, max_length=2)] = Field(
        alias="arc", description="The waypoint through which it goes, and the one where it ends."
    )


class HelixMove(ToolMove):
    """The tool moves about the z axis of a waypoint and along it: a screw, or a circle."""

    _kind = "helix"
    axis: WaypointName = Field(alias="helix", description="The waypoint whose z axis it goes about.")
    turn: settings.Turns = Field(description="By how much, right-handed; also several turns.")
    advance: settings.Offset = Field(default=0.0, description="How far it goes along that axis meanwhile.")
    keep_orientation: Annotated[bool, Field(strict=True)] = False
    """Whether the tool does not turn while it goes round."""


class FingerMove(Primitive):
    """The fingers move to a width between them, and the tool stands still; not while it holds something."""

    _kind = "fingers"
    width: settings.Distance = Field(alias="fingers", description="Clear width between them.")
    duration: settings.Duration = Field(default=0.5, description="How long that takes at least.")


class Grasp(Primitive):
    """The tool takes hold of an object, at the end of `duration`."""

    _kind = "grasp"
    duration: settings.Duration = Field(description="How long that takes.")
    object: ParameterName = Field(alias="grasp", description="The skill parameter that names the object.")


class Release(Primitive):
    """The tool lets go of what it holds, at the end of the duration."""

    _kind = "let go"
    duration: settings.Duration = Field(alias="release", description="The duration.")
    width: settings.Distance | None = None
    """Clear width to which fingers open; by default as far as they do."""


class Wait(Primitive):
    """The robot stands still."""

    _kind = "wait"
    duration: settings.Duration = Field(alias="wait", description="The duration.")


PrimitiveAction = Annotated[
    Annotated[JointMove, Tag("<joint_move>")]
    | Annotated[StraightMove, Tag("<straight_move>")]
    | Annotated[ArcMove, Tag("<arc>")]
    | Annotated[HelixMove, Tag("<helix>")]
    | Annotated[FingerMove, Tag("<fingers>")]
    | Annotated[Grasp, Tag("<grasp>")]
    | Annotated[Release, Tag("<release>")]
    | Annotated[Wait, Tag("<wait>")],
    one_of("joint_move", "straight_move", "arc", "helix", "fingers", "grasp", "release", "wait"),
]


class RetryEntry(Entry):
    """Try the skill again."""

    retry: Annotated[int, Field(strict=True, ge=1, le=100)] = Field(description="How often at most.")
    when: Text | None = Field(default=None, description="What must be seen before a retry starts, as a formula.")


ResponseEntry = MappingOr[RetryEntry, Literal["stop", "continue"]]


class FormulaEntry(Entry):
    """An MTL formula with the response to its violation."""

    formula: Text = Field(description="Such as always[a1.start, a2.end] (not hold and obj_on_table).")
    response: ResponseEntry = Field(default="stop", description="stop, continue, or {retry: N, when: FORMULA}.")
    settle: Time = Field(default=0.5, description="Time that a literal may lag behind its expected change.")
    words: Annotated[str, StringConstraints(min_length=1, max_length=80)] | None = None
    """Of a fault: what happens, as people say it after "if", such as `it slips while it is lifted`."""


FormulaOrText = MappingOr[FormulaEntry, Text]
Meaning = Literal["held", "nothing held", "stands on a fixture", "stands on the other"]
"""What a predicate says of the cell at the beginning: of its first object, or of the tool."""
OBJECTS_OF: Mapping[Meaning, int] = {
    "held": 1, "nothing held": 0, "stands on a fixture": 1, "stands on the other": 2,
}  # fmt: skip
"""How many objects a predicate of each meaning is about."""
MOST_ENTRIES = 200  # of a kind in a skill


class SkillFile(Entry):
    """How a skill moves, and what the cameras must see while it does."""

    motion: dict[Name, MotionValues] = Field(default={}, max_length=MOST_ENTRIES)
    """Parameters of the motion with the values to try."""
    waypoints: dict[Name, Waypoint] = Field(default={}, max_length=MOST_ENTRIES, description="Poses of the tool frame.")
    primitives: list[PrimitiveAction] = Field(min_length=1, max_length=100)
    """What the robot does, one after the other."""
    formulas: list[FormulaOrText] = Field(default=[], max_length=MOST_ENTRIES)
    """What must hold while all goes well."""
    faults: dict[Name, FormulaEntry] = Field(default={}, max_length=MOST_ENTRIES, description="What may go wrong.")
    targets: dict[Name, TargetSpec] = Field(default={}, max_length=MOST_ENTRIES)
    """What decides each predicate, and where to look."""
    initially: dict[Name, Meaning] = Field(default={}, max_length=MOST_ENTRIES)
    """What predicates mean in a workspace, whose `state` then need not say what follows from its objects and tool."""


@dataclass(frozen=True)
class Requirement:
    """A temporal sensing requirement: what a skill states, with its texts parsed as MTL."""

    name: str | None  # Of the fault that the formula describes; None for a plain requirement
    stated: FormulaEntry
    formula: Formula
    retry_when: Formula | None  # What must be seen before a retry starts, if the response is one and states that
    place: Place  # Where the formula's text starts


@dataclass(frozen=True)
class Skill:
    """A skill as its two files define it."""

    name: str
    folder: Path
    domain: Domain  # The types and predicates around its action
    action: Action
    motion_parameters: tuple[MotionParameter, ...]
    waypoints: Mapping[str, Waypoint]
    primitives: tuple[PrimitiveAction, ...]
    requirements: tuple[Requirement, ...]
    targets: Mapping[str, TargetSpec]
    initially: Mapping[str, Meaning]
    """What predicates mean in a workspace: which facts follow from its objects and tool."""
    places: Mapping[str, Place]  # Position of every key of skill.yaml, by its dotted path (such as `primitives.0.to`)
    warnings: tuple[Problem, ...]  # Findings that do not prevent its use
    recorded: object | None = None  # Of a recording: what has its motions, which are not planned

    def place(self, *path: str | int) -> Place:
        """The place of a key of skill.yaml, such as `targets`, `hold`, `boxes`, 0; if missing, that of its parent."""
        while path[1:] and dotted(path) not in self.places:
            path = path[:-1]
        return self.places[dotted(path)]

    @property
    def defaults(self) -> dict[str, MotionValue]:
        """The first value of every motion parameter."""
        return {parameter.name: parameter.values[0] for parameter in self.motion_parameters}

    @property
    def pieces(self) -> dict[str, str]:
        """What each primitive does in words, by its name, with which those of the same words are told apart."""
        does = Counter(one.words for one in self.primitives)
        return {one.name: f"{one.words}, {one.name}" if does[one.words] > 1 else one.words for one in self.primitives}

    def in_pieces(self, said: str) -> str:
        """A text in which what the robot does stands for names of primitives: `out of reach by 0.10 m (lift)`."""
        pieces = self.pieces
        place = re.fullmatch(r"(\w+)(?: to `.*?`)?: (.*)", said)
        if place is not None and place[1] in pieces:
            return f"{place[2]} ({pieces[place[1]]})"
        return re.sub(r"(?<![\w.`(-])[A-Za-z_]\w*(?![\w.`-])", lambda name: pieces.get(name[0], name[0]), said)

    @property
    def fault_words(self) -> dict[str, str]:
        """What happens at each fault, by its name: its `words`, or "`slip` happens (lift)", with what is done then."""
        said = dict[str, str]()
        for one in self.requirements:
            if one.name is not None:
                used = re.findall(r"([A-Za-z_]\w*)\.(?:start|end)\b", one.stated.formula)
                when = " until ".join(dict.fromkeys(self.pieces[name] for name in used if name in self.pieces))
                said[one.name] = one.stated.words or f"`{one.name}` happens{f' ({when})' if when else ''}"
        return said

    def of_fault(self, name: str) -> Requirement:
        """The requirement that describes a fault; in recordings, `dropped2` is `dropped` in the second grasp."""
        named = {one.name: one for one in self.requirements}
        return named[name] if name in named else named[name.rstrip(digits)]

    @property
    def retried_faults(self) -> frozenset[str]:
        """Names of the faults after which the robot tries again."""
        retried = (found.name for found in self.requirements if isinstance(found.stated.response, RetryEntry))
        return frozenset(name for name in retried if name is not None)


@dataclass(frozen=True, eq=False)
class SkillChoice:
    """A skill with all its parameters."""

    skill: Skill
    binding: Mapping[str, str]  # The object of each skill parameter
    values: Mapping[str, MotionValue]  # Of each motion parameter
    vias: Mapping[str, Array] = field(default_factory=dict, compare=False)
    """Joint positions that joint moves bend around on their way, shape (k, n) [rad or m], by the primitive's name."""
    branch: Mapping[str, MotionValue] = field(default_factory=dict)
    """Of a way: the branch of inverse kinematics, by the parameters that leave it free; see `plan_motion.Branches`."""


FORMER_ENDING = "_two_finger"  # ending of the names that skills for fingers had when they were skills of their own


def named_skill(word: str, skills: Mapping[str, Skill]) -> Skill | None:
    """The skill that a word means, also by the name that it had before; None if none is called so."""
    return skills.get(word) or (skills.get(word.removesuffix(FORMER_ENDING)) if word.endswith(FORMER_ENDING) else None)
