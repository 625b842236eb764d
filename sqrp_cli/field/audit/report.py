"""The document of `audit`: what a recording says about predictions, cameras and their clocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Literal

from sqrp_cli.document import Pose, Record, WorkspaceDocument, live
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.report import Disagreement, Prediction, total_of


@dataclass(frozen=True, kw_only=True)
class AuditedClock(Record):
    """The clock of a camera compared with the robot's."""

    offset: float | None
    """By how much it is ahead [s]; null where the images show no motion by which to tell."""
    error: float | None
    """Standard deviation of that [s]; null with it."""
    wrong: bool
    """Whether it is wrong beyond doubt. Images are then compared at the robot's times."""


@dataclass(frozen=True, kw_only=True)
class AuditedPose(Record):
    """Where a camera is compared with where the workspace says."""

    turn: list[float]
    """Rotation vector of the change, in the camera's optical frame [rad]."""
    turn_error: list[float]
    """Standard deviations of that [rad]."""
    shift: list[float]
    """Shift of the camera, in its optical frame [m]."""
    shift_error: list[float]
    """Standard deviations of that [m]."""
    pixels: float
    """Root mean square of how far that moves edges in its images [pixels]."""
    residual: float
    """Standard deviation of edges from where they should be after that [pixels]."""
    points: int
    """Points of edges by which it was found."""
    moved: bool
    """Whether the camera has moved beyond doubt."""
    pose: Pose
    """The pose of the optical frame that the images show, 4x4 in the frame of the camera."""


@dataclass(frozen=True, kw_only=True)
class AuditedCamera(Record):
    """What images of a recording say of their camera."""

    images: int
    """In the recording."""
    clock: AuditedClock
    """Its clock compared with the robot's."""
    pose: AuditedPose | None
    """Null where images show too little of the cell to tell, or it has moved by more than can be found out."""

    @property
    def moved(self) -> bool:
        """Whether the camera is not where the workspace says, beyond doubt."""
        return self.pose is not None and self.pose.moved


@dataclass(frozen=True, kw_only=True)
class MaybeLost(Record):
    """A literal that was planned to be true, and false in every image that shows it from a time on."""

    step: int
    """From 1."""
    t: float
    """When the first of these images was taken [s], since the step's motion began."""
    atom: str
    """The literal, such as `hold(g1)`."""
    images: int
    """How many there are."""


@dataclass(frozen=True, kw_only=True, repr=False)
class AuditDocument(WorkspaceDocument):
    """What a recording says about the predictions of a program."""

    VIEW = "sqrp_cli.show.terminal.run_view:print_audit"

    document: Literal["audit"] = "audit"
    steps: list[str]
    """What each step of the program does."""
    says: list[Mapping[str, str]] = field(default_factory=list)
    """The facts of each step in words, such as `the tool holds g2`, by atom."""
    times: list[float]
    """How long the motion of each step takes [s]."""
    images: int
    """Images that were compared with predictions."""
    skipped: int
    """Images of times at which the step did not go as planned."""
    repeated: int
    """Images identical to the one before them."""
    until: list[float | None]
    """When the last image that was compared was taken, per step, in seconds of the step; null where none was. After it
    the recording ends, or the step did not go on as planned."""
    runs: int = 1
    """How often the program's motion is in the recording: runs, or a retry. The first one counts."""
    damaged: int = 0
    """Images that are damaged and were left out."""
    damage: str | None = None
    """What is wrong with the first of them; null without any."""
    apart: Mapping[str, float] = field(default_factory=dict)
    """How long after the robot's motion the images of a camera are [s], negative: before it; of cameras all of whose
    images are more than 3 s away from it, so that none was compared."""
    missing: list[str] = field(default_factory=list)
    """Cameras of the workspace that the recording has no images of; what was predicted of them is not compared."""
    other_topics: list[str] = field(default_factory=list)
    """Topics with images of no camera."""
    lost: list[MaybeLost] = field(default_factory=list)
    """What may have been lost without the arm leaving its path."""
    threshold: float
    """Least `precision` that passes, in 0..1."""
    precision: float | None = None
    """Share of the predicted images that showed the literal."""
    passed: bool = False
    """Whether `precision` is at least that, no camera is known to have moved, and no clock is wrong or `apart`."""
    cameras: Mapping[str, AuditedCamera]
    """By name; none without an OpenGL that draws."""
    unsurveyed: str | None = None
    """Why that is not known of any camera."""
    patch: str = ""
    """The change of the workspace file that puts cameras where they are; empty if none is known to have moved, or
    another file says where they are."""
    prediction: list[Prediction]
    """Per step, by literal and camera."""
    usual: list[Prediction]
    """Of the images that were not predicted to show a literal: usual images (`tp` + `fp`), of which `tp` showed it, and
    all others (`fn` + `tn`), of which `fn` did."""
    disagreements: list[Disagreement]
    """Images in which a prediction was wrong, usual images among them."""
    written: bool = live()
    """Whether the patch was written to a file."""

    def __post_init__(self) -> None:
        """What follows from the rest."""
        precision = total_of(self.prediction).precision
        passed = precision is not None and precision >= self.threshold and not self.not_as_stated
        object.__setattr__(self, "says", self.says or [{} for _ in self.steps])
        object.__setattr__(self, "precision", precision)
        object.__setattr__(self, "passed", passed)

    @property
    def not_as_stated(self) -> list[str]:
        """The cameras that are known to have moved, and the clocks that are wrong, in words."""
        moved = [f"{name} has moved" for name, one in self.cameras.items() if one.moved]
        wrong = {name for name, one in self.cameras.items() if one.clock.wrong} | {*self.apart}
        return [*moved, *(f"the clock of {name} is wrong" for name in sorted(wrong))]

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        came_true = "nothing was predicted"
        if self.precision is not None:
            came_true = f"{100 * self.precision:.1f} % of predicted images showed it"
        passed = "passed" if self.passed else "not passed"
        return ", ".join([f"{self.workspace}: {came_true}", *self.not_as_stated, passed])
