"""What simulated cameras show of a motion that goes well, against what is promised: without physics, so quickly."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.record import Step
from sqrp_cli.run.cell.mujoco_model import build_model, mujoco, quaternion
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import placed_objects
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.monitor.nominal_step import NominalStep, values_when_open
from sqrp_cli.run.monitor.step_monitor import StepMonitor
from sqrp_cli.run.perception.detections import BelievedState, CellModel, Detection, DetectionTargets, fuse
from sqrp_cli.run.perception.image_detector import ImageDetector
from sqrp_cli.run.record.report import Confusion
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.study.assessment import Study, study
from sqrp_cli.study.program_update import make_step, with_usual_images
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import verdict
from sqrp_cli.task.task import read_task

PERIOD = 0.1
"""Between two images [s]."""


def without_colours(cell: Cell) -> Cell:
    """The cell as it was judged before colours counted."""
    observer = cell.observer
    plain = tuple(replace(solid, color=None) for solid in observer.solids)
    return replace(cell, observer=replace(observer, solids=plain))


def best_of(cell: Cell, task: str) -> Study | None:
    """The first-ranked candidate; None if there is none."""
    found = {}
    for candidate in read_task(task, cell.workspace).candidates:
        result = study(cell, candidate, cell.initial_world, Adaptive(), full=True)
        if not isinstance(result, Infeasible):
            found[candidate.name] = result
    ranked = rank([one.assessment(verdict(cell, one)) for one in found.values()], "q_eoi")
    return found[ranked[0].candidate.name] if ranked else None


def step_of(cell: Cell, result: Study, task: str) -> Step:
    """The step of a program for a candidate."""
    step = make_step(task, result, result.assessment(verdict(cell, result)), tuple(cell.workspace.cameras))
    return with_usual_images(step, result, cell.observer)


@dataclass(frozen=True)
class Tally:
    """Images of a motion, each counted for every literal that some formula requires then."""

    counts: Confusion
    """Promised, and seen."""
    rest: Confusion
    """Not promised, but usual, and seen."""
    misses: Counter[str]
    """Of the images that differ from the promise: literal, camera and reason."""
    stop: str | None
    """Why a run would stop because nothing is seen where it was promised."""


@dataclass(eq=False)
class Photos:
    """What the images of a motion show, one instant after the other."""

    workspace: Workspace
    joints: tuple[str, ...]
    """The arm's."""
    times: list[float] = field(default_factory=list)
    truths: list[Mapping[str, bool]] = field(default_factory=list)
    shown: list[Sequence[Detection]] = field(default_factory=list)

    def take(self, step: Step) -> None:
        """Draw every image of a step, and look at it."""
        workspace, body = self.workspace, RobotBody.load(self.workspace.robot)
        nominal, model = NominalStep(step, self.joints, body), build_model(workspace, placed_objects(step.before))
        renderer = Renderer(model, tuple(workspace.cameras.values()), 0)
        known = CellModel.of(workspace, body)
        detectors = {name: ImageDetector(camera, known) for name, camera in workspace.cameras.items()}
        for detector in detectors.values():
            detector.watch(DetectionTargets(dict(step.targets), step.before.X_WO, values_when_open(step)))
        for t in np.arange(0.0, step.time, PERIOD).tolist():
            primitive = next((p for p in step.primitives if t <= p.end), step.primitives[-1])
            q = primitive.trajectory.positions(np.array([t - primitive.start]))[0].tolist()
            joints = {**step.before.joints, **dict(zip(self.joints, q, strict=True))}
            X_WO, positions = nominal.object_poses(t), model.qpos0.copy()
            for name, value in joints.items():
                positions[model.joint(name).qposadr[0]] = value
            _follow(model, positions)
            for name, X in X_WO.items():
                if not workspace.objects[name].fixed:
                    at = int(model.joint(name).qposadr[0])
                    positions[at : at + 7] = *X[:3, 3], *quaternion(X)
            renderer.move(positions)
            holding = primitive.held is not None or primitive.action == "Grasp"
            believed = BelievedState(joints, holding, X_WO)
            images = [CameraImage(name, t, renderer.image(name, t)) for name in detectors]
            self.times.append(t)
            self.truths.append({atom: nominal.holds(atom, t) for atom in step.targets})
            self.shown.append([detectors[image.camera].look(image, believed) for image in images])
        renderer.close()

    def against(self, step: Step) -> Tally:
        """What was promised for the same motion against what the images show."""
        nominal = NominalStep(step, self.joints, RobotBody.load(self.workspace.robot))
        monitor, misses, stop = StepMonitor(nominal, PERIOD), Counter[str](), None
        counts, rest = Confusion(), Confusion()
        for t, truths, shown in zip(self.times, self.truths, self.shown, strict=True):
            for detection in shown:
                for atom in monitor.monitored(t):
                    seen = detection.truth(atom) == (Truth.TRUE if truths[atom] else Truth.FALSE)
                    promised = detection.camera in nominal.covering(atom, t)
                    usual = nominal.usually_shows(atom, detection.camera, t, value=truths[atom])
                    counts.add(promised, seen)
                    if not promised:
                        rest.add(usual, seen)
                    if seen != promised:
                        reason = detection.miss_reason(atom).value if promised else "more"
                        misses[f"{atom} {detection.camera} {reason} {truths[atom]}"] += 1
            values = {atom: fuse(atom, target, shown).truth for atom, target in step.targets.items()}
            alarm = monitor.observe(t, values)
            if alarm is not None and alarm.kind == "blindness" and stop is None:
                stop = f"{t:.1f} s: {alarm.text}"
        return Tally(counts, rest, misses, stop)


def _follow(model: mujoco.MjModel, positions: Array) -> None:
    """Bring the joints that mimic others to where these want them."""
    for index in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        follower, leader = (model.jnt_qposadr[ids[index]] for ids in (model.eq_obj1id, model.eq_obj2id))
        positions[follower] = model.eq_data[index, 0] + model.eq_data[index, 1] * positions[leader]
