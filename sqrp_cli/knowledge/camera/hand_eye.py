"""Camera poses from hand-eye calibrations, as easy_handeye (ROS 1 and 2) stores them.

The file says which frame carries the camera: the robot's effector (eye in hand) or its base (eye on base). The stored
transform is the pose of the tracking frame, usually the camera's optical frame, in that frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only
from sqrp_cli.knowledge.text.entries import ForeignEntry, Length, Number, Text
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument, dotted
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import read_yaml


@dataclass(frozen=True, eq=False)
class HandEye:
    """The pose of a camera."""

    frame: str
    """The link that carries it."""
    place: Place
    """Where the file names the link."""
    camera_frame: str
    """The frame at pose `X_FC` in the link."""
    X_FC: Array
    """Shape (4, 4)."""
    document: SourceDocument


class _Parameters(ForeignEntry):
    eye_on_hand: bool | None = None
    calibration_type: Literal["eye_in_hand", "eye_on_base"] | None = None
    robot_base_frame: Text | None = None
    robot_effector_frame: Text | None = None
    tracking_base_frame: Text


class _Transformation(ForeignEntry):
    x: Length
    y: Length
    z: Length
    qx: Number
    qy: Number
    qz: Number
    qw: Number


class _Translation(ForeignEntry):
    x: Length
    y: Length
    z: Length


class _Quaternion(ForeignEntry):
    x: Number
    y: Number
    z: Number
    w: Number


class _Transform(ForeignEntry):
    translation: _Translation
    rotation: _Quaternion


class _Result(ForeignEntry):
    transformation: _Transformation | None = None
    transform: _Transform | None = None


class _File(_Result):
    parameters: _Parameters


class _FlatFile(_Result, _Parameters):
    """The format of early versions: the parameters beside the transformation."""


def read_hand_eye(path: Path) -> HandEye:
    """The pose in a file of easy_handeye or easy_handeye2.

    Raises InputError, with the line, for missing keys, values of the wrong kind and a quaternion whose length is not 1.
    """
    document = read_yaml(path, keys=("parameters", "transform", "transformation", "tracking_base_frame"))
    if "tracking_base_frame" in document.data:
        flat = validate(document, _FlatFile)
        return _hand_eye(document, flat, flat, ())
    file = validate(document, _File)
    return _hand_eye(document, file, file.parameters, ("parameters",))


def _hand_eye(document: SourceDocument, result: _Result, parameters: _Parameters, owner: KeyPath) -> HandEye:
    """owner: path of the parameters."""
    key = "robot_effector_frame" if _in_hand(document, parameters, owner) else "robot_base_frame"
    frame = parameters.robot_effector_frame if key == "robot_effector_frame" else parameters.robot_base_frame
    if frame is None:
        raise _lacks(document, owner, f"`{key}`, the frame that carries the camera")
    return HandEye(
        frame=frame.lstrip("/"),
        place=document.value_place((*owner, key)),
        camera_frame=parameters.tracking_base_frame,
        X_FC=_pose(document, result),
        document=document,
    )


def _in_hand(document: SourceDocument, parameters: _Parameters, owner: KeyPath) -> bool:
    if parameters.calibration_type is not None:
        return parameters.calibration_type == "eye_in_hand"
    if parameters.eye_on_hand is None:
        raise _lacks(document, owner, "`calibration_type` (easy_handeye2) or `eye_on_hand` (easy_handeye)")
    return parameters.eye_on_hand


def _lacks(document: SourceDocument, owner: KeyPath, key: str) -> InputError:
    who = f"`{dotted(owner)}`" if owner else "the file"
    return InputError(Problem("missing-key", f"{who} lacks the key {key}", document.key_place(owner)))


def _pose(document: SourceDocument, file: _Result) -> Array:
    path: KeyPath
    if file.transform is not None:
        t, r = file.transform.translation, file.transform.rotation
        position, quaternion, path = (t.x, t.y, t.z), (r.x, r.y, r.z, r.w), ("transform", "rotation")
    elif file.transformation is not None:
        f = file.transformation
        position, quaternion, path = (f.x, f.y, f.z), (f.qx, f.qy, f.qz, f.qw), ("transformation",)
    else:
        raise _lacks(document, (), "`transform` (easy_handeye2) or `transformation` (easy_handeye)")
    length = sum(value * value for value in quaternion) ** 0.5
    if abs(length - 1.0) > 0.01:
        raise InputError(
            document.problem("not-a-rotation", path, f"the quaternion has length {length:.3g}, expected 1")
        )
    return read_only(pose(quaternion_to_matrix(quaternion), position))
