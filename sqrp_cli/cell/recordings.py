"""Recordings in a workspace file: whose motion, how its numbers become joint positions, what it handles and watches."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Annotated

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from sqrp_cli.camera.camera import Frequency
from sqrp_cli.camera.detector import Detector
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.errors import Place, Problem, expected_names
from sqrp_cli.files.entries import AnyQuantity, Entry, Extents, MappingOr, Name, Pose, Text, refused
from sqrp_cli.files.source import KeyPath, SourceDocument, describe, dotted
from sqrp_cli.files.units import LONGEST, TIME, read_quantity
from sqrp_cli.geometry import pose, read_only
from sqrp_cli.logic.domain import Action, Compound, Domain, Holds, Parameter, Signature
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Box, Part
from sqrp_cli.skill.read_skill import SkillReader
from sqrp_cli.skill.skill import MOST_ENTRIES, FormulaEntry, FormulaOrText, Skill, SkillFile
from sqrp_cli.skill.target_box import JAWS, TargetSpec, usual_targets

GRASP_PHASES = ("approach", "grasp", "carry", "release", "retreat")
"""The phases around a grasp, in order; of the second grasp of an episode they are called `approach2` and so on."""
EPISODE = "episode"  # the whole episode as an interval of formulas, and the parameter of candidates
USUAL_SIZE = 0.03  # of an object whose size is not stated, along each axis [m]
MOST_OBJECTS, MOST_RECORDINGS = 50, 50
HOLD = "hold"  # the predicate of what a grasp holds; `hold2` where the second one holds an object elsewhere in the tool
SIGHT = "sight"
USUAL_DETECTORS = {
    SIGHT: Detector(kind="color", distance=(0.01, 100.0), max_incidence=pi, min_pixels=8.0, min_visible=0.5)
}
"""The detector of what is watched where a workspace names none: half of a thing of 8 pixels is enough."""


def _held(value: object) -> int | tuple[float, float]:
    if isinstance(value, list) and len(value) == 2:
        start, end = map(str, value)
        grasp = re.fullmatch(r"grasp([2-9]|[1-9][0-9]+)?", start)
        if grasp is not None and end == start.replace("grasp", "release"):
            return int(grasp[1] or 1)
        times = [one.value for one in map(read_quantity, value) if one is not None and one.dimension in (None, TIME)]
        if len(times) == 2 and 0.0 <= times[0] < times[1] <= LONGEST:
            return times[0], times[1]
    expected = "[grasp, release], [grasp2, release2] or two rising times"
    raise refused("wrong-value", f"found {describe(value)}, expected {expected}")


_INSTANT = {"type": ["number", "string"], "minimum": 0, "maximum": LONGEST}
HeldWhen = Annotated[
    int | tuple[float, float],
    PlainValidator(_held),
    WithJsonSchema({"type": "array", "items": _INSTANT, "minItems": 2, "maxItems": 2}),
]
"""The number of a grasp, from 1, or from when to when [s]."""


class RecordedJointEntry(Entry):
    """A joint, and how the recording's numbers become its positions: `scale` times the number, plus `offset`."""

    joint: Text = Field(description="The joint of the robot.")
    scale: AnyQuantity | None = None
    """Angle or length that a 1 of the recording means, such as `1 deg` or `-1 deg`; default: the unit that the
    recording states, else 1 rad or 1 m."""
    offset: AnyQuantity | None = None
    """Position of the joint where the recording says 0; default: 0."""


class GripperEntry(Entry):
    """What of the recording tells when something is grasped and released."""

    joint: Text
    """A joint of the robot, by its position; or a name of the recording, by its numbers as stored."""
    closed_below: AnyQuantity | None = Field(default=None, description="Below this it holds, or is closed.")
    closed_above: AnyQuantity | None = Field(default=None, description="Above this it does, instead.")
    empty_beyond: AnyQuantity | None = None
    """Closed further than this, nothing is between the jaws; default: within 2 % of where `robot.fingers` are closed.
    """

    @model_validator(mode="after")
    def _one_threshold(self) -> GripperEntry:
        self.check_only_one("closed_below", "closed_above")
        return self


class RecordedObjectEntry(Entry):
    """An object that the recording handles.

    Where the cell has an object of this name with a pose, it begins there. Else it begins where it is grasped, upright
    and on what is near below: in the middle of the tool frame, beside a jaw that stands still, or before a suction cup.
    """

    size: Extents | None = Field(default=None, description="Full extents; by default 3 cm along each axis.")
    color: Text | None = None
    """What detectors of colours look for."""
    pose: Pose | None = Field(default=None, description="Where it begins in every episode, if that is known.")
    held: HeldWhen | None = None
    """From the end of which phase to the start of which, such as [grasp2, release2], or from when to when [s]; by
    default of an object alone in every grasp, else of each in one."""


