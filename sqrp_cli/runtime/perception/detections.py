"""Input and output of the perception processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.detector import Detector
from sqrp_cli.knowledge.robot.robot import Marker
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.runtime.perception.plugin import check_plugins
from sqrp_cli.runtime.robot_body import RobotBody
from sqrp_cli.runtime.surface import Surface


class MissReason(StrEnum):
    """Why an image does not show what it was predicted to show."""

    MASK = "mask border"
    """The outlines of robot and objects, which are a little too wide, leave too little of it."""
    BACKGROUND = "same colour behind"
    """The background has its colour, so that the image would look the same without it."""
    LIGHTING = "lighting"
    """The pixels have neither the object's colour nor the background's."""
    DETECTOR = "detector limit"
    """The image shows it, if not to the detector."""


@dataclass(frozen=True, eq=False)
class CellModel:
    """What perception knows of the cell in advance."""

    cameras: Mapping[str, Camera]
    detectors: Mapping[str, Detector]
    objects: Mapping[str, SceneObject]
    surfaces: Mapping[str, tuple[Surface, ...]]
    """Of each object, one for each of its parts."""
    robot: RobotBody
    markers: Mapping[str, Marker]
    """On links, by the link's name."""
    shadows: bool = False
    """Whether its stated lights cast shadows that move with the robot."""

    @classmethod
    def of(cls, workspace: Workspace, robot: RobotBody) -> CellModel:
        """What a workspace says. Raises InputError for a mesh, or a detector of a package, that cannot be used."""
        check_plugins(workspace)
        objects = workspace.objects
        surfaces = {name: tuple(Surface.of(part).coarsened() for part in obj.parts) for name, obj in objects.items()}
        shadows = any(not light.is_ambient for light in workspace.lights.values())
        return cls(workspace.cameras, workspace.detectors, objects, surfaces, robot, workspace.robot.markers, shadows)


@dataclass(frozen=True, eq=False)
class DetectionTargets:
    """What to look for during a step."""

    targets: Mapping[str, ProgramTarget]
    """What decides each atom."""
    starts: Mapping[str, Array]
    """Pose of each object when the step began, (4, 4)."""
    when_open: Mapping[str, bool]
    """The value of each atom while the fingers of a gripper are open, for atoms that are about them."""


@dataclass(frozen=True, eq=False)
class BelievedState:
    """The robot's knowledge of its own state at the time of an image."""

    joints: Mapping[str, float]
    """Positions by its encoders [rad or m]."""
    holding: bool
    """Whether the tool was commanded to hold."""
    X_WO: Mapping[str, Array]
    """Where objects are believed to be, (4, 4)."""


NO_OUTLINE: Array = np.zeros((0, 2))
"""The outline of a box that is not in the image."""


@dataclass(frozen=True, eq=False)
class BoxDetection:
    """What one image shows of one box."""

    name: str
    evidence: Truth
    """Whether the image shows the object in it, the background where the object would be, or neither for sure."""
    share: float
    """Of the object's silhouette, or of a marker's outline, that could be judged, in 0..1."""
    outline: Array
    """Of the box in the image, shape (n, 2) [pixels]."""
    because: MissReason = MissReason.DETECTOR
    """Why it is blind, if it is."""


@dataclass(frozen=True, eq=False)
class Detection:
    """What one image shows."""

    camera: str
    t: float
    frozen: bool
    """Whether it is identical to the image before it; a working camera never repeats one."""
    boxes: Mapping[str, tuple[BoxDetection, ...]] = field(default_factory=dict)
    """By atom."""
    places: Mapping[str, Array] = field(default_factory=dict)
    """Position [m] of each object that was located, shape (3,)."""
    seconds: float = 0.0
    """Of work that it took."""

    def truth(self, atom: str) -> Truth:
        """Whether the atom holds by this image alone: every box must show its object; a box without it refutes it."""
        found = [box.evidence for box in self.boxes.get(atom, ())]
        if not found or self.frozen:
            return Truth.UNKNOWN
        if Truth.FALSE in found:
            return Truth.FALSE
        return Truth.TRUE if all(evidence is Truth.TRUE for evidence in found) else Truth.UNKNOWN

    def outlines(self) -> list[tuple[Array, Truth]]:
        """The outline of each box, with what the image shows of it."""
        return [(box.outline, box.evidence) for boxes in self.boxes.values() for box in boxes]

    def share(self, atom: str) -> float:
        """The least share of any of the atom's boxes that could be judged."""
        return min((box.share for box in self.boxes.get(atom, ())), default=0.0)

    def miss_reason(self, atom: str) -> MissReason:
        """Why the image does not give the atom its true value, if it does not."""
        blind = [box for box in self.boxes.get(atom, ()) if box.evidence is Truth.UNKNOWN]
        return min(blind, key=lambda box: box.share).because if blind else MissReason.DETECTOR
