"""A workspace: the format of its file, and the validated description of one cell."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sqrp_cli.camera.camera import Camera, CameraEntry
from sqrp_cli.camera.detector import Detector, DetectorEntry
from sqrp_cli.camera.light import MOST_LIGHTS, Light
from sqrp_cli.camera.markers import Marker
from sqrp_cli.cell.canonical_values import CanonicalValues, canonical_values, digest_of_values, without_words
from sqrp_cli.cell.recordings import MOST_RECORDINGS, RecordedTask, RecordingEntry
from sqrp_cli.cell.scene import ObjectEntry, SceneObject
from sqrp_cli.errors import Place, Problem
from sqrp_cli.files.entries import (
    Entry,
    FileRecord,
    Finite,
    In,
    Name,
    Pose,
    PoseMatrix,
    SerializedAs,
    Share,
    Text,
    refused,
)
from sqrp_cli.files.input_file import SourceFile
from sqrp_cli.files.source import LeafValue
from sqrp_cli.files.units import LARGEST, LENGTH, TIME
from sqrp_cli.logic.literal import Atom
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import Robot, RobotEntry
from sqrp_cli.shapes import Mesh, Part
from sqrp_cli.skill.skill import Skill

_NAME = r"[A-Za-z_][\w-]*"
_FACT = re.compile(rf"{_NAME}(\({_NAME}(, *{_NAME})*\))?")
LongestTime = Annotated[float, In(TIME, 1e-3, LARGEST)]
Padding = Annotated[float, In(LENGTH, 0.0, 10.0)]


@dataclass(frozen=True, kw_only=True)
class ExpectedTask(FileRecord):
    """A task that the cell must support, with requirements on its best candidate."""

    task: str = ""
    """As on the command line, such as `pickup green`."""
    steps: tuple[Text, ...] = ()
    """Instead of `task`: several tasks, one after the other, that are scored as a whole."""
    min_q_avg: Share | None = None
    """Least share of the time in which all is seen."""
    min_q_eoi: Share | None = None
    """The same of the events of interest."""
    max_time: LongestTime | None = None
    """Longest duration."""
    max_delay: LongestTime | None = None
    """Longest time until a fault is noticed."""
    min_phases: Mapping[Name, Share] | None = None
    """Of a recording: the same of phases, such as `{grasp: 95 %}`, in every episode."""
    feasible: bool | None = None
    """Whether a feasible candidate is expected at all."""
    winner: Name | None = None
    """The object that the best candidate is expected to use."""

    def __post_init__(self) -> None:
        """Join the steps as one text. Raises PydanticCustomError unless there is either a task or steps."""
        self.check_only_one("task", "steps")
        if self.steps:
            object.__setattr__(self, "task", " then ".join(self.steps))


class FixturesEntry(Entry):
    """A file with fixed objects."""

    file: Text
    """A .scene of MoveIt, an .sdf or .world, or an .xml of MuJoCo; relative to this file, or package://."""
    pose: Pose = Field(default=Pose(), description="Pose of the file's frame in the world.")


class WorkspaceFile(Entry):
    """A cell: robot, cameras, detectors, objects, what is true now, skills and expected tasks."""

    robot: RobotEntry
    detectors: dict[Name, DetectorEntry] = Field(default={}, description="Detection algorithms by name.")
    cameras: dict[Name, CameraEntry] = Field(default={}, max_length=200, description="Cameras by name.")
    skills: list[Text] = Field(default=[], description="Folders of the skills that may be used.")
    objects: dict[Name, ObjectEntry] = Field(default={}, max_length=2000, description="Objects in the cell by name.")
    fixtures: list[FixturesEntry] = Field(default=[], max_length=50)
    """Files with further objects that never move: scenes and worlds."""
    lights: dict[Name, Light] = Field(default={}, max_length=MOST_LIGHTS)
    """Lights by name; without any, cameras see all brightly enough."""
    state: list[Text] = Field(
        default=[],
        description="The facts that hold now, besides those that follow from the cell; `not FACT` denies one of these.",
    )
    tasks: list[ExpectedTask] = Field(default=[], description="Tasks that the cell must support.")
    recordings: dict[Name, RecordingEntry] = Field(default={}, max_length=MOST_RECORDINGS)
    """Recordings of motions by name: tasks whose candidates are the episodes."""
    padding: Padding = Field(default=0.0, description="Least distance that motions keep from fixed objects.")


def _fact(text: str) -> Atom:
    if not _FACT.fullmatch(text):
        raise refused("program-fact", f"found `{text}`, expected a fact such as `hold(g1)`")
    return Atom.of(text)


Facts = Annotated[
    frozenset[Atom],
    SerializedAs(
        tuple[Annotated[Atom, SerializedAs(str, _fact, str)], ...], frozenset, lambda facts: sorted(map(str, facts))
    ),
]
"""Atoms that hold, which a file writes as text in alphabetical order."""


