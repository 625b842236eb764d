"""Input and output of the perception processes, and of detectors that installed packages bring.

A package declares an entry point of the group `sqrp.detectors`, whose name is the `kind` of a detector in a workspace.
Its object is called with a camera, once for each, and gives something with a method `look(image, questions)`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from typing import Protocol

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import BUILT_IN, GROUP, Detector, installed_detectors, package_of
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import SqrpError, bad_input
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import Marker
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.robot_body import RobotBody, Surface


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


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxQuestion:
    """A box in an image: whether that shows what the box is for."""

    atom: str
    """What is to be decided, such as `hold(g1)`."""
    box: str
    """Name of the box in the skill."""
    object: str | None
    """The object that it is for, if it is for one."""
    color: str | None
    """Of that object, as the workspace calls it."""
    marker: Marker | None
    """The marker on that object, or on the link that carries the box: `dictionary`, `id` and `side` [m]."""
    size: tuple[float, float, float]
    """Full extents of the box [m]."""
    X_CB: Array
    """Pose of the box in the optical frame of the camera (x right, y down, z forward), shape (4, 4)."""
    outline: Array
    """Of the box in the image, a convex polygon, shape (n, 2) [pixels]."""
    clear: Mask
    """The pixels of the outline that no part of the robot covers, by its encoders, shape (height, width)."""


class DetectorPlugin(Protocol):
    """Looks at the images of one camera, one after the other."""

    def look(self, image: ImageArray, questions: Sequence[BoxQuestion]) -> Sequence[bool | None]:
        """What an image shows, for each question: it is there, it is not there, or None if that cannot be told.

        image: red, green and blue, shape (height, width, 3). It is called for every image in turn, also without
        questions, with what is asked of it at that moment.
        """


MakeDetector = Callable[[Camera], DetectorPlugin]
"""What an entry point names."""


class PluginError(SqrpError):
    """A detector of an installed package did not do what it should."""


def check_plugins(workspace: Workspace) -> None:
    """Raises InputError, at its line, for a detector of an installed package that cannot be loaded."""
    for name, detector in workspace.detectors.items():
        if detector.kind not in BUILT_IN:
            try:
                load_detector(detector.kind)
            except PluginError as error:
                place = workspace.places.get(f"detectors.{name}.kind")
                raise bad_input("broken-detector", str(error), place) from error


def load_detector(kind: str) -> MakeDetector:
    """What makes detectors of an installed kind. Raises PluginError if it cannot be loaded."""
    entry = installed_detectors().get(kind)
    if entry is None:
        raise PluginError(f"no installed package has a detector `{kind}` any more (entry points `{GROUP}`)")
    try:
        make: MakeDetector = entry.load()
    except Exception as error:  # it is somebody else's code
        raise PluginError(complaint(kind, f"cannot be loaded: {named(error)}")) from error
    return make


def complaint(kind: str, what: str) -> str:
    """What is wrong with a kind of detector, with the package that brings it."""
    entry = installed_detectors().get(kind)
    return f"the detector `{kind}` of the package {'' if entry is None else package_of(entry)} {what}"


def named(error: Exception) -> str:
    """An exception of somebody else's code."""
    return f"{type(error).__name__}: {error}"
