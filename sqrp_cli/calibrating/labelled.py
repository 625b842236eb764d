"""Labelled frames: images of which it is known what stood where, by a program that was run or by a file of labels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from sqrp_cli.calibrating.labels_file import Label, read_labels
from sqrp_cli.geometry import pose, read_only
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, ProgramTarget
from sqrp_cli.runtime.audit.footage import Footage, Frame, ImageSource, read_image
from sqrp_cli.runtime.audit.frame_audit import Postures, frames_of
from sqrp_cli.runtime.image import CameraImage
from sqrp_cli.runtime.monitor.nominal_step import NominalStep, values_when_open
from sqrp_cli.runtime.perception.detections import BelievedState, DetectionTargets
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
    """The true value of each atom that is looked for."""
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
            holds = {atom: nominal.holds(atom, t) for atom in step.targets}
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


def of_labels(workspace: Workspace, folder: Path) -> Iterator[LabelledImages]:
    """The frames of a folder with a file of labels; whatever has no label stands where the workspace has it.

    Raises InputError for a folder that cannot be used.
    """
    files = groupby(read_labels(folder, workspace), lambda label: (label.camera, label.file))
    of_images = [list(labels) for _, labels in files]
    source = _Files(folder, workspace, [labels[0].file for labels in of_images])
    numbered = [(_sought(workspace, labels), _image(workspace, labels, n)) for n, labels in enumerate(of_images)]
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


def _sought(workspace: Workspace, labels: list[Label]) -> dict[str, ProgramTarget]:
    """What is looked for in an image, by atom."""
    return {
        _atom(label): ProgramTarget(cameras=1, boxes=(_box(workspace, label, label.detector),), seen={})
        for label in labels
        if label.detector
    }


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
