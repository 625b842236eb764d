"""`run`, `audit` and `calibrate`: what happened, which predictions came true, and what images say about detectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from sqrp_cli.calibrating.fit import Judged
from sqrp_cli.document import LEFT_OUT, Record, WorkspaceDocument
from sqrp_cli.knowledge.camera.detector import Curve
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.runtime.record.report import Confusion, Disagreement, Outcome, RunReport, StepRecord

if TYPE_CHECKING:
    from sqrp_cli.runtime.audit.frame_audit import AuditReport
    from sqrp_cli.runtime.audit.survey import CameraSurvey
    from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary


Counts = Mapping[str, Mapping[str, Confusion]]
"""By literal and camera."""


@dataclass(frozen=True, kw_only=True)
class Fault(Record):
    """A fault with its times on the run's clock [s]; null for what never happened."""

    name: str
    """As the skill calls it, or what was injected; of a violation that the skill lets pass, its formula."""
    injected: float | None
    """When it was injected [s]."""
    happened: float | None
    """When the fault's formula became true in the cell [s]."""
    detected: float | None
    """When the images showed it [s]; of a camera's fault, when the robot stopped for it."""
    acted: float | None
    """When the robot began to respond [s]: to try again, or to stop."""
    recovered: float | None
    """When the step was finally done [s]."""
    predicted_delay: float | None
    """From `happened` to `detected` as the program predicts it [s]."""
    moved_on: float | None
    """How long the robot moved on to look, after `detected` [s]."""
    camera: str | None
    """The camera that failed; null for a fault of the step."""
    kind: str | None
    """What was injected, such as `miss-pick`; null if nothing was."""
    delay: float | None
    """From `happened` to `detected` [s]."""


@dataclass(frozen=True, kw_only=True)
class StopTimes(Record):
    """When the robot was last commanded to stop, and when it stood still [s]."""

    told: float | None
    """When the robot was last commanded to stop [s]; null if it never was."""
    standing: float | None
    """When it stood still after that [s]; null if it never was commanded to stop."""


@dataclass(frozen=True, kw_only=True, repr=False)
class RunDocument(WorkspaceDocument):
    """How a run went."""

    document: Literal["run"] = "run"
    outcome: Outcome
    """Whether all steps were done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    reason: str | None
    """Why it stopped, or what was not noticed; null if it is done."""
    time: float
    """Simulated [s]."""
    steps: list[StepRecord]
    """As they were run, in order; a step that was not begun is missing."""
    faults: list[Fault]
    """Those that were injected or seen."""
    prediction: list[Counts]
    """Per step, of its first attempt."""
    usual: list[Counts]
    """Of the images that were not predicted to show a literal: usual images (`tp` + `fp`), of which `tp` showed it, and
    all others (`fn` + `tn`), of which `fn` did."""
    disagreements: list[Disagreement]
    """Images in which a prediction was wrong, usual images among them."""
    conflicts: int
    """How often cameras contradicted each other about an atom."""
    stop: StopTimes
    """The last stop that was commanded."""
    tracking: float | None
    """Rms distance of the tool from where it should have been [m]."""
    images: int
    """How many images the cameras took."""
    wall: Mapping[str, float]
    """Where wall-clock time went [s]."""

    @classmethod
    def of(cls, workspace: str, report: RunReport) -> RunDocument:
        """A run in a workspace."""
        return completed(
            cls,
            report,
            workspace=workspace,
            faults=[completed(Fault, fault) for fault in report.faults],
            stop=StopTimes(told=report.stop_told, standing=report.stop_done),
        )


@dataclass(frozen=True, kw_only=True)
class _SweptBefore(Record):
    x: float
    """When the fault was injected, in seconds of the step."""
    outcome: Outcome
    """Whether all steps were done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    time: float
    """Simulated [s]."""


@dataclass(frozen=True, kw_only=True)
class SweptRun(Fault, _SweptBefore):
    """A run of a sweep."""


@dataclass(frozen=True, kw_only=True, repr=False)
class SweepDocument(WorkspaceDocument):
    """What `sqrp run --sweep` finds."""

    document: Literal["run --sweep"] = "run --sweep"
    sweep: str
    """What was swept, such as `slip@a4`."""
    step: int
    """Number of the step that was swept."""
    tolerance: float
    """A delay that is shorter than its prediction by more counts as sooner [s]."""
    predictable: int
    """Runs in which the fault came true and was predicted to be seen."""
    seen: int
    """Runs among them in which it was seen."""
    as_predicted: int
    """Runs among those in which it was seen within the longest delay predicted, by `tolerance` sooner at most."""
    sooner: int
    """Runs in which it was seen sooner than that."""
    later: int
    """Runs in which it was seen later than predicted at worst, by more than a step of the physics (2 ms)."""
    runs: list[SweptRun]
    """In the order of `x`."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all runs were finished."""

    @classmethod
    def of(
        cls,
        workspace: str,
        text: str,
        step: int,
        runs: Sequence[SweepRun],
        summary: SweepSummary,
        *,
        interrupted: bool = False,
    ) -> SweepDocument:
        """The runs of a sweep. step: the number of the one that was swept."""
        swept = [completed(SweptRun, run, run.report, run.fault) for run in runs]
        stated = {"workspace": workspace, "sweep": text, "step": step, "interrupted": interrupted or None}
        return completed(cls, summary, runs=swept, **stated)


@dataclass(frozen=True, kw_only=True)
class AuditedClock(Record):
    """The clock of a camera beside the robot's."""

    offset: float | None
    """By how much it is ahead [s]; null where the images show no motion by which to tell."""
    error: float | None
    """Standard deviation of that [s]; null with it."""
    wrong: bool
    """Whether it is wrong beyond doubt. Images are then compared at the robot's times."""


