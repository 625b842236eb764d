"""Camera poses from the files that people have, recognised by content.

These are results of easy_handeye (ROS 1 and 2), static transforms (TF messages in YAML, launch files, commands), and
recordings with `/tf_static`. easy_handeye says which frame carries the camera: the robot's effector (eye in hand) or
its base (eye on base); its transform is the pose of the tracking frame, usually the camera's optical frame, in that.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Literal

from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.geometry import pose, read_only
from sqrp_cli.knowledge.camera import static_transforms
from sqrp_cli.knowledge.camera.static_transforms import HandEye, StaticTransform
from sqrp_cli.knowledge.text.entries import ForeignEntry, Length, Number, Text
from sqrp_cli.knowledge.text.input_file import decoded, read_input
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument, dotted
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.ros.bag import Bag, is_bag


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


class _Result(ForeignEntry):
    transformation: _Transformation | None = None
    transform: static_transforms.TransformEntry | None = None


class _File(_Result):
    parameters: _Parameters


class _FlatFile(_Result, _Parameters):
    """The format of early versions: the parameters beside the transformation."""


_STAMPED = ("transforms", "child_frame_id")
_KEYS = ("parameters", "transform", "transformation", "tracking_base_frame", "header", *_STAMPED)


def read_hand_eye(
    path: Path, camera: str | None = None, carriers: Collection[str] = (), asked: str = "hand_eye"
) -> HandEye:
    """The pose of a camera in a file of one of the formats that this module reads.

    camera: its frame, where the file has several. carriers: frames that may carry it, such as the robot's links; of
    static transforms one after the other, the camera is in the first of these. asked: the key of the workspace that
    says so. Raises InputError, with the line, for missing keys, values of the wrong kind, and a quaternion whose length
    is not 1.
    """
    pose_file, content, transforms = "/tf_static of a recording", b"", None
    if is_bag(path):
        transforms = read_bag(path)
    else:
        content = read_input(path, MAX_BYTES)
        text = decoded(path, content)
        pose_file, transforms = "static_transform_publisher", static_transforms.read_launch(path, content, text)
        if transforms is None and re.search(r"^[ \t]*child_frame_id:|^transforms:", text, re.MULTILINE):
            pose_file, transforms = "TF messages", static_transforms.read_messages(path, text)
    if transforms is None:
        document = parse_yaml(path, content, keys=_KEYS)
        if not any(key in document.data for key in _KEYS):
            message = (
                "found no camera pose; expected a result of easy_handeye, TF messages, a launch file or a recording"
            )
            raise bad_input("unknown-calibration", message, Place(document.path))
        if "tracking_base_frame" in document.data:
            flat = validate(document, _FlatFile)
            return _hand_eye(document, flat, flat, ())
        file = validate(document, _File)
        return _hand_eye(document, file, file.parameters, ("parameters",))
    seat = static_transforms.camera_seat(transforms, path, camera, carriers, asked)
    # A recording may be large: of that, what was read.
    read = content or repr([(one.parent, one.child, one.X_PC.tolist()) for one in transforms]).encode()
    return replace(seat, pose_file=pose_file, content=read)


def _hand_eye(document: SourceDocument, result: _Result, parameters: _Parameters, owner: KeyPath) -> HandEye:
    """owner: path of the parameters."""
    key = "robot_effector_frame" if _in_hand(document, parameters, owner) else "robot_base_frame"
    frame = parameters.robot_effector_frame if key == "robot_effector_frame" else parameters.robot_base_frame
    if frame is None:
        raise _lacks(document, owner, f"`{key}`, the frame that carries the camera")
    path: KeyPath
    if result.transform is not None:
        t, r = result.transform.translation, result.transform.rotation
        position, quaternion, path = (t.x, t.y, t.z), (r.x, r.y, r.z, r.w), ("transform", "rotation")
    elif result.transformation is not None:
        f = result.transformation
        position, quaternion, path = (f.x, f.y, f.z), (f.qx, f.qy, f.qz, f.qw), ("transformation",)
    else:
        raise _lacks(document, (), "`transform` (easy_handeye2) or `transformation` (easy_handeye)")
    R = static_transforms.unit_quaternion(quaternion)
    if R is None:
        length = sum(value * value for value in quaternion) ** 0.5
        raise document.error("not-a-rotation", path, f"the quaternion has length {length:.3g}, expected 1")
    return HandEye(
        frame=frame.lstrip("/"),
        place=document.value_place((*owner, key)),
        camera_frame=parameters.tracking_base_frame,
        X_FC=read_only(pose(R, position)),
        pose_file="easy_handeye",
        content=document.content,
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
    return bad_input("missing-key", f"{who} lacks the key {key}", document.key_place(owner))


TOPIC = "/tf_static"

MOST_MESSAGES = 10_000
"""Most messages that are read; each node that publishes static transforms sends one."""

_TYPE = "tf2_msgs/msg/TFMessage"


def read_bag(path: Path) -> list[StaticTransform]:
    """The static transforms of a recording, the last of each frame. Raises InputError where it cannot be read."""
    with Bag(path) as bag:
        packed = islice((one for one in bag.messages([TOPIC]) if one.type == _TYPE), MOST_MESSAGES)
        stamped = [one for message in packed for one in bag.read(message).transforms]
    found: dict[str, StaticTransform] = {}
    for one in stamped:
        transform = StaticTransform.of(one, Place(path))
        if transform is None:
            why = f"the quaternion of `{one.child_frame_id}` is not of length 1"
            raise bad_input("not-a-rotation", why, Place(path))
        found[transform.child] = transform
    if not found:
        raise bad_input("missing-key", f"the recording has no static transforms on `{TOPIC}`", Place(path))
    return list(found.values())
