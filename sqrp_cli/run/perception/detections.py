"""What perception is told of a cell, what each image shows, and what all cameras show together: the evidence.

A package that brings a detector declares an entry point of the group `sqrp.detectors`, whose name is the `kind` of a
detector in a workspace, and whose object is a `MakeDetector`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.detector import BUILT_IN, GROUP, Detector, installed_detectors
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import SqrpError, bad_input
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import Marker
from sqrp_cli.run.robot_body import CELL, MANY_OF_A_LINK, RobotBody, Surface

MissReason: TypeAlias = Literal["mask border", "same colour behind", "lighting", "detector limit"]
"""Why an image does not show what it was predicted to show.

`mask border`: the outlines of robot and objects, which are a little too wide, leave too little of it. `same colour
behind`: the background has its colour, so that the image would look the same without it. `lighting`: the pixels have
neither the object's colour nor the background's. `detector limit`: the image shows it, if not to the detector.
"""


@dataclass(frozen=True, eq=False)
class CellModel:
    """What perception knows of the cell in advance."""

    cameras: Mapping[str, Camera]
    detectors: Mapping[str, Detector]
    objects: Mapping[str, SceneObject]
    surfaces: Mapping[str, tuple[Surface, ...]]  # Of each object, one for each of its parts
    robot: RobotBody
    markers: Mapping[str, Marker]  # On links, by the link's name
    shadows: bool = False  # Whether its stated lights cast shadows that move with the robot

    @classmethod
    def of(cls, workspace: Workspace, robot: RobotBody) -> CellModel:
        """What a workspace says. Raises InputError for a mesh, or a detector of a package, that cannot be used."""
        for name, detector in workspace.detectors.items():
            if detector.kind not in BUILT_IN:
                try:
                    load_detector(detector.kind)
                except SqrpError as error:
                    place = workspace.places.get(f"detectors.{name}.kind")
                    raise bad_input("broken-detector", str(error), place) from error
        objects = workspace.objects
        surfaces = {name: tuple(Surface.of(part).coarsened() for part in obj.parts) for name, obj in objects.items()}
        robot = replace(robot, surfaces=tuple(one.coarsened(MANY_OF_A_LINK, CELL) for one in robot.surfaces))
        shadows = any(not light.is_ambient for light in workspace.lights.values())
        return cls(workspace.cameras, workspace.detectors, objects, surfaces, robot, workspace.robot.markers, shadows)


@dataclass(frozen=True, eq=False)
class DetectionTargets:
    """What to look for during a step."""

    targets: Mapping[str, ProgramTarget]  # What decides each atom
    starts: Mapping[str, Array]  # Pose of each object when the step began, (4, 4)
    when_open: Mapping[str, bool]
    """The value of each atom while the fingers of a gripper are open, for atoms that are about them."""


@dataclass(frozen=True, eq=False)
class BelievedState:
    """The robot's knowledge of its own state at the time of an image."""

    joints: Mapping[str, float]  # Positions by its encoders [rad or m]
    holding: bool  # Whether the tool was commanded to hold
    X_WO: Mapping[str, Array]  # Where objects are believed to be, (4, 4)


NO_OUTLINE: Array = np.zeros((0, 2))  # The outline of a box that is not in the image


@dataclass(frozen=True, eq=False)
class BoxDetection:
    """What one image shows of one box."""

    name: str
    evidence: Truth
    """Whether the image shows the object in it, the background where the object would be, or neither for sure."""
    share: float  # Of the object's silhouette, or of a marker's outline, that could be judged, in 0..1
    outline: Array  # Of the box in the image, shape (n, 2) [pixels]
    because: MissReason = "detector limit"  # Why it is blind, if it is


