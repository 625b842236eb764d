"""Labelled frames: images of which it is known what stood where, by a program that was run or by a file of labels.

`labels.csv` has a row for each object in each image: `camera`, `file` (a PNG beside it), `object`, its pose in the
world (`x`, `y`, `z` in metres, `qx`, `qy`, `qz`, `qw`), and if wanted `detector` (which looks for it; empty: it only
stands there), `there` (`no`: it was taken away, and the pose is where it would be), `vx`, `vy`, `vz` (its velocity in
m/s).

Detectors look at them, and what they say of each box is kept with how the camera saw it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import numpy as np

from sqrp_cli.camera.detector import COEFFICIENTS, Curve
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Place, bad_input, expected_names
from sqrp_cli.field.audit.bag_footage import Footage
from sqrp_cli.field.audit.footage import Frame, Images, read_files
from sqrp_cli.field.audit.frame_audit import believed_in, detected, frames_of
from sqrp_cli.field.calibrating.fit import DetectorLooks
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.frames import frame_poses
from sqrp_cli.files.source import describe
from sqrp_cli.files.units import LARGEST, as_number
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only, wrong_length
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.record import Program, ProgramTarget
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.nominal_step import SPACING, NominalStep
from sqrp_cli.run.perception.detections import BelievedState, CellModel, Detection, DetectionTargets
from sqrp_cli.run.perception.image_detector import DetectorPool
from sqrp_cli.run.record.images import LONGEST_NAME, file_in, table_rows
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.sight.likelihood import likelihoods
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox, Target
from sqrp_cli.skill.target_box import TargetBox

SAME_POSE = 1.0  # Images of a motion so close together [s] are learned from, or judged, together
FLAT = 1e-3  # Thickness of the box around a marker [m]
LABELS = "labels.csv"  # The file of labels in a folder of frames
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_REQUIRED = ("camera", "file", "object", *_POSE)
_VELOCITY = ("vx", "vy", "vz")
_COLUMNS = (*_REQUIRED, "detector", "there", *_VELOCITY)


@dataclass(frozen=True, eq=False, kw_only=True)
class LabelledImage:
    """An image, and where everything was: in the middle of the exposure, when the shutter opens and when it closes.

    holds: the true value of each atom that is looked for, without those that are just changing.
    pose: images with the same number have much the same pose.
    """

    frame: Frame
    believed: BelievedState
    opens: BelievedState
    closes: BelievedState
    holds: Mapping[str, bool]
    pose: int


@dataclass(frozen=True, eq=False)
class LabelledImages:
    """Images in which the same is looked for, in the order in which they were taken."""

    path: Path  # of the recording, or of the folder of files
    read: Images
    sought: DetectionTargets
    images: list[LabelledImage]


def of_program(program: Program, workspace: Workspace, footage: Footage) -> Iterator[LabelledImages]:
    """The images of a run that were taken while it went as the program says, step by step."""
    robot, first = RobotBody.load(workspace.robot), 0
    for index, step in enumerate(program.steps):
        nominal = NominalStep(step, program.joints, robot)
        believed = partial(believed_in, step, footage.starts[index], nominal, footage)
        images = []
        for frame, t in frames_of(footage, index, step, {}).items():
            half = 0.5 * workspace.cameras[frame.camera].exposure
            opens, closes = (believed(min(max(t + by, 0.0), step.time)) for by in (-half, half))
            # While the tool closes or opens nobody knows from when on an atom is that this changes.
            closing = [p for p in step.primitives if p.action in ("Grasp", "Release") and p.start <= t <= p.end]
            holds = {
                atom: nominal.holds(atom, t)
                for atom in step.targets
                if all(nominal.holds(atom, p.start) == nominal.holds(atom, p.end + SPACING) for p in closing)
            }
            here = {"believed": believed(t), "opens": opens, "closes": closes}
            images.append(LabelledImage(frame=frame, holds=holds, pose=first + int(t / SAME_POSE), **here))
        first += int(step.time / SAME_POSE) + 1
        yield LabelledImages(footage.path, footage.images, nominal.sought, images)


def of_labels(workspace: Workspace, folder: Path) -> Iterator[LabelledImages]:
    """The frames of a folder with a file of labels; whatever has no label stands where the workspace has it.

    Raises InputError for a folder that cannot be used.
    """
    by_file = groupby(read_labels(folder, workspace), lambda label: (label.camera, label.file))
    of_images = [list(labels) for _, labels in by_file]
    read = partial(read_files, workspace, [labels[0].file for labels in of_images])
    resting, numbered = workspace.stated_world, []
    for number, labels in enumerate(of_images):
        targets, states, camera = {}, [], workspace.cameras[labels[0].camera]
        for t in (0.0, -0.5 * camera.exposure, 0.5 * camera.exposure):
            moved = {one.object: pose(one.X_WO[:3, :3], one.X_WO[:3, 3] + t * one.velocity) for one in labels}
            states.append(BelievedState(resting.joints, False, {**resting.X_WO, **moved}))
        for label in labels:
            if label.detector:  # it looks for the marker on the object, or for the object itself where it has none
                obj, kind = workspace.objects[label.object], workspace.detectors[label.detector].kind
                size, X_OB, normal = obj.size, pose(), None
                if kind != "color" and obj.printed_marker is not None:
                    side, normal = obj.printed_marker.side, (0.0, 0.0, 1.0)
                    size, X_OB = (side, side, FLAT), pose(position=(0.0, 0.0, obj.size[2] / 2))
                shape = {"size": size, "X_FB": read_only(X_OB), "normal": normal}
                box = TargetBox.on_object(label.object, detector=label.detector, **shape)
                targets[f"there({label.object})"] = ProgramTarget(cameras=1, boxes=(box,), seen={})
        image = LabelledImage(
            frame=Frame(camera.name, float(number), number),
            believed=states[0],
            opens=states[1],
            closes=states[2],
            holds={f"there({label.object})": label.there for label in labels if label.detector},
            pose=number,
        )
        numbered.append((targets, image))
    for _, found in groupby(numbered, lambda one: tuple(one[0])):
        alike, images = zip(*found, strict=True)
        yield LabelledImages(folder, read, DetectionTargets(alike[0], {}, {}), list(images))


@dataclass(frozen=True, eq=False, kw_only=True)
class Label:
    """A row of the file: an object in an image.

    X_WO: where it is, or would be, shape (4, 4). velocity: shape (3,) [m/s]. detector: that looks for it; None if it
    only stands there. there: whether it really is there.
    """

    camera: str
    file: Path
    object: str
    X_WO: Array
    velocity: Array
    detector: str | None
    there: bool


def read_labels(folder: Path, workspace: Workspace) -> Iterator[Label]:
    """The rows of a folder's labels. Raises InputError for a file that is wrong, with its line."""
    rows = table_rows(folder / LABELS)
    place, columns = next(rows, (Place(folder / LABELS, 1), []))
    for name in (*columns, *_REQUIRED):
        if name not in _COLUMNS:
            message = f"there is a column {describe(name)}; {expected_names(name[:LONGEST_NAME], _COLUMNS)}"
            raise bad_input("wrong-columns", message, place)
        if name not in columns:
            message = f"there is no column `{name}`; expected {', '.join(_REQUIRED)}"
            raise bad_input("wrong-columns", message, place)
    placed = {name: one for name, one in workspace.objects.items() if one.X_WO is not None}
    known = (("detector", workspace.detectors), ("camera", workspace.cameras), ("object", placed))
    for place, row in rows:
        if len(row) != len(columns):
            raise bad_input("wrong-columns", "this row does not have one value for each column", place)
        texts = dict.fromkeys(_COLUMNS, "") | {name: text.strip() for name, text in zip(columns, row, strict=True)}
        stated = [name for name in (*_POSE, *_VELOCITY) if name in _POSE or texts[name]]
        numbers = {name: as_number(texts[name]) for name in stated}
        for name, value in numbers.items():
            if not abs(value) <= LARGEST:
                message = f"`{name}` is {describe(texts[name])}, expected a number of at most {LARGEST:g} in size"
                raise bad_input("wrong-value", message, place)
        x, y, z, *quaternion = (numbers[name] for name in _POSE)
        if why := wrong_length(quaternion):
            raise bad_input("not-a-rotation", f"the quaternion of `qx` to `qw` {why}", place)
        if texts["there"] not in ("yes", "no", ""):
            raise bad_input("wrong-value", f"`there` is {describe(texts['there'])}, expected `yes` or `no`", place)
        for column, names in known:
            if (found := texts[column]) not in names and (found or column != "detector"):
                message = f"there is no {column} {describe(found)}; {expected_names(found[:LONGEST_NAME], names)}"
                raise bad_input(f"unknown-{column}", message, place)
        yield Label(
            camera=texts["camera"],
            file=file_in(folder, texts["file"], place),
            object=texts["object"],
            X_WO=pose(quaternion_to_matrix(quaternion), (x, y, z)),
            velocity=np.array([numbers.get(name, 0.0) for name in _VELOCITY]),
            detector=texts["detector"] or None,
            there=texts["there"] != "no",
        )


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
            for frame, detection in detected(pool, together.path, together.read, images, attrgetter("believed")):
                shown.append((images[frame], detection))
                image_done()
            for name in workspace.cameras:
                of_camera = [one for one in shown if one[0].frame.camera == name and not one[1].frozen]
                if of_camera:
                    for detector, looks in _of_camera(cell, robot, together, of_camera):
                        found.setdefault(detector, []).append(looks)
    names = [field.name for field in fields(DetectorLooks)]
    return {
        detector: DetectorLooks(**{n: np.concatenate([getattr(one, n) for one in looks], axis=-1) for n in names})
        for detector, looks in sorted(found.items())
    }


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
            from_fields(SoughtBox, box, limits=workspace.detectors[box.detector]).with_color(name, workspace.objects)
            for box in stated.boxes
        ]
        targets.append(Target(Atom.of(name), stated.cameras, tuple(boxes)))
        open_boxes = (replace(box, limits=replace(box.limits, curve=_EVERY_TERM)) for box in boxes)
        unlimited.append(replace(targets[-1], boxes=tuple(open_boxes)))
    shutters = {camera.exposure: (opens, closes)} if camera.exposure else {}
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
                sights=of_box.sights[:, :, 0],
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
    fixed = {name: X[None] for name, X in starts.items()}
    return SceneStates(len(believed), frame_poses(links, objects, fixed, pose()[None]))