@dataclass(frozen=True, eq=False)
class World(FileRecord):
    """The facts, the poses of objects and the joint positions at one moment."""

    facts: Facts
    """The atoms that hold; every other one is false."""
    X_WO: Annotated[Mapping[str, PoseMatrix], Field(alias="objects")]
    """Pose of each object whose place is known, shape (4, 4)."""
    held: str | None
    """The object in the tool; None if it is empty."""
    X_TO: Annotated[PoseMatrix | None, Field(alias="held_pose")]
    """Pose of the object in the tool in the tool frame, shape (4, 4)."""
    joints: Mapping[str, Finite]
    """Position of every joint that is driven, those of the arm and of the fingers [rad or m]."""


def markers_of(on_links: Mapping[str, Marker], objects: Mapping[str, SceneObject]) -> dict[str, Marker]:
    """The markers of a cell, by what carries them."""
    on_objects = {name: obj.printed_marker for name, obj in objects.items()}
    return {**on_links, **{name: marker for name, marker in on_objects.items() if marker is not None}}


@dataclass(frozen=True, eq=False)
class Workspace:
    """The description of one cell."""

    name: str
    path: Path  # the workspace file
    robot: Robot
    cameras: Mapping[str, Camera]
    detectors: Mapping[str, Detector]
    objects: Mapping[str, SceneObject]
    lights: Mapping[str, Light]  # if there are none, cameras see everything brightly enough
    state: frozenset[Atom]  # the facts that hold at the beginning; every other one is false
    derived: Mapping[Atom, str]  # those of them that follow from the cell, with from what, such as `on: table`
    skills: Mapping[str, Skill]
    tasks: tuple[ExpectedTask, ...]
    recordings: Mapping[str, RecordedTask]
    padding: float  # least distance that motions keep from fixed objects [m]
    files: Mapping[str, SourceFile]
    """The files that were read, meshes included, by the role that each plays, such as `robot.urdf`."""
    values: Mapping[str, LeafValue]  # what the workspace file says, by dotted path
    warnings: tuple[Problem, ...]  # findings that do not prevent its use
    places: Mapping[str, Place]  # position of every key of the file, by dotted path

    @cached_property
    def canonical_values(self) -> CanonicalValues:
        """What it says, without what has no meaning for the cell."""
        return canonical_values(self, {file.path: file.digest for file in self.files.values()})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of these values."""
        return digest_of_values(self.canonical_values)

    @cached_property
    def digests(self) -> frozenset[str]:
        """All digests by which it is known: what its skills say for people alone may have been added since."""
        return frozenset((self.digest, digest_of_values(without_words(self.canonical_values))))

    @property
    def markers(self) -> Mapping[str, Marker]:
        """The markers on links and on objects, by what carries them."""
        return markers_of(self.robot.markers, self.objects)

    @property
    def whole_file(self) -> Place:
        """Its file as a place, at the path as it was given."""
        return Place(next((place.file for place in self.places.values()), self.path))

    @cached_property
    def types(self) -> Mapping[str, frozenset[str]]:
        """The types of every object, by its name."""
        return {name: frozenset(obj.types) for name, obj in self.objects.items()}

    @property
    def stated_world(self) -> World:
        """The world as the file states it: fingers open, and no world pose for a held object.

        Motions start from `Cell.initial_world`, which knows where the tool is.
        """
        held = next((obj for obj in self.objects.values() if obj.X_TO is not None), None)
        name, X_TO = (None, None) if held is None else (held.name, held.X_TO)
        X_WO = {name: obj.X_WO for name, obj in self.objects.items() if obj.X_WO is not None}
        fingers = self.robot.fingers.open if self.robot.fingers else {}
        return World(self.state, X_WO, name, X_TO, {**self.robot.home, **fingers})

    @property
    def meshes(self) -> Mapping[Path, str]:
        """The mesh files, read again for computing, with the digests of their content."""
        parts = [*self.robot.parts, *(part for obj in self.objects.values() for part in obj.parts)]
        paths = {part.shape.path for part in parts if isinstance(part.shape, Mesh)}
        return {file.path: file.digest for file in self.files.values() if file.path in paths}

    def relocated(self, moved: Callable[[Path], Path]) -> Workspace:
        """The workspace with every file of `meshes` moved, for use on another machine."""

        def there(part: Part) -> Part:
            mesh = part.shape
            return replace(part, shape=replace(mesh, path=moved(mesh.path))) if isinstance(mesh, Mesh) else part

        robot = replace(self.robot, parts=tuple(map(there, self.robot.parts)))
        objects = {name: replace(obj, parts=tuple(map(there, obj.parts))) for name, obj in self.objects.items()}
        return replace(self, robot=robot, objects=objects)
