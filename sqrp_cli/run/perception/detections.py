"""What perception is told of a cell, what each image shows, and what all cameras show together: the evidence.

A package that brings a detector declares an entry point of the group `sqrp.detectors`, whose name is the `kind` of a
detector in a workspace. Its object is called with a camera, once for each, and gives something with a method
`look(image, questions)`.

An image counts as evidence from its exposure until the next exposure of its camera, at most for some frame periods.
While an image is under way, the one before it no longer counts, and the cameras with arrived images decide alone.
Evidence of a time is complete when no image taken by then is under way.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
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
        for name, detector in workspace.detectors.items():
            if detector.kind not in BUILT_IN:
                try:
                    load_detector(detector.kind)
                except PluginError as error:
                    place = workspace.places.get(f"detectors.{name}.kind")
                    raise bad_input("broken-detector", str(error), place) from error
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


def load_detector(kind: str) -> MakeDetector:
    """What makes detectors of an installed kind. Raises PluginError if it cannot be loaded."""
    entry = installed_detectors().get(kind)
    if entry is None:
        raise PluginError(f"no installed package has a detector `{kind}` any more (entry points `{GROUP}`)")
    with plugin_errors(kind, "cannot be loaded"):
        make: MakeDetector = entry.load()
    return make


@contextmanager
def plugin_errors(kind: str, what: str) -> Iterator[None]:
    """Turn any exception of somebody else's code into a PluginError."""
    try:
        yield
    except Exception as error:
        raise PluginError(complaint(kind, f"{what}: {type(error).__name__}: {error}")) from error


def complaint(kind: str, what: str) -> str:
    """What is wrong with a kind of detector, with the package that brings it."""
    entry = installed_detectors().get(kind)
    return f"the detector `{kind}` of the package {'' if entry is None else package_of(entry)} {what}"


FRESH_PERIODS = 1.5
"""What an image shows counts for this many frame periods of its camera."""


@dataclass(frozen=True)
class FusedTruth:
    """The value of an atom from all cameras together."""

    truth: Truth
    """UNKNOWN where too few cameras can judge it, or as many contradict."""
    votes: Mapping[str, Truth]
    """Of each camera that can judge it."""
    conflict: bool
    """Whether images that were taken at the same time contradict each other."""


def fuse(atom: str, target: ProgramTarget, detections: Iterable[Detection]) -> FusedTruth:
    """The majority value of an atom, if it has as many cameras as the target requires."""
    judged = [(detection, vote) for detection in detections if (vote := detection.truth(atom)) != Truth.UNKNOWN]
    votes = {detection.camera: vote for detection, vote in judged}
    conflict = len({(detection.t, vote) for detection, vote in judged}) > len({detection.t for detection, _ in judged})
    yes, no = (sum(vote == value for vote in votes.values()) for value in (Truth.TRUE, Truth.FALSE))
    if max(yes, no) < target.cameras or yes == no:
        return FusedTruth(Truth.UNKNOWN, votes, conflict)
    return FusedTruth(Truth.TRUE if yes > no else Truth.FALSE, votes, conflict)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Images that were taken at one time."""

    t: float
    """On the cell's clock [s]."""
    tau: float | None
    """Of the step's motion [s], None before it."""
    truths: Mapping[str, bool]
    """Ground truth of all atoms, for checking only."""
    detections: dict[str, Detection | None] = field(default_factory=dict)
    """What the image of each camera shows, None for those that are under way."""

    @property
    def has_arrivals(self) -> bool:
        """Whether any of its images has arrived."""
        return any(detection is not None for detection in self.detections.values())


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the time of an exposure by all images that count then."""

    exposure: Exposure
    atoms: Mapping[str, FusedTruth]
    complete: bool
    """Whether no image that was taken by then is under way any more, so that nothing that is known will change."""

    @property
    def t(self) -> float:
        """On the cell's clock [s]."""
        return self.exposure.t

    @property
    def values(self) -> dict[str, Truth]:
        """Of atoms."""
        return {atom: fused.truth for atom, fused in self.atoms.items()}


class EvidenceBuffer:
    """The images that cameras took since a time; empty at first."""

    def __init__(self, cameras: Mapping[str, Camera]) -> None:
        self._lifetimes = {name: FRESH_PERIODS / camera.rate for name, camera in cameras.items()}
        self._exposures: list[Exposure] = []
        self._completed = -float("inf")

    def forget(self, t: float) -> None:
        """Drop all images that have arrived, and those under way that were taken before time t [s]."""
        self._exposures = [
            Exposure(one.t, one.tau, one.truths, {name: None for name, d in one.detections.items() if d is None})
            for one in self._exposures
            if one.t >= t - 1e-9
        ]

    def take(self, exposure: Exposure) -> None:
        """Images are under way; with others of the very same time they are one exposure."""
        index = bisect_left(self._exposures, exposure.t, key=lambda one: one.t)
        if index < len(self._exposures) and self._exposures[index].t == exposure.t:
            self._exposures[index].detections.update(exposure.detections)
        else:
            self._exposures.insert(index, exposure)

    def add(self, detection: Detection) -> Exposure | None:
        """An image has arrived. Returns the exposure that it belongs to, None if that was dropped."""
        for exposure in reversed(self._exposures):
            if exposure.t == detection.t and detection.camera in exposure.detections:
                exposure.detections[detection.camera] = detection
                return exposure
        return None

    def fused(self, targets: Mapping[str, ProgramTarget], settled: float = float("inf")) -> list[Evidence]:
        """The evidence of each exposure that was not complete before, up to the last of which an image has arrived.

        targets: by atom. settled: before when no image is under way that nobody knows of [s].
        """
        count = max((index + 1 for index, one in enumerate(self._exposures) if one.has_arrivals), default=0)
        found, complete, last = [], True, dict[str, Detection | None]()
        for exposure in self._exposures[:count]:
            last.update(exposure.detections)
            complete = complete and exposure.t < settled and None not in exposure.detections.values()
            if exposure.t > self._completed:
                arrived = [detection for detection in last.values() if detection is not None]
                counting = [one for one in arrived if exposure.t - one.t < self._lifetimes[one.camera]]
                atoms = {atom: fuse(atom, target, counting) for atom, target in targets.items()}
                found.append(Evidence(exposure, atoms, complete))
        self._completed = max((evidence.t for evidence in found if evidence.complete), default=self._completed)
        oldest = self._completed - max(self._lifetimes.values())
        self._exposures = [exposure for exposure in self._exposures if exposure.t > oldest]
        return found