class RecordingEntry(Entry):
    """A recording, a task of its own: its episodes are the candidates."""

    file: Text
    """A LeRobot dataset, MCAP, rosbag2, ROS 1 bag, CSV, JointTrajectory YAML or program; relative to this file."""
    signal: Text | None = None
    """Which of several: a dataset's feature, by default `observation.state`; a topic of a bag, by default all."""
    rate: Frequency | None = Field(default=None, description="Of its states, where its own times do not count.")
    joints: dict[Text, MappingOr[RecordedJointEntry, Text]] = Field(default={}, max_length=MOST_ENTRIES)
    """The joint of each name in the recording; without any, joints are called as in the robot."""
    gripper: GripperEntry | None = None
    """When something is grasped and released; not needed where objects say when they are held, in seconds, and of our
    own programs and what they export."""
    objects: dict[Name, RecordedObjectEntry] = Field(default={}, max_length=MOST_OBJECTS)
    """What is handled, by name."""
    detector: Name | None = None
    """The detector that looks for what is watched; by default the only one, or one that sees half of a thing."""
    watch: list[Name] | None = Field(default=None, max_length=MOST_OBJECTS)
    """What must be seen all the time: `jaws`, and names of objects; by default jaws and all that is handled."""
    formulas: list[FormulaOrText] = Field(default=[], max_length=MOST_ENTRIES)
    """What must hold, as in a skill, over the phases approach, grasp, carry, release, retreat and the whole episode."""
    faults: dict[Name, FormulaEntry] | None = Field(default=None, max_length=MOST_ENTRIES)
    """What may go wrong; by default what is held is dropped while it is carried."""
    targets: dict[Name, TargetSpec] = Field(default={}, max_length=MOST_ENTRIES)
    """Further predicates of these formulas, and the boxes that decide them."""

    @property
    def handled(self) -> Mapping[str, RecordedObjectEntry]:
        """What it handles, by name: where a gripper takes something that is not stated, one of the usual size."""
        return self.objects or ({"part": RecordedObjectEntry()} if self.gripper else {})


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedTask:
    """A recording of a workspace as a task."""

    file: Path  # Of the recording, or its folder
    entry: RecordingEntry
    skill: Skill  # What is to be seen in an episode; its primitives are the phases, its parameter the episode

    @property
    def objects(self) -> Mapping[str, RecordedObjectEntry]:
        """What it handles, by name."""
        return self.entry.handled

    def place(self, *path: str | int) -> Place:
        """The place of a key of its entry in the workspace file; if missing, that of its parent."""
        return self.skill.place(*path) if dotted(path) in self.skill.places else self.skill.action.place

    @property
    def file_state(self) -> str:
        """What tells whether it was read as it is: names, sizes and times of its files."""
        files = sorted(self.file.rglob("*")) if self.file.is_dir() else [self.file]
        return str([(str(one), one.stat().st_size, one.stat().st_mtime_ns) for one in files if one.is_file()])

    @property
    def state(self) -> str:
        """What tells whether kept results are still about it: its entry, and the state of its files."""
        return f"{self.entry.model_dump_json(warnings=False)} {self.file_state}"

    @property
    def held_seconds(self) -> list[tuple[float, float]]:
        """From when to when something is held, in order [s]; empty where objects are not stated in seconds."""
        return sorted(one.held for one in self.objects.values() if isinstance(one.held, tuple))

    def held_in(self, number: int, start: float) -> str | None:
        """The object that is held in the grasp of a number, from 0, that begins at a time [s]; None if none is."""
        if spans := {one.held[0]: name for name, one in self.objects.items() if isinstance(one.held, tuple)}:
            return spans.get(start)
        stated: dict[object, str] = {one.held: name for name, one in self.objects.items() if one.held is not None}
        others = [name for name, one in self.objects.items() if one.held is None]
        if len(others) == len(self.objects) == 1:
            return others[0]
        # Those of which nothing is said are held once each, in order, in the grasps that are left.
        left = (one for one in range(1, number + 2) if one not in stated)
        return (stated | dict(zip(left, others, strict=False))).get(number + 1)


