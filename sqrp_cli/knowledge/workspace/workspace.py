"""A workspace: everything that is known of one cell, read and validated."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sqrp_cli.errors import Place, Problem
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.detector import Detector
from sqrp_cli.knowledge.robot.robot import Robot
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.text.entries import Finite, PoseMatrix, Stored, Written, refused
from sqrp_cli.knowledge.text.input_file import SourceFile
from sqrp_cli.knowledge.text.source import LeafValue
from sqrp_cli.logic.literal import Atom

_NAME = r"[A-Za-z_][\w-]*"
_FACT = re.compile(rf"{_NAME}(\({_NAME}(, *{_NAME})*\))?")


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


def _fact(text: str) -> Atom:
    if not _FACT.fullmatch(text):
        raise refused("program-fact", f"found `{text}`, expected a fact such as `hold(g1)`")
    return Atom.of(text)


Facts = Annotated[
    frozenset[Atom],
    Written(tuple[Annotated[Atom, Written(str, _fact, str)], ...], frozenset, lambda facts: sorted(map(str, facts))),
]
"""Atoms that hold, which a file writes as text in alphabetical order."""


@dataclass(frozen=True, eq=False)
class World(Stored):
    """What is true and where things are at one moment."""

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
    values: Mapping[str, LeafValue]
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
