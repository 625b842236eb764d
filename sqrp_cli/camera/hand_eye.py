"""Camera poses from the files that people have, recognised by content.

These are results of easy_handeye (ROS 1 and 2), static transforms, and recordings with `/tf_static`. easy_handeye says
which frame carries the camera: the robot's effector (eye in hand) or its base (eye on base); its transform is the pose
of the tracking frame, usually the camera's optical frame, in that.

Static transforms are TF messages in YAML (`ros2 topic echo /tf_static`), launch files and commands of
`static_transform_publisher`, such as MoveIt's hand-eye calibration writes. Launch files are read as text: nothing in
them is executed.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import islice, pairwise, takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from sqrp_cli.camera.calibration_formats import FACTS, NUMPY, read_calibration_text, refuse_unread
from sqrp_cli.camera.camera import CameraEntry
from sqrp_cli.camera.pose_matrices import X_of, chosen_pose, colmap_images, poses_in
from sqrp_cli.errors import Place, bad_input, expected_names
from sqrp_cli.files.entries import Length, Number, Text, foreign
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.units import as_number
from sqrp_cli.files.validation import validate
from sqrp_cli.files.xml_file import Element, parse_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only, rpy_to_matrix
from sqrp_cli.ros.bag import Bag, is_bag

TOPIC, _TYPE = "/tf_static", "tf2_msgs/msg/TFMessage"
MOST_MESSAGES = 10_000  # most messages that are read; each node that publishes static transforms sends one
PUBLISHER = "static_transform_publisher"
MOST_SUBSTITUTIONS = 20  # of launch arguments in a text
LARGEST_TRANSLATION = 1e4  # largest coordinate [m]
_DOCUMENTS = re.compile(r"^---[ \t]*$", re.MULTILINE)
_SHELL = ("&", "&&", ";", "|", "||")  # what ends a command
_POSITION = ("x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_ANGLES = ("roll", "pitch", "yaw")


class StaticTransform(NamedTuple):
    """The pose of a frame, such as a camera's optical one (x right, y down, z forward), in another, by a file."""

    parent: str
    """Of a camera: `world`, or the link that carries it."""
    child: str
    X_PC: Array
    """Shape (4, 4)."""
    place: Place
    """Where the file names the parent."""
    pose_file: str = ""
    """Format of the file."""
    content: bytes = b""
    """What was read of the file."""
    document: SourceDocument | None = None
    """Its keys and values, of easy_handeye."""
    axes: str | None = None
    """Of the camera, as `convention` of a workspace; None where the format does not define them."""

    @classmethod
    def of(cls, stamped: Any, place: Place) -> StaticTransform | None:  # noqa: ANN401 - of a file, or a ROS message
        """What a `geometry_msgs/TransformStamped` says; None if its quaternion is not of length 1."""
        t, r = stamped.transform.translation, stamped.transform.rotation
        R = unit_quaternion((r.x, r.y, r.z, r.w))
        frames = (stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/"))
        return None if R is None else cls(*frames, pose(R, (t.x, t.y, t.z)), place)


def unit_quaternion(quaternion: Sequence[float]) -> Array | None:
    """The rotation matrix of x, y, z, w; None if that is not of length 1, to 1 %."""
    length = sum(value * value for value in quaternion) ** 0.5
    return None if abs(length - 1.0) > 0.01 else quaternion_to_matrix(quaternion)


_VECTOR = {"x": Length, "y": Length, "z": Length}
_TRANSFORM = foreign(
    translation=foreign(**_VECTOR), rotation=foreign(**dict.fromkeys("xyzw", Number))
)  # `geometry_msgs/Transform`
_STAMPED = foreign(header=foreign(frame_id=Text), child_frame_id=Text, transform=_TRANSFORM)
_MESSAGE = foreign(transforms=Annotated[list[_STAMPED], Field(min_length=1)])  # type: ignore[valid-type]

_RESULT: Any = {
    "transformation": (foreign(**_VECTOR, **dict.fromkeys(_QUATERNION, Number)) | None, None),
    "transform": (_TRANSFORM | None, None),
}
_PARAMETERS: Any = {
    "eye_on_hand": (bool | None, None),
    "calibration_type": (Literal["eye_in_hand", "eye_on_base"] | None, None),
    "robot_base_frame": (Text | None, None),
    "robot_effector_frame": (Text | None, None),
    "tracking_base_frame": Text,
}
_EASY_HANDEYE, _EARLY = foreign(**_RESULT, parameters=foreign(**_PARAMETERS)), foreign(**_RESULT, **_PARAMETERS)
"""Results of easy_handeye; in early versions the parameters stand beside the transformation."""


def read_hand_eye(
    path: Path, camera: str | None = None, carriers: Collection[str] = (), asked: str = "hand_eye",
    entry: CameraEntry | None = None,
) -> StaticTransform:  # fmt: skip
    """The pose of a camera in a file of one of the formats that this module reads.

    camera: its frame, where the file has several; None: the only one without frames on it, or the only one of these
    that is optical. carriers: frames that may carry it, such as the robot's links; of static transforms one after the
    other, the camera is in the first of these above it, else in the topmost frame. asked: the key of the workspace that
    says so; entry: what the workspace says of the camera. Raises InputError, with the line, for missing keys, values of
    the wrong kind, what is no rotation, and numbers of which neither file nor workspace says what they are.
    """
    transforms: StaticTransform | list[StaticTransform]
    if is_bag(path):
        pose_file, transforms = "/tf_static of a recording", read_bag(path)
        # A recording may be large: of that, what was read.
        read = repr([(one.parent, one.child, one.X_PC.tolist()) for one in transforms]).encode()
    else:
        read = read_input(path, MAX_BYTES)
        text = "" if read.startswith(NUMPY) else decoded(path, read)
        pose_file = next((name for name, mark in FACTS["poses"].items() if re.search(mark, text, re.MULTILINE)), "")
        if not pose_file:
            return _of_numbers(path, read, text, camera, asked, entry)
        transforms = READERS[pose_file](path, read, text)
    for key in ("pose_of", "unit", "rotation"):
        if entry is not None and getattr(entry.hand_eye, key, None) is not None:
            message = f"`{asked}.{key}` is of matrices and vectors; this file, {pose_file}, says it itself"
            raise bad_input("conflicting-keys", message, Place(path), mend=f"leave `{key}` out")
    if isinstance(transforms, StaticTransform):
        return transforms
    above, parents = {one.child: one for one in transforms}, {one.parent for one in transforms}
    frame = "" if camera is None else camera.lstrip("/")
    if camera is None:
        leaves = [child for child in above if child not in parents]
        optical = leaves if len(leaves) == 1 else [child for child in leaves if "optical" in child]
        if len(optical) != 1:
            names = optical or leaves
            listed = ", ".join(f"`{name}`" for name in names[:10])
            mend = f"say which: `{asked}: {{file: {path.name}, camera: {names[0]}}}`" if names else None
            message = f"which frame is the camera's? The file has {listed}"
            raise bad_input("ambiguous-entry", message, Place(path), mend=mend)
        frame = optical[0]
    if frame not in above:
        message = f"`{asked}.camera`: found `{frame}`, which has no transform in the file; "
        raise bad_input("unknown-camera", message + expected_names(frame, above), Place(path))
    X, at, last = np.eye(4), frame, above[frame]
    for _ in range(len(above) + 1):
        if at not in above or (at in carriers and at != frame):
            return StaticTransform(at, frame, read_only(X), last.place, pose_file, read)
        last = above[at]
        X, at = last.X_PC @ X, last.parent
    raise bad_input("wrong-value", f"the frames above `{frame}` lead back to it", last.place)


def _of_numbers(
    path: Path, content: bytes, text: str, camera: str | None, asked: str, entry: CameraEntry | None
) -> StaticTransform:
    """The pose that numbers of a file state."""
    if re.search(FACTS["colmap_images"], text):
        document, title = SourceDocument(path, content, {}, {}, {}), "COLMAP's images.txt"
        found = colmap_images(text, path)
    else:
        refuse_unread(path, content, "hand_eye")
        document, syntax = read_calibration_text(path, FACTS["pose_keys"])
        title, found = f"a matrix ({syntax})", poses_in(document)
        title = "transforms.json" if "frames" in document.data else title
    if not found:
        message = f"found no camera pose; expected {', '.join(READERS)}, a recording, a matrix or a vector of 6"
        raise bad_input("unknown-calibration", message, Place(path))
    one = chosen_pose(found, camera, document, asked)
    X_FC, frame = X_of(one, document.value_place(one.at), asked, entry), (entry.frame if entry is not None else None)
    return StaticTransform(frame or "", one.name, X_FC, document.value_place(one.at), title, content, axes=one.axes)


def _easy_handeye(path: Path, content: bytes, _text: str) -> StaticTransform:
    """A result of easy_handeye."""
    document = parse_yaml(path, content, keys=FACTS["pose_keys"])
    owner: KeyPath = () if "tracking_base_frame" in document.data else ("parameters",)
    result: Any = validate(document, _EASY_HANDEYE if owner else _EARLY)
    parameters = result.parameters if owner else result

    in_hand = parameters.eye_on_hand
    if parameters.calibration_type is not None:
        in_hand = parameters.calibration_type == "eye_in_hand"
    key = "robot_effector_frame" if in_hand else "robot_base_frame"
    frame, found = getattr(parameters, key), result.transform or result.transformation
    for value, holder, needed in (
        (in_hand, owner, "`calibration_type` (easy_handeye2) or `eye_on_hand` (easy_handeye)"),
        (frame, owner, f"`{key}`, the frame that carries the camera"),
        (found, (), "`transform` (easy_handeye2) or `transformation` (easy_handeye)"),
    ):
        if value is None:
            who = f"`{dotted(holder)}`" if holder else "the file"
            raise bad_input("missing-key", f"{who} lacks the key {needed}", document.key_place(holder))
    at: KeyPath = ("transform", "rotation") if result.transform else ("transformation",)
    t, r = (found.translation, found.rotation) if result.transform else (found, found)
    quaternion = [getattr(r, name) for name in ("xyzw" if result.transform else _QUATERNION)]
    R = unit_quaternion(quaternion)
    if R is None:
        length = sum(value * value for value in quaternion) ** 0.5
        raise document.error("not-a-rotation", at, f"the quaternion has length {length:.3g}, expected 1")
    return StaticTransform(
        parent=frame.lstrip("/"),
        child=parameters.tracking_base_frame,
        X_PC=read_only(pose(R, (t.x, t.y, t.z))),
        place=document.value_place((*owner, key)),
        pose_file="easy_handeye",
        content=document.content,
        document=document,
    )


def _read_urdf(path: Path, content: bytes, _text: str) -> list[StaticTransform]:
    """The fixed joints of a URDF."""
    found, zeros = [], (0.0, 0.0, 0.0)
    for joint in parse_xml(path, content, "robot").all("joint"):
        if joint.attributes.get("type") == "fixed":
            origin = joint.first("origin") or Element("origin", {}, joint.place)
            xyz, rpy = (origin.numbers(name, 3, zeros, LARGEST_TRANSLATION) for name in ("xyz", "rpy"))
            parent, child = (joint.need(role).text("link") for role in ("parent", "child"))
            found.append(StaticTransform(parent, child, pose(rpy_to_matrix(rpy), xyz), joint.place))
    return found


def _read_messages(path: Path, _content: bytes, text: str) -> list[StaticTransform]:
    """Transforms of TF messages in YAML, one or several (`---`)."""
    found, line = list[StaticTransform](), 0
    for part in _DOCUMENTS.split(text):
        if any(row.strip() and not row.lstrip().startswith("#") for row in part.split("\n")):
            document = parse_yaml(path, ("\n" * line + part).encode())
            stamped: dict[KeyPath, Any] = {}
            if "transforms" in document.data:
                stamped |= {("transforms", i): one for i, one in enumerate(validate(document, _MESSAGE).transforms)}
            else:
                stamped[()] = validate(document, _STAMPED)
            for at, one in stamped.items():
                transform = StaticTransform.of(one, document.value_place((*at, "header", "frame_id")))
                if transform is None:
                    message = "the quaternion is not of length 1 (order x, y, z, w)"
                    raise document.error("not-a-rotation", (*at, "transform", "rotation"), message)
                found.append(transform)
        line += part.count("\n")
    return found


def _read_launch(path: Path, content: bytes, text: str) -> list[StaticTransform]:
    """Transforms that a launch file or script publishes.

    Nodes whose conditions are false with the defaults of the launch arguments are left out. Raises InputError, with the
    line, for arguments and conditions that only a launch could know.
    """
    if text.lstrip().startswith("<"):
        root = parse_xml(path, content, "launch")
        stated = [one for one in root.inside() if one.tag == "arg"]
        defaults = {one.attributes.get("name", ""): one.attributes.get("value", one.attributes.get("default"))
                    for one in stated}  # fmt: skip
        return [_of_words(_substituted(one.text("args"), defaults, one.place).split(), one.place)
                for one in _of_xml(root, defaults)]  # fmt: skip
    if re.search(r"^[ \t]*(from|import)\s", text, re.MULTILINE):
        return list(_of_python(path, text))
    found = []
    for number, line in enumerate(text.replace("\\\n", "  ").splitlines(), 1):
        if PUBLISHER in line and not line.lstrip().startswith("#"):
            try:
                words = shlex.split(line.split(PUBLISHER, 1)[1], comments=True)
            except ValueError as error:
                raise bad_input("wrong-value", f"cannot be split: {error}", Place(path, number)) from None
            found.append(_of_words([*takewhile(lambda word: word not in _SHELL, words)], Place(path, number, 1)))
    return found


def _of_xml(holder: Element, defaults: Mapping[str, str | None]) -> Iterator[Element]:
    """The nodes that publish, in groups too, whose conditions hold."""
    for one in holder.children:
        publishes = PUBLISHER in (one.attributes.get("type"), one.attributes.get("exec"))
        if not publishes and all(PUBLISHER not in inner.attributes.values() for inner in one.inside()):
            continue
        if all(_holds(one.attributes[word], word == "if", defaults, one.place)
               for word in ("if", "unless") if word in one.attributes):  # fmt: skip
            yield from (one,) if publishes else _of_xml(one, defaults)


def _substituted(text: str, defaults: Mapping[str, str | None], place: Place) -> str:
    """A text with the defaults of the launch arguments in it, such as `$(arg x)`."""
    for _ in range(MOST_SUBSTITUTIONS):  # a default may have others in it
        found = re.search(r"\$\((?:(?:arg|var)\s+([^\s()]+))?[^()]*\)", text)
        if found is None:
            return text
        if (value := defaults.get(found[1] or "")) is None:
            break
        text = text.replace(found[0], value)
    message = f"this transform depends on `{found[0][:60] if found else text[:60]}`, which is not known before a launch"
    mend = "give the argument a default, or write the transform that holds into a file of its own"
    raise bad_input("ambiguous-entry", message, place, mend=mend)


def _holds(text: str, wanted: bool, defaults: Mapping[str, str | None], place: Place) -> bool:
    """Whether a condition, such as `$(arg sim)`, is as wanted with the defaults of the arguments."""
    value = _substituted(text, defaults, place).strip().lower()
    if value not in ("true", "false", "1", "0"):
        value = _substituted(f"$({text})", {}, place)
    return (value in ("true", "1")) == wanted


def _of_python(path: Path, text: str) -> Iterator[StaticTransform]:
    """Nodes of a launch file in Python, which is parsed and not executed."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise bad_input("python-syntax", "this is no Python that can be parsed", Place(path, line)) from None
    calls = [call for call in ast.walk(tree) if isinstance(call, ast.Call)]
    names = {target.id: one.value for one in ast.walk(tree) if isinstance(one, ast.Assign)
             for target in one.targets if isinstance(target, ast.Name)}  # fmt: skip
    defaults: dict[str, str | None] = {}
    around: dict[ast.Call, list[tuple[str, bool]]] = {}  # conditions, and whether each has to hold
    for call in calls:  # the outer ones first
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        name, default = next(iter(call.args), given.get("name")), given.get("default_value")
        if isinstance(name, ast.Constant) and isinstance(default, ast.Constant):
            defaults[str(name.value)] = str(default.value)
        if (
            condition := given.get("condition")
        ) is not None:  # `IfCondition(LaunchConfiguration(...))`, or the opposite
            condition = names.get(condition.id, condition) if isinstance(condition, ast.Name) else condition
            asked = (ast.unparse(condition), True)
            if isinstance(condition, ast.Call) and (
                found := re.search("(If|Unless)Condition$", ast.unparse(condition.func))
            ):
                asked = (_plain(condition.args[0], names) or asked[0], found[1] == "If")
            for inner in (inner for inner in ast.walk(call) if isinstance(inner, ast.Call)):
                around.setdefault(inner, []).append(asked)
    for call in calls:
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        executable = given.get("executable", given.get("node_executable"))
        if not (isinstance(executable, ast.Constant) and executable.value == PUBLISHER):
            continue
        place, stated = Place(path, call.lineno, call.col_offset + 1), given.get("arguments")
        if not all(_holds(*asked, defaults, place) for asked in around.get(call, ())):
            continue
        if not isinstance(stated, ast.List | ast.Tuple):
            message = f"the `arguments` of `{PUBLISHER}` are no list that can be read without running the file"
            raise bad_input("wrong-value", message, place, mend="write them as a list of texts")
        words = []
        for item in stated.elts:
            at, word = Place(path, item.lineno, item.col_offset + 1), _plain(item, names)
            if word is None:
                message = f"`{ast.unparse(item)}` is not known without running the file; expected text or a number"
                raise bad_input("wrong-value", message, at, mend="write the value itself")
            words.append(_substituted(word, defaults, at))
        yield _of_words(words, place)


def _plain(node: ast.expr, names: Mapping[str, ast.expr]) -> str | None:
    """A text, number or launch argument of Python, as launch files in XML have it; None for anything else."""
    node = names.get(node.id, node) if isinstance(node, ast.Name) else node
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and (text := _plain(node.operand, {})):
        return f"-{text}"
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("LaunchConfiguration") and node.args:
        return f"$(var {_plain(node.args[0], {})})"
    return str(node.value) if isinstance(node, ast.Constant) and isinstance(node.value, str | int | float) else None


def _of_words(words: Sequence[str], place: Place) -> StaticTransform:
    """The transform of the publisher's arguments: with options, or in its older order; `--ros-args` ends them."""
    words = [*takewhile(lambda word: word != "--ros-args", words)]
    numbers = [word for word in words if re.fullmatch(r"[-+]?[\d.][\d.eE+-]*", word)]
    frames = [word for word in words if word not in numbers]
    if any(word.startswith("--frame-id") for word in words):
        split = [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]
        values = {name[2:].replace("-", "_"): value for name, value in pairwise(split) if name.startswith("--")}
        for name in ("frame_id", "child_frame_id"):
            if name not in values:
                raise bad_input("missing-key", f"`{PUBLISHER}` lacks `--{name.replace('_', '-')}`", place)
        frames = [values["frame_id"], values["child_frame_id"]]
    elif len(words) > 2 and len(frames) == 2 and (count := words.index(frames[0])) in (6, 7):
        names = (*_POSITION, *_ANGLES[::-1]) if count == 6 else (*_POSITION, *_QUATERNION)
        values = dict(zip(names, words, strict=False))
    else:
        message = f"found {len(words)} arguments, expected x y z yaw pitch roll, or x y z qx qy qz qw, and two frames"
        raise bad_input("wrong-length", message, place)

    figures = {}
    for name in (*_POSITION, *_QUATERNION, *_ANGLES):
        text = values.get(name, "1" if name == "qw" else "0")
        figures[name] = as_number(text)
        if not abs(figures[name]) <= LARGEST_TRANSLATION:
            message = f"`{name}` is `{text}`, expected a number of at most {LARGEST_TRANSLATION:g}"
            raise bad_input("wrong-value", message, place)
    R: Array | None = rpy_to_matrix([figures[name] for name in _ANGLES])
    if any(name in values for name in _QUATERNION):
        R = unit_quaternion([figures[name] for name in _QUATERNION])
    if R is None:
        raise bad_input("not-a-rotation", "the quaternion is not of length 1 (order qx, qy, qz, qw)", place)
    parent, child = (frame.lstrip("/") for frame in frames)
    return StaticTransform(parent, child, pose(R, [figures[name] for name in _POSITION]), place)


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


READERS: Mapping[str, Callable[[Path, bytes, str], StaticTransform | list[StaticTransform]]] = {
    "a URDF": _read_urdf,
    PUBLISHER: _read_launch,
    "TF messages": _read_messages,
    "easy_handeye": _easy_handeye,
}
"""By format the transforms of a file, of which the camera's are chosen and put together, or the pose itself."""