@dataclass(frozen=True, eq=False)
class Detection:
    """What one image shows."""

    camera: str
    t: float
    frozen: bool  # Whether it is identical to the image before it; a working camera never repeats one
    boxes: Mapping[str, tuple[BoxDetection, ...]] = field(default_factory=dict)  # By atom
    places: Mapping[str, Array] = field(default_factory=dict)
    """Position [m] of each object that was located, shape (3,)."""
    seconds: float = 0.0  # Of work that it took

    def truth(self, atom: str) -> Truth:
        """Whether the atom holds by this image alone: every box must show its object; a box without it refutes it."""
        found = [box.evidence for box in self.boxes.get(atom, ())]
        if not found or self.frozen:
            return Truth.UNKNOWN
        if Truth.FALSE in found:
            return Truth.FALSE
        return Truth.TRUE if all(evidence is Truth.TRUE for evidence in found) else Truth.UNKNOWN


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxQuestion:
    """A box in an image: whether that shows what the box is for."""

    atom: str  # What is to be decided, such as `hold(g1)`
    box: str  # Name of the box in the skill
    object: str | None  # The object that it is for, if it is for one
    color: str | None  # Of that object, as the workspace calls it
    marker: Marker | None
    """The marker on that object, or on the link that carries the box: `dictionary`, `id` and `side` [m]."""
    size: tuple[float, float, float]  # Full extents of the box [m]
    X_CB: Array  # Pose of the box in the optical frame of the camera (x right, y down, z forward), shape (4, 4)
    outline: Array  # Of the box in the image, a convex polygon, shape (n, 2) [pixels]
    clear: Mask  # The pixels of the outline that no part of the robot covers, by its encoders, shape (height, width)


MakeDetector = Callable[[Camera], Any]
"""What an entry point names: called with a camera, it makes a detector of the images of this camera.

The detector has a method `look(image: ImageArray, questions: Sequence[BoxQuestion]) -> Sequence[bool | None]`, which
says for each question: it is there, it is not there, or None if that cannot be told. It is called for every image in
turn, also without questions, with what is asked of it at that moment.
"""


def load_detector(kind: str) -> MakeDetector:
    """What makes detectors of an installed kind. Raises SqrpError if it cannot be loaded."""
    entry = installed_detectors().get(kind)
    if entry is None:
        raise SqrpError(f"no installed package has a detector `{kind}` any more (entry points `{GROUP}`)")
    with plugin_errors(kind, "cannot be loaded"):
        make: MakeDetector = entry.load()
    return make


@contextmanager
def plugin_errors(kind: str, what: str) -> Iterator[None]:
    """Turn any exception of a package's code into an SqrpError that names it; one of ours says what is wrong itself."""
    try:
        yield
    except Exception as error:
        entry = installed_detectors().get(kind)
        said = str(error) if isinstance(error, SqrpError) else f"{what}: {type(error).__name__}: {error}"
        package = "" if entry is None else entry.dist.name if entry.dist else entry.module
        raise SqrpError(f"the detector `{kind}` of the package {package} {said}") from error


@dataclass(frozen=True)
class FusedTruth:
    """The value of an atom from all cameras together."""

    truth: Truth  # UNKNOWN where too few cameras can judge it, or as many contradict
    votes: Mapping[str, Truth]  # Of each camera that can judge it
    conflict: bool  # Whether images that were taken at the same time contradict each other


def fuse(atom: str, target: ProgramTarget, detections: Iterable[Detection]) -> FusedTruth:
    """The majority value of an atom, if it has as many cameras as the target requires."""
    judged = [(detection, vote) for detection in detections if (vote := detection.truth(atom)) != Truth.UNKNOWN]
    votes = {detection.camera: vote for detection, vote in judged}
    conflict = len({(detection.t, vote) for detection, vote in judged}) > len({detection.t for detection, _ in judged})
    yes, no = (sum(vote == value for vote in votes.values()) for value in (Truth.TRUE, Truth.FALSE))
    if max(yes, no) < target.cameras or yes == no:
        return FusedTruth(Truth.UNKNOWN, votes, conflict)
    return FusedTruth(Truth.TRUE if yes > no else Truth.FALSE, votes, conflict)


@dataclass(eq=False)
class Evidence:
    """Images that were taken at one time, and what is known of that by all images that count then."""

    t: float  # On the cell's clock [s]
    tau: float | None  # Of the step's motion [s], None before it
    truths: Mapping[str, bool]  # Ground truth of all atoms, for checking only
    detections: dict[str, Detection | None] = field(default_factory=dict)
    """What the image of each camera shows, None for those that are under way."""
    atoms: Mapping[str, FusedTruth] = field(default_factory=dict)  # What all images show that count then
    complete: bool = False
    """Whether no image that was taken by then is under way any more, so that nothing that is known will change."""
    told: Mapping[str, FusedTruth] | None = None  # What was last published of it

    @property
    def values(self) -> dict[str, Truth]:
        """Of atoms."""
        return {atom: fused.truth for atom, fused in self.atoms.items()}
