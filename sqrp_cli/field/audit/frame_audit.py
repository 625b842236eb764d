"""The prediction check on recorded images of a real cell."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Place, bad_input
from sqrp_cli.field.audit.bag_footage import Footage
from sqrp_cli.field.audit.footage import FARTHEST, Frame, Images
from sqrp_cli.field.audit.report import AuditDocument, AuditedCamera, MaybeLost
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program, Step
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.monitor.step_monitor import Attempt, PredictionCheck
from sqrp_cli.run.perception.detections import BelievedState, CellModel, Detection
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.record.report import Stopped
from sqrp_cli.run.robot_body import RobotBody

Known = TypeVar("Known")
AHEAD = 8  # Images that are looked at while others are read
LEAST_LOST = 3
"""Images, at least, that say of a literal to the end of a step that it is not as planned, for `MaybeLost`."""


def audit(
    program: Program,
    workspace: Workspace,
    footage: Footage,
    cameras: Mapping[str, AuditedCamera],
    threshold: float,
    image_done: Callable[[], None],
) -> AuditDocument:
    """Compare a recording with a program.

    cameras: what is known of them; images of clocks that are wrong are compared at the robot's times. Assumes that the
    robot is where the recording says, and that everything goes as planned while it is where the program wants it.
    Raises InputError for an image that cannot be used.
    """
    robot = RobotBody.load(workspace.robot)
    offsets = {name: one.clock.offset or 0.0 for name, one in cameras.items() if one.clock.wrong}
    checks, lost, looked = list[PredictionCheck](), list[MaybeLost](), list[list[tuple[float, Detection]]]()
    with DetectorPool(CellModel.of(workspace, robot)) as pool:
        for index, step in enumerate(program.steps):
            nominal = NominalStep(step, program.joints, robot)
            pool.watch(nominal.sought)
            frames, found = frames_of(footage, index, step, offsets), list[tuple[float, Detection]]()
            believed = partial(believed_in, step, footage.starts[index], nominal, footage)
            for frame, detection in detected(pool, footage.path, footage.images, frames, believed):
                image_done()
                found.append((frames[frame], detection))
            check, may_be_lost = _compared(index, nominal, list(workspace.cameras), found)
            checks.append(check)
            lost += may_be_lost
            looked.append(found)
    compared = sum(map(len, looked))
    begin, end = footage.starts[0], footage.starts[-1] + program.steps[-1].time
    apart = {}
    for camera in sorted(footage.recorded):
        t = np.array([frame.t for frame in footage.frames if frame.camera == camera])
        after = np.maximum(t - end, 0.0) + np.minimum(t - begin, 0.0)
        if len(t) and np.abs(after).min() > FARTHEST:
            apart[camera] = float(after[np.argmin(np.abs(after))])
    return AuditDocument(
        workspace=workspace.name,
        steps=[step.short_task for step in program.steps],
        says=[step.says for step in program.steps],
        times=[step.time for step in program.steps],
        images=compared,
        skipped=len(footage.frames) + footage.unplanned - compared - len(footage.damaged),
        repeated=sum(detection.frozen for found in looked for _, detection in found),
        until=[max((t for t, _ in found), default=None) for found in looked],
        runs=footage.runs,
        damaged=len(footage.damaged),
        damage=next(iter(footage.damaged.values()), None),
        apart=apart,
        missing=[name for name in workspace.cameras if name not in footage.recorded],
        other_topics=list(footage.other_topics),
        lost=lost,
        threshold=threshold,
        cameras=cameras,
        prediction=[check.counts for check in checks],
        usual=[check.usual for check in checks],
        disagreements=[found for check in checks for found in check.disagreements],
    )


def _compared(
    index: int, nominal: NominalStep, cameras: Collection[str], found: Sequence[tuple[float, Detection]]
) -> tuple[PredictionCheck, list[MaybeLost]]:
    """What images say of the predictions of a step, each with its time in the step [s], and what may be lost."""
    check, monitor = PredictionCheck(index, nominal, cameras), Attempt(nominal, 1.0)
    # By atom, the times of the images that say that it is not as planned, since the last that says it is.
    false_at: dict[str, list[float]] = {atom: [] for atom in nominal.step.targets}
    for t, detection in found:
        truths, asked = {atom: nominal.holds(atom, t) for atom in false_at}, monitor.monitored(t)
        check.add(detection, t, asked, truths)
        for atom in (atom for atom in asked if truths[atom]):
            seen = detection.truth(atom)
            if seen == Truth.FALSE:
                false_at[atom].append(t)
            elif seen == Truth.TRUE:
                false_at[atom].clear()
    return check, [
        MaybeLost(step=index + 1, t=min(times), atom=atom, images=len(times))
        for atom, times in false_at.items()
        if len(times) >= LEAST_LOST
    ]


def frames_of(footage: Footage, index: int, step: Step, offsets: Mapping[str, float]) -> dict[Frame, float]:
    """The images that were taken while a step went as planned, each with the time of the step [s]."""
    frames = list(footage.frames)
    t = np.array([frame.t - offsets.get(frame.camera, 0.0) for frame in frames])
    tau = t - footage.starts[index]
    # Times of files are rounded: the last image of a step may be some nanoseconds late.
    inside = (tau >= -1e-6) & (tau <= step.time + 1e-6)
    inside[inside] &= footage.as_planned(t[inside])
    return {frames[i]: float(np.clip(tau[i], 0.0, step.time)) for i in np.flatnonzero(inside)}


def believed_in(step: Step, start: float, nominal: NominalStep, footage: Footage, t: float) -> BelievedState:
    """Where the robot was, what it was commanded to hold, and where objects were, at a time of a step [s].

    start: of the step, by the robot's clock [s].
    """
    primitive = next((p for p in step.primitives if t <= p.end), step.primitives[-1])
    joints = {name: float(q[0]) for name, q in footage.joints(np.array([start + t])).items()}
    holding = primitive.held is not None or primitive.action == "Grasp"
    return BelievedState(joints, holding, nominal.object_poses(t))


def detected(
    pool: DetectorPool,
    path: Path,
    images: Images,
    frames: Mapping[Frame, Known],
    believed: Callable[[Known], BelievedState],
) -> Iterator[tuple[Frame, Detection]]:
    """What images of a recording show, in order; believed: by what is known of each.

    Raises InputError for one that is broken.
    """
    waiting: deque[Frame] = deque()
    try:
        for frame, image in images(list(frames)):
            pool.submit(image, believed(frames[frame]))
            waiting.append(frame)
            if len(waiting) > AHEAD:
                first = waiting.popleft()
                yield first, pool.collect(first.camera)
        yield from ((frame, pool.collect(frame.camera)) for frame in waiting)
    except Stopped as error:
        raise bad_input("perception", str(error), Place(path)) from error
