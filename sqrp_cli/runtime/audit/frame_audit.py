"""The prediction check on recorded frames of a real cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, Step
from sqrp_cli.runtime.image import CameraImage, check_recorded
from sqrp_cli.runtime.monitor.nominal_step import NominalStep, values_when_open
from sqrp_cli.runtime.monitor.prediction_check import PredictionCheck
from sqrp_cli.runtime.monitor.step_monitor import StepMonitor
from sqrp_cli.runtime.perception.detections import BelievedState, CellModel, Detection, DetectionTargets
from sqrp_cli.runtime.perception.detector_pool import DetectorPool, PerceptionError
from sqrp_cli.runtime.record.frame_folder import FrameEntry, read_frames
from sqrp_cli.runtime.record.png import ImageSize, bare_png, decoded, png_damage, read_png
from sqrp_cli.runtime.record.report import Confusion, Disagreement, Prediction
from sqrp_cli.runtime.robot_body import RobotBody


@dataclass(frozen=True)
class AuditReport:
    """What recorded frames say about a program's predictions."""

    prediction: tuple[Prediction, ...]
    disagreements: tuple[Disagreement, ...]
    images: int
    """How many were compared."""
    skipped: int
    """How many were taken when the step did not go as planned."""
    repeated: int
    """How many were identical to the image before them."""

    @property
    def total(self) -> Confusion:
        """Over all steps, atoms and cameras."""
        return sum((c for step in self.prediction for cameras in step.values() for c in cameras.values()), Confusion())


def audit(program: Program, workspace: Workspace, folder: Path, image_done: Callable[[], None]) -> AuditReport:
    """Compare a folder of frames (see `recording`) with a program.

    Assumes that at each frame's time the robot is where the program wants it, and everything goes as planned. Raises
    InputError for a folder or an image that cannot be used.
    """
    entries = list(read_frames(folder, list(workspace.cameras), len(program.steps)))
    check_recorded(workspace, {entry.camera for entry in entries})
    robot = RobotBody.load(workspace.robot)
    checks = []
    compared = skipped = repeated = 0
    with DetectorPool(CellModel.of(workspace, robot)) as pool:
        for index, step in enumerate(program.steps):
            nominal = NominalStep(step, program.joints, robot)
            monitor = StepMonitor(nominal, 1.0)
            check = PredictionCheck(index, nominal, list(workspace.cameras))
            checks.append(check)
            pool.watch(DetectionTargets(dict(step.targets), step.before.X_WO, values_when_open(step)))
            for entry in (entry for entry in entries if entry.step == index + 1):
                image_done()
                if entry.t is None or not 0.0 <= entry.t <= step.time:
                    skipped += 1
                    continue
                posture = _posture(step, program.joints, nominal, entry.t)
                detection = _detected(pool, entry, workspace, posture)
                repeated += detection.frozen
                compared += 1
                truths = {atom: nominal.holds(atom, entry.t) for atom in step.targets}
                check.add(detection, entry.t, monitor.monitored(entry.t), truths)
    return AuditReport(
        tuple(check.counts for check in checks),
        tuple(found for check in checks for found in check.disagreements),
        compared,
        skipped,
        repeated,
    )


def _frame(entry: FrameEntry, workspace: Workspace) -> CameraImage:
    camera = workspace.cameras[entry.camera]
    content = read_png(entry.file, ImageSize(camera.width, camera.height), camera.name)
    damage = png_damage(content)
    image = None if damage else decoded(bare_png(content))
    if image is None:
        message = f"this is no PNG file, or a damaged one: {damage or 'it cannot be decoded'}"
        raise InputError(Problem("unreadable", message, Place(entry.file)))
    return CameraImage(entry.camera, entry.t or 0.0, image)


def _detected(pool: DetectorPool, entry: FrameEntry, workspace: Workspace, posture: BelievedState) -> Detection:
    """What a recorded frame shows. Raises InputError where it cannot be looked at."""
    try:
        pool.submit(_frame(entry, workspace), posture)
        return pool.collect(entry.camera)
    except PerceptionError as error:
        raise InputError(Problem("perception", str(error), Place(entry.file))) from error


def _posture(step: Step, joints: tuple[str, ...], nominal: NominalStep, t: float) -> BelievedState:
    """Where the robot is by the program, what it was commanded to hold, and where objects are."""
    primitive = next((p for p in step.primitives if t <= p.end), step.primitives[-1])
    q = primitive.trajectory.positions(np.array([t - primitive.start]))[0]
    holding = primitive.held is not None or primitive.action == "Grasp"
    return BelievedState(dict(zip(joints, q.tolist(), strict=True)), holding, nominal.object_poses(t))