@dataclass(frozen=True, kw_only=True)
class AuditedPose(Record):
    """Where a camera is beside where the workspace says."""

    turn: Sequence[float]
    """Rotation vector of the change, in the camera's optical frame [rad]."""
    turn_error: Sequence[float]
    """Standard deviations of that [rad]."""
    shift: Sequence[float]
    """Shift of the camera, in its optical frame [m]."""
    shift_error: Sequence[float]
    """Standard deviations of that [m]."""
    pixels: float
    """Root mean square of how far that moves edges in its images [pixels]."""
    residual: float
    """Standard deviation of edges from where they should be after that [pixels]."""
    points: int
    """Points of edges by which it was found."""
    moved: bool
    """Whether the camera has moved beyond doubt."""
    pose: Sequence[Sequence[float]]
    """The pose of the optical frame that the images show, 4x4 in the frame of the camera."""


@dataclass(frozen=True, kw_only=True)
class AuditedCamera(Record):
    """What images of a recording say of their camera."""

    images: int
    """In the recording."""
    clock: AuditedClock
    """Its clock beside the robot's."""
    pose: AuditedPose | None
    """Null where images show too little of the cell to tell, or it has moved by more than can be found out."""

    @classmethod
    def of(cls, survey: CameraSurvey) -> AuditedCamera:
        """A camera that was surveyed."""
        known = survey.offset is not None
        clock = AuditedClock(
            offset=survey.offset, error=survey.offset_error if known else None, wrong=survey.has_wrong_clock
        )
        fit = survey.fit
        if fit is None:
            return cls(images=survey.images, clock=clock, pose=None)
        pose = completed(
            AuditedPose,
            fit,
            turn=fit.change[:3].tolist(),
            turn_error=fit.deviations[:3].tolist(),
            shift=fit.change[3:6].tolist(),
            shift_error=fit.deviations[3:6].tolist(),
            moved=survey.has_moved,
            pose=survey.X_FC.tolist(),
        )
        return cls(images=survey.images, clock=clock, pose=pose)


@dataclass(frozen=True, kw_only=True, repr=False)
class AuditDocument(WorkspaceDocument):
    """What a recording says about predictions."""

    document: Literal["audit"] = "audit"
    images: int
    """Images that were compared with predictions."""
    skipped: int
    """Images of times at which the step did not go as planned."""
    repeated: int
    """Images identical to the one before them."""
    until: Sequence[float | None]
    """When the last image that was compared was taken, per step, in seconds of the step; null where none was. After it
    the recording ends, or the step did not go on as planned."""
    runs: int
    """How often the program's motion is in the recording: runs, or a retry. The first one counts."""
    damaged: int
    """Images that are damaged and were left out."""
    apart: Mapping[str, float]
    """How long after the robot's motion the images of a camera are [s], negative: before it; of cameras all of whose
    images are more than 3 s away from it, so that none was compared."""
    missing: list[str]
    """Cameras of the workspace that the recording has no images of; what was predicted of them is not compared."""
    other_topics: list[str]
    """Topics with images of no camera."""
    precision: float | None
    """Share of the predicted images that showed the literal."""
    threshold: float
    """Least `precision` that passes, in 0..1."""
    passed: bool
    """Whether `precision` is at least that, no camera is known to have moved, and no clock is wrong or `apart`."""
    cameras: Mapping[str, AuditedCamera]
    """By name; none without an OpenGL that draws."""
    patch: str
    """The change of the workspace file that puts cameras where they are; empty if none is known to have moved, or
    another file says where they are."""
    prediction: list[Counts]
    """Per step."""
    usual: list[Counts]
    """Of the images that were not predicted to show a literal: usual images (`tp` + `fp`), of which `tp` showed it, and
    all others (`fn` + `tn`), of which `fn` did."""
    disagreements: list[Disagreement]
    """Images in which a prediction was wrong, usual images among them."""

    @classmethod
    def of(
        cls,
        workspace: str,
        report: AuditReport,
        threshold: float,
        cameras: Mapping[str, CameraSurvey],
        passed: bool,
        patch: str,
    ) -> AuditDocument:
        """An audit of a recording."""
        return completed(
            cls,
            report,
            workspace=workspace,
            damaged=len(report.damaged),
            precision=report.total.precision,
            threshold=threshold,
            passed=passed,
            cameras={name: AuditedCamera.of(one) for name, one in cameras.items()},
            patch=patch,
        )


@dataclass(frozen=True, kw_only=True)
class CalibratedDetector(Record):
    """What frames say about one detector."""

    looks: int
    """How often it looked at a box that was in range, in the image and not all hidden."""
    seen: float
    """Share of them in which it said what was true, in 0..1."""
    curve: Curve | None
    """Learned from all frames; null where these are too few."""
    held_out: Judged | None
    """The probabilities of each fifth of the poses by the curve that the others teach, compared with what was seen."""
    limits: Judged | None
    """The limits of the workspace, as probabilities of 1 and 0, compared with what was seen; null without looks."""
    reason: str | None
    """Why there is no curve."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CalibrateDocument(WorkspaceDocument):
    """What `sqrp calibrate` finds."""

    VIEW = "sqrp_cli.terminal.audit_view:print_calibration"

    document: Literal["calibrate"] = "calibrate"
    images: int
    """How many were looked at."""
    detectors: Mapping[str, CalibratedDetector]
    """By name, those that looked for anything."""
    patch: str
    """A unified diff that gives the workspace these curves; empty where there are none."""
