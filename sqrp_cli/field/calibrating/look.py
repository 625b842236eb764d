"""Looks at labelled frames: what detectors said of each box, and how the camera saw it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from sqrp_cli.camera.detector import COEFFICIENTS, BoxSights, Curve
from sqrp_cli.field.audit.frame_audit import detected
from sqrp_cli.field.calibrating.fit import DetectorLooks
from sqrp_cli.field.calibrating.labelled import LabelledImage, LabelledImages
from sqrp_cli.files.entries import completed
from sqrp_cli.files.frames import frame_poses
from sqrp_cli.geometry import Array
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.motion.cell import Cell
from sqrp_cli.run.perception.detections import BelievedState, CellModel, Detection
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.sight.likelihood import Shutter, likelihoods
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates, fixed_frame
from sqrp_cli.sight.targets import SoughtBox, Target

_EVERY_TERM = Curve(bias=0.0, **dict.fromkeys(COEFFICIENTS, 0.0))
"""A curve that replaces every limit: how a box is seen counts everywhere."""


def look_at_frames(
    cell: Cell, folder: Sequence[LabelledImages], image_done: Callable[[], None]
) -> dict[str, DetectorLooks]:
    """What each detector saw, by its name. Raises InputError for an image that cannot be looked at."""
    workspace = cell.workspace
    robot, found = RobotBody.load(workspace.robot), dict[str, list[DetectorLooks]]()
    with DetectorPool(CellModel.of(workspace, robot)) as pool:
        for together in folder:
            pool.watch(together.sought)
            images = {image.frame: image for image in together.images}
            shown: list[tuple[LabelledImage, Detection]] = []
            for frame, detection in detected(pool, together.source, images, attrgetter("believed")):
                shown.append((images[frame], detection))
                image_done()
            for name in workspace.cameras:
                of_camera = [one for one in shown if one[0].frame.camera == name and not one[1].frozen]
                if of_camera:
                    for detector, looks in _of_camera(cell, robot, together, of_camera):
                        found.setdefault(detector, []).append(looks)
    return {name: DetectorLooks.joined(looks) for name, looks in sorted(found.items())}


def _of_camera(
    cell: Cell, robot: RobotBody, together: LabelledImages, shown: Sequence[tuple[LabelledImage, Detection]]
) -> Iterator[tuple[str, DetectorLooks]]:
    """The boxes in the images of one camera, each with its detector, those looks alone that count."""
    images = [image for image, _ in shown]
    workspace, sought = cell.workspace, together.sought
    camera = workspace.cameras[images[0].frame.camera]
    observer = replace(cell.observer, cameras=(camera,))
    states, opens, closes = (
        _states(robot, [getattr(image, when) for image in images], sought.starts)
        for when in ("believed", "opens", "closes")
    )
    targets, unlimited = [], []  # the latter with a curve in place of every limit
    for name, stated in sought.targets.items():
        boxes = [
            completed(SoughtBox, box, limits=workspace.detectors[box.detector]).with_color(name, workspace.objects)
            for box in stated.boxes
        ]
        targets.append(Target(Atom.of(name), stated.cameras, tuple(boxes)))
        open_boxes = (replace(box, limits=replace(box.limits, curve=_EVERY_TERM)) for box in boxes)
        unlimited.append(replace(targets[-1], boxes=tuple(open_boxes)))
    shutters = {camera.exposure: Shutter(opens, closes)} if camera.exposure else {}
    free = likelihoods(observer, unlimited, states, shutters)
    limited = observer.verdicts(targets, states, shares=False)
    pose = np.array([image.pose for image in images])
    for target, of_boxes, verdicts in zip(targets, free, limited, strict=True):
        atom = str(target.atom)
        is_known = np.array([atom in image.holds for image in images])
        true = np.array([Truth.TRUE if image.holds.get(atom) else Truth.FALSE for image in images])
        for box, of_box, verdict in zip(target.boxes, of_boxes, verdicts, strict=True):
            assert of_box.sights is not None  # noqa: S101 - every box has a curve here
            found = (next(one for one in detection.boxes[atom] if one.name == box.name) for _, detection in shown)
            looks = DetectorLooks(
                sights=BoxSights(*(values[:, 0] for values in of_box.sights)),
                seen=np.array([one.evidence for one in found]) == true,
                covered=verdict.cause[:, 0] == Cause.NONE,
                pose=pose,
            )
            yield box.detector, looks.some(is_known & (of_box.probability[:, 0] > 0))


def _states(robot: RobotBody, believed: Sequence[BelievedState], starts: Mapping[str, Array]) -> SceneStates:
    """Where everything was in several images."""
    X_WL = [robot.link_poses(one.joints) for one in believed]
    links = {link: np.stack([X[link] for X in X_WL]) for link in X_WL[0]}
    objects = {name: np.stack([one.X_WO[name] for one in believed]) for name in believed[0].X_WO}
    fixed = {name: fixed_frame(X) for name, X in starts.items()}
    return SceneStates(len(believed), frame_poses(links, objects, fixed, fixed_frame()))