def recorded_scene_objects(
    document: SourceDocument, recordings: Mapping[str, RecordingEntry], known: Mapping[str, SceneObject]
) -> Iterator[SceneObject]:
    """The objects of recordings that are not among the known ones, at poses that the recordings tell.

    Raises InputError where a size or colour differs from that of a known one, or of another recording.
    """
    stated = {(one.name, key): getattr(one, key) for one in known.values() for key in ("size", "color")}
    handled = [(called, name, one) for called, entry in recordings.items() for name, one in entry.handled.items()]
    for called, name, one in handled:
        for key in ("size", "color"):
            if (value := getattr(one, key)) is not None and stated.setdefault((name, key), value) != value:
                message = f"`{name}` has the {key} {stated[name, key]} elsewhere in this file; expected the same"
                at = ("recordings", called, "objects", name, key)
                raise document.error("ambiguous-name", at, message, f"state it once, or give `{name}` another name")
    for name in dict.fromkeys(name for _, name, _ in handled if name not in known):
        size = stated.get((name, "size")) or (USUAL_SIZE, USUAL_SIZE, USUAL_SIZE)
        part = Part(name, name, Box(size), read_only(pose()))
        color = stated.get((name, "color"))
        yield SceneObject(name=name, type="object", color=color, size=size, pose=None, parts=(part,))


def _overlapping(
    document: SourceDocument, at: KeyPath, objects: Mapping[str, RecordedObjectEntry]
) -> Iterator[Problem]:
    """Problems with what the objects of a recording say of when they are held: one hand holds one thing at a time."""
    held = {name: one.held for name, one in objects.items() if one.held is not None}
    numbered = [name for name, one in held.items() if isinstance(one, int)]
    if 0 < len(numbered) < len(held):
        message = "found a phase here and seconds at another object; expected either of them for all"
        yield document.problem("conflicting-keys", (*at, "objects", numbered[0], "held"), message)
        return
    spans = {name: (one, one + 1) if isinstance(one, int) else one for name, one in held.items()}
    for (one, (_, end)), (other, (start, _)) in pairwise(sorted(spans.items(), key=lambda span: span[1])):
        if start < end:
            message = f"`{other}` is held while `{one}` is; expected one thing at a time"
            yield document.problem("wrong-value", (*at, "objects", other, "held"), message)


def recorded_task(
    document: SourceDocument, name: str, file: Path, entry: RecordingEntry, detectors: Sequence[str]
) -> RecordedTask:
    """A recording as a task: a skill whose primitives are the phases. Raises InputError with all problems.

    document: the workspace's file. detectors: those that it defines.
    """
    at, objects = ("recordings", name), entry.handled
    known = [JAWS, *objects]
    asked = dict.fromkeys(known if entry.watch is None else entry.watch)
    problems = [
        document.problem("unknown-object", (*at, "watch"), f"found `{one}`; {expected_names(one, known)}")
        for one in asked
        if one not in known
    ]
    problems += _overlapping(document, at, objects)
    plain, of_objects = [*known, *entry.targets], (HOLD, "place") if objects else ()
    uses = [Holds(one, ()) for one in plain] + [Holds(one, (thing,)) for one in of_objects for thing in objects]
    signatures = {one: Signature(one, ()) for one in plain}
    signatures |= {one: Signature(one, (Parameter("object"),)) for one in of_objects}
    action = Action(name, (), Compound("and"), tuple(uses), (), document.key_place(at))
    constants = dict.fromkeys(objects, "object")
    domain = Domain(document.path, {}, constants, signatures, {name: action})
    watched = " and ".join(one for one in asked if one in known)
    usual = [f"always[{EPISODE}.start, {EPISODE}.end] ({watched})"] if watched else []
    dropped = {
        "dropped" if len(objects) == 1 else f"dropped_{one}": FormulaEntry(
            formula=f"eventually[carry.start, carry.end] (not hold({one}))",
            words=f"{one} is dropped while it is carried",
        )
        for one in objects
    }
    detector = entry.detector or (detectors[0] if len(detectors) == 1 else SIGHT)
    said = SkillFile.model_validate(
        {
            "waypoints": {"grasp": {"pose": {}}},  # that of what is held, which its motion tells
            "primitives": [{"name": one, "does": one, "wait": 0.0} for one in (EPISODE, *GRASP_PHASES)],
            "formulas": entry.formulas or usual,
            "faults": dropped if entry.faults is None else entry.faults,
            "targets": {**usual_targets([*objects], detector), **entry.targets},
        }
    )
    skill = SkillReader(document.part(at), said, domain, action, problems).read(document.folder / name)
    return RecordedTask(file=file, entry=entry, skill=skill)
