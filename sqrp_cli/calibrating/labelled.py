"""Labelled frames: images of which it is known what stood where, by a program that was run or by a file of labels.

`labels.csv` has a row for each object in each image: `camera`, `file` (a PNG beside it), `object`, its pose in the
world (`x`, `y`, `z` in metres, `qx`, `qy`, `qz`, `qw`), and if wanted `detector` (which looks for it; empty: it only
stands there), `there` (`no`: it was taken away, and the pose is where it would be), `vx`, `vy`, `vz` (its velocity in
m/s).
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import NoReturn

import numpy as np

from sqrp_cli.errors import Place, bad_input, expected_names
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import LARGEST, as_number
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, ProgramTarget
from sqrp_cli.runtime.audit.footage import Footage, Frame, ImageSource, read_image
from sqrp_cli.runtime.audit.frame_audit import Postures, frames_of
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.monitor.nominal_step import SPACING, NominalStep, values_when_open
from sqrp_cli.runtime.perception.detections import BelievedState, DetectionTargets
from sqrp_cli.runtime.record.images import LONGEST_NAME, file_in, table_text
from sqrp_cli.runtime.robot_body import RobotBody

SAME_POSE = 1.0
"""Images of a motion so close together [s] are learned from, or judged, together."""

FLAT = 1e-3
"""Thickness of the box around a marker [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LabelledImage:
    """An image, and where everything was."""

    frame: Frame
    believed: BelievedState
    """In the middle of the exposure."""
    opens: BelievedState
    """When the shutter opens."""
    closes: BelievedState
    """When it closes."""
    holds: Mapping[str, bool]
    """The true value of each atom that is looked for, without those that are just changing."""
    pose: int
    """Images with the same number have much the same pose."""


@dataclass(frozen=True, eq=False)
class LabelledImages:
    """Images in which the same is looked for, in the order in which they were taken."""

    source: ImageSource
    sought: DetectionTargets
    images: list[LabelledImage]


def of_program(program: Program, workspace: Workspace, footage: Footage) -> Iterator[LabelledImages]:
    """The images of a run that were taken while it went as the program says, step by step."""
    robot, first = RobotBody.load(workspace.robot), 0
    for index, step in enumerate(program.steps):
        nominal = NominalStep(step, program.joints, robot)
        postures = Postures(step, footage.starts[index], nominal, footage)
        images = []
        for frame, t in frames_of(footage, index, step, {}).items():
            half = 0.5 * workspace.cameras[frame.camera].exposure
            opens, closes = (postures.at(min(max(t + by, 0.0), step.time)) for by in (-half, half))
            holds = {atom: nominal.holds(atom, t) for atom in step.targets if not _changes(atom, t, nominal)}
            images.append(
                LabelledImage(
                    frame=frame,
                    believed=postures.at(t),
                    opens=opens,
                    closes=closes,
                    holds=holds,
                    pose=first + int(t / SAME_POSE),
                )
            )
        first += int(step.time / SAME_POSE) + 1
        sought = DetectionTargets(dict(step.targets), step.before.X_WO, values_when_open(step))
        yield LabelledImages(footage, sought, images)


def _changes(atom: str, t: float, nominal: NominalStep) -> bool:
    """Whether an atom changes while the tool closes or opens at time t [s]: from when on, nobody knows."""
    closing = (p for p in nominal.step.primitives if p.action in ("Grasp", "Release") and p.start <= t <= p.end)
    return any(nominal.holds(atom, p.start) != nominal.holds(atom, p.end + SPACING) for p in closing)


def of_labels(workspace: Workspace, folder: Path) -> Iterator[LabelledImages]:
    """The frames of a folder with a file of labels; whatever has no label stands where the workspace has it.

    Raises InputError for a folder that cannot be used.
    """
    files = groupby(read_labels(folder, workspace), lambda label: (label.camera, label.file))
    of_images = [list(labels) for _, labels in files]
    source = _Files(folder, workspace, [labels[0].file for labels in of_images])
    numbered = [
        (
            {
                _atom(label): ProgramTarget(cameras=1, boxes=(_box(workspace, label, label.detector),), seen={})
                for label in labels
                if label.detector
            },
            _image(workspace, labels, n),
        )
        for n, labels in enumerate(of_images)
    ]
    for _, found in groupby(numbered, lambda one: tuple(one[0])):
        targets, images = zip(*found, strict=True)
        yield LabelledImages(source, DetectionTargets(targets[0], {}, {}), list(images))


@dataclass(frozen=True, eq=False)
class _Files:
    """The PNG files of a folder."""

    path: Path
    workspace: Workspace
    files: Sequence[Path]
    """By the numbers of their frames."""

    def images(self, frames: Sequence[Frame]) -> Iterator[tuple[Frame, CameraImage]]:
        """As `ImageSource` says."""
        for frame in frames:
            yield frame, read_image(self.files[frame.number], self.workspace.cameras[frame.camera], frame.t)


def _image(workspace: Workspace, labels: list[Label], number: int) -> LabelledImage:
    camera, resting = workspace.cameras[labels[0].camera], workspace.stated_world

    def believed(t: float) -> BelievedState:
        moved = {label.object: pose(label.X_WO[:3, :3], label.X_WO[:3, 3] + t * label.velocity) for label in labels}
        return BelievedState(resting.joints, False, {**resting.X_WO, **moved})

    half = 0.5 * camera.exposure
    return LabelledImage(
        frame=Frame(camera.name, float(number), number),
        believed=believed(0.0),
        opens=believed(-half),
        closes=believed(half),
        holds={_atom(label): label.there for label in labels if label.detector},
        pose=number,
    )


def _atom(label: Label) -> str:
    return f"there({label.object})"


def _box(workspace: Workspace, label: Label, detector: str) -> TargetBox:
    """The marker on an object, or the object itself for a detector of colours or an object without a marker."""
    obj, kind = workspace.objects[label.object], workspace.detectors[detector].kind
    marker = None if kind == "color" else obj.printed_marker
    if marker is None:
        return TargetBox.on_object(label.object, detector, obj.size, read_only(pose()), None)
    top = read_only(pose(position=(0.0, 0.0, obj.size[2] / 2)))
    return TargetBox.on_object(label.object, detector, (marker.side, marker.side, FLAT), top, (0.0, 0.0, 1.0))


LABELS = "labels.csv"
"""The file of labels in a folder of frames."""

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_REQUIRED = ("camera", "file", "object", *_POSE)
_VELOCITY = ("vx", "vy", "vz")
_COLUMNS = (*_REQUIRED, "detector", "there", *_VELOCITY)


@dataclass(frozen=True, eq=False, kw_only=True)
class Label:
    """A row of the file: an object in an image."""

    camera: str
    file: Path
    object: str
    X_WO: Array
    """Where it is, or would be, shape (4, 4)."""
    velocity: Array
    """Shape (3,) [m/s]."""
    detector: str | None
    """That looks for it; None if it only stands there."""
    there: bool
    """Whether it really is there."""


def read_labels(folder: Path, workspace: Workspace) -> Iterator[Label]:
    """The rows of a folder's labels. Raises InputError for a file that is wrong, with its line."""
    path = folder / LABELS
    rows = csv.DictReader(io.StringIO(table_text(path), newline=""), strict=True)
    try:
        columns = rows.fieldnames or ()
        for name in (*columns, *_REQUIRED):
            if name not in _COLUMNS:
                message = f"there is a column {describe(name)}; {expected_names(name[:LONGEST_NAME], _COLUMNS)}"
                raise bad_input("wrong-columns", message, Place(path, 1))
            if name not in columns:
                message = f"there is no column `{name}`; expected {', '.join(_REQUIRED)}"
                raise bad_input("wrong-columns", message, Place(path, 1))
        for row in rows:
            yield _LabelRow(row, Place(path, rows.reader.line_num)).label(folder, workspace)
    except csv.Error as error:
        raise bad_input("wrong-value", f"this is no CSV: {error}", Place(path, rows.reader.line_num)) from error


@dataclass(frozen=True, eq=False)
class _LabelRow:
    values: Mapping[str | None, str | None]
    place: Place

    def label(self, folder: Path, workspace: Workspace) -> Label:
        if None in self.values or None in self.values.values():
            self._refuse("wrong-columns", "this row does not have one value for each column")
        numbers = np.array([self._number(name) for name in _POSE])
        if abs(math.hypot(*numbers[3:]) - 1.0) > 0.01:
            length = math.hypot(*numbers[3:])
            self._refuse("not-a-rotation", f"`qx` to `qw` have length {length:.3g}, expected 1 (order x, y, z, w)")
        detector, there = self._text("detector") or None, self._text("there") or "yes"
        if there not in ("yes", "no"):
            self._refuse("wrong-value", f"`there` is {describe(there)}, expected `yes` or `no`")
        if detector is not None:
            self._known("detector", workspace.detectors)
        self._known("camera", workspace.cameras)
        self._known("object", {n: o for n, o in workspace.objects.items() if o.X_WO is not None})
        return Label(
            camera=self._text("camera"),
            file=file_in(folder, self._text("file"), self.place),
            object=self._text("object"),
            X_WO=pose(quaternion_to_matrix(numbers[3:] / math.hypot(*numbers[3:])), numbers[:3]),
            velocity=np.array([self._number(name) if self._text(name) else 0.0 for name in _VELOCITY]),
            detector=detector,
            there=there == "yes",
        )

    def _text(self, name: str) -> str:
        return (self.values.get(name) or "").strip()

    def _known(self, column: str, names: Mapping[str, object]) -> None:
        found = self._text(column)
        if found not in names:
            message = f"there is no {column} {describe(found)}; {expected_names(found[:LONGEST_NAME], names)}"
            self._refuse(f"unknown-{column}", message)

    def _number(self, name: str) -> float:
        text = self._text(name)
        value = as_number(text)
        if not abs(value) <= LARGEST:
            message = f"`{name}` is {describe(text)}, expected a number of at most {LARGEST:g} in size"
            self._refuse("wrong-value", message)
        return value

    def _refuse(self, code: str, message: str) -> NoReturn:
        raise bad_input(code, message, self.place)
