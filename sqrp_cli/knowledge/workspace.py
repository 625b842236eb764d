"""A workspace: everything that is known of one cell, read and validated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import Place, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.knowledge.digest import SourceFile
from sqrp_cli.knowledge.robot import Robot
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import Skill
from sqrp_cli.knowledge.source import Scalar
from sqrp_cli.logic.literal import Atom


@dataclass(frozen=True)
class Thresholds:
    """What a task is expected to reach; None where nothing is expected. Q in 0..1, times in s."""

    min_q_avg: float | None = None
    min_q_eoi: float | None = None
    max_time: float | None = None
    max_delay: float | None = None
    feasible: bool | None = None
    winner: str | None = None


@dataclass(frozen=True)
class ExpectedTask:
    """A task that the cell is expected to support."""

    task: str
    thresholds: Thresholds


@dataclass(frozen=True, eq=False)
class World:
    """What is true and where things are at one moment.

    facts: the atoms that hold; every other one is false. X_WO: pose of each object whose place is known.
    held: the object in the tool, with its pose in the tool frame `X_TO`; None if it is empty.
    joints: position of every joint that is driven, those of the arm and of the fingers [rad or m].
    """

    facts: frozenset[Atom]
    X_WO: Mapping[str, Array]
    held: str | None
    X_TO: Array | None
    joints: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Workspace:
    """Everything that is known of one cell.

    path: the workspace file. digest: SHA-256 over the content of every file that was read, meshes included.
    files: those files, by the role that each plays, such as `robot.urdf`. values: what the workspace file says, by
    dotted path.
    warnings: findings that do not prevent its use. places: position of every key of the file, by dotted path.
    """

    name: str
    path: Path
    robot: Robot
    cameras: Mapping[str, Camera]
    detectors: Mapping[str, Detector]
    objects: Mapping[str, SceneObject]
    state: frozenset[Atom]
    skills: Mapping[str, Skill]
    tasks: tuple[ExpectedTask, ...]
    padding: float
    digest: str
    files: Mapping[str, SourceFile]
    values: Mapping[str, Scalar]
    warnings: tuple[Problem, ...]
    places: Mapping[str, Place]

    @property
    def stated_world(self) -> World:
        """The world as the file states it: with the fingers open, and no pose in the world for what the tool holds.

        Motions start from `Cell.initial_world`, which knows where the tool is.
        """
        held = next((thing for thing in self.objects.values() if thing.X_TO is not None), None)
        name, X_TO = (None, None) if held is None else (held.name, held.X_TO)
        X_WO = {name: thing.X_WO for name, thing in self.objects.items() if thing.X_WO is not None}
        fingers = self.robot.fingers.open if self.robot.fingers else {}
        return World(self.state, X_WO, name, X_TO, {**self.robot.home, **fingers})
