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
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import islice, takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from sqrp_cli.camera.calibration_formats import FACTS, NUMPY
from sqrp_cli.camera.camera import CameraEntry
from sqrp_cli.camera.pose_matrices import read_pose
from sqrp_cli.errors import Place, bad_input, expected_names, first_names
from sqrp_cli.files.entries import Length, Number, Text, foreign
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.units import as_number
from sqrp_cli.files.validation import validate
from sqrp_cli.files.xml_file import Element, parse_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only, rpy_to_matrix, wrong_length
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

    parent: str  # Of a camera: `world`, or the link that carries it
    child: str
    X_PC: Array  # Shape (4, 4)
    place: Place  # Where the file names the parent
    pose_file: str = ""  # Format of the file
    content: bytes = b""  # What was read of the file
    document: SourceDocument | None = None  # Its keys and values, of easy_handeye
    axes: str | None = None  # Of the camera, as `convention` of a workspace; None where the format does not define them

    @classmethod
    def of(cls, stamped: Any, place: Place) -> StaticTransform:  # noqa: ANN401 - of a file, or a ROS message
        """What a `geometry_msgs/TransformStamped` says. Raises InputError if its quaternion is not of length 1."""
        t, r = stamped.transform.translation, stamped.transform.rotation
        if why := wrong_length(quaternion := (r.x, r.y, r.z, r.w)):
            raise bad_input("not-a-rotation", f"the quaternion of `{stamped.child_frame_id}` {why}", place)
        frames = (stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/"))
        return cls(*frames, pose(quaternion_to_matrix(quaternion), (t.x, t.y, t.z)), place)


_VECTOR = {"x": Length, "y": Length, "z": Length}
_TRANSFORM = foreign(translation=foreign(**_VECTOR), rotation=foreign(**dict.fromkeys("xyzw", Number)))
"""`geometry_msgs/Transform`"""
_STAMPED = foreign(header=foreign(frame_id=Text), child_frame_id=Text, transform=_TRANSFORM)
_MESSAGE = foreign(transforms=Annotated[list[_STAMPED], Field(min_length=1)])  # type: ignore[valid-type]
_RESULT: Any = {
    "transformation": (foreign(**_VECTOR, **dict.fromkeys(_QUATERNION, Number)) | None, None),
    "transform": (_TRANSFORM | None, None),
}
_PARAMETERS: Any = {
    "eye_on_hand": (bool | None, None),
    "calibration_type": (Literal["eye_in_hand", "eye_on_base"] | None, None),
    **dict.fromkeys(("robot_base_frame", "robot_effector_frame"), (Text | None, None)),
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
    if is_bag(path):
        pose_file, transforms = "/tf_static of a recording", read_bag(path)
        # A recording may be large: of that, what was read.
        read = repr([(one.parent, one.child, one.X_PC.tolist()) for one in transforms]).encode()
    else:
        read = read_input(path, MAX_BYTES)
        text = "" if read.startswith(NUMPY) else decoded(path, read)
        pose_file = next((name for name, mark in FACTS["poses"].items() if re.search(mark, text, re.MULTILINE)), "")
        if not pose_file:
            one, X_FC, document, title = read_pose(path, read, text, camera, asked, entry)
            frame, place = (entry.frame if entry is not None else None) or "", document.value_place(one.at)
            return StaticTransform(frame, one.name, X_FC, place, title, read, axes=one.axes)
        transforms = READERS[pose_file](path, read, text)
    for key in ("pose_of", "unit", "rotation"):
        if entry is not None and getattr(entry.hand_eye, key, None) is not None:
            message = f"`{asked}.{key}` is of matrices and vectors; this file, {pose_file}, says it itself"
            raise bad_input("conflicting-keys", message, Place(path), mend=f"leave `{key}` out")
    if pose_file == "easy_handeye":
        return transforms[0]

    above, parents = {one.child: one for one in transforms}, {one.parent for one in transforms}
    frame = "" if camera is None else camera.lstrip("/")
    if camera is None:
        leaves = [child for child in above if child not in parents]
        optical = leaves if len(leaves) == 1 else [child for child in leaves if "optical" in child]
        if len(optical) != 1:
            names = optical or leaves
            mend = f"say which: `{asked}: {{file: {path.name}, camera: {names[0]}}}`" if names else None
            message = f"which frame is the camera's? The file has {first_names(names)}"
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


def _easy_handeye(path: Path, content: bytes, _text: str) -> list[StaticTransform]:
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
    needed = {
        "`calibration_type` (easy_handeye2) or `eye_on_hand` (easy_handeye)": (in_hand, owner),
        f"`{key}`, the frame that carries the camera": (frame, owner),
        "`transform` (easy_handeye2) or `transformation` (easy_handeye)": (found, ()),
    }
    for words, (value, holder) in needed.items():
        if value is None:
            who = f"`{dotted(holder)}`" if holder else "the file"
            raise bad_input("missing-key", f"{who} lacks the key {words}", document.key_place(holder))
    at: KeyPath = ("transform", "rotation") if result.transform else ("transformation",)
    t, r = (found.translation, found.rotation) if result.transform else (found, found)
    quaternion = [getattr(r, name) for name in ("xyzw" if result.transform else _QUATERNION)]
    if why := wrong_length(quaternion):
        raise document.error("not-a-rotation", at, f"the quaternion {why}")
    frames, place = (frame.lstrip("/"), parameters.tracking_base_frame), document.value_place((*owner, key))
    X_PC = read_only(pose(quaternion_to_matrix(quaternion), (t.x, t.y, t.z)))
    return [StaticTransform(*frames, X_PC, place, "easy_handeye", content, document)]


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
            is_list = "transforms" in document.data
            stamped = validate(document, _MESSAGE).transforms if is_list else [validate(document, _STAMPED)]
            for number, one in enumerate(stamped):
                at: KeyPath = ("transforms", number) if is_list else ()
                found.append(StaticTransform.of(one, document.value_place((*at, "header", "frame_id"))))
        line += part.count("\n")
    return found


def _read_launch(path: Path, content: bytes, text: str) -> list[StaticTransform]:
    """Transforms that a launch file or script publishes.

    Launch files in Python, which are not executed, and scripts are brought into the form of those in XML. Nodes whose
    conditions are false with the defaults of the launch arguments are left out. Raises InputError, with the line, for
    arguments and conditions that only a launch could know.
    """
    if text.lstrip().startswith("<"):
        root = parse_xml(path, content, "launch")
    elif re.search(r"^[ \t]*(from|import)\s", text, re.MULTILINE):
        root = _of_python(path, text)
    else:
        root = Element("launch", {}, Place(path))
        for number, line in enumerate(text.replace("\\\n", "  ").splitlines(), 1):
            if PUBLISHER in line and not line.lstrip().startswith("#"):
                try:
                    words = shlex.split(line.split(PUBLISHER, 1)[1], comments=True)
                except ValueError as error:
                    raise bad_input("wrong-value", f"cannot be split: {error}", Place(path, number)) from None
                stated = " ".join(takewhile(lambda word: word not in _SHELL, words))
                root.children.append(Element("node", {"exec": PUBLISHER, "args": stated}, Place(path, number, 1)))

    arguments = (one.attributes for one in root.inside() if one.tag == "arg")
    defaults = {one.get("name", ""): one.get("value", one.get("default")) for one in arguments}
    return [*_published(root, defaults)]


def _of_python(path: Path, text: str) -> Element:
    """The calls in a launch file in Python as elements, each in that of the call around it, by what they stand for."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise bad_input("python-syntax", "this is no Python that can be parsed", Place(path, line)) from None
    names = {target.id: one.value for one in ast.walk(tree) if isinstance(one, ast.Assign)
             for target in one.targets if isinstance(target, ast.Name)}  # fmt: skip
    holders: dict[ast.AST, Element] = {tree: Element("launch", {}, Place(path))}
    for node in ast.walk(tree):  # the outer ones first
        if isinstance(node, ast.Call):
            given = {keyword.arg or "": keyword.value for keyword in node.keywords}
            one = Element("node", {}, Place(path, node.lineno, node.col_offset + 1))
            name, default = next(iter(node.args), given.get("name")), given.get("default_value")
            if isinstance(name, ast.Constant) and isinstance(default, ast.Constant):
                one = Element("arg", {"name": str(name.value), "default": str(default.value)}, one.place)

            executable, stated = given.get("executable", given.get("node_executable")), given.get("arguments")
            if isinstance(executable, ast.Constant) and executable.value == PUBLISHER:
                one.attributes["exec"] = PUBLISHER
                if isinstance(stated, ast.List | ast.Tuple):
                    one.attributes["args"] = " ".join(_plain(item, names) for item in stated.elts)
            if condition := given.get("condition"):  # `IfCondition(LaunchConfiguration(...))`, or the opposite
                condition = names.get(condition.id, condition) if isinstance(condition, ast.Name) else condition
                kind = re.match(r"[\w.]*(If|Unless)Condition\(", ast.unparse(condition))
                asked = condition.args[0] if kind and isinstance(condition, ast.Call) and condition.args else condition
                one.attributes[kind[1].lower() if kind else "if"] = _plain(asked, names)
            if one.attributes:
                holders[node].children.append(one)
                holders[node] = one
        holders |= dict.fromkeys(ast.iter_child_nodes(node), holders[node])
    return holders[tree]


def _plain(node: ast.expr, names: Mapping[str, ast.expr]) -> str:
    """A text, number or launch argument of Python, as launch files in XML have it; anything else in `$(...)`."""
    node = names.get(node.id, node) if isinstance(node, ast.Name) else node
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
        return f"-{node.operand.value!s}"
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("LaunchConfiguration") and node.args:
        return f"$(var {_plain(node.args[0], {})})"
    if isinstance(node, ast.Constant) and isinstance(node.value, str | int | float):
        return str(node.value)
    return f"$({ast.unparse(node)})"


def _published(holder: Element, defaults: Mapping[str, str | None]) -> Iterator[StaticTransform]:
    """What nodes publish, in groups too, whose conditions hold with the defaults of the arguments."""
    for one in holder.children:
        publishes = PUBLISHER in (one.attributes.get("type"), one.attributes.get("exec"))
        if not publishes and all(PUBLISHER not in inner.attributes.values() for inner in one.inside()):
            continue
        for word in [word for word in ("if", "unless") if word in one.attributes]:  # such as `$(arg sim)`
            value = _substituted(one.attributes[word], defaults, one.place).strip().lower()
            if value not in ("true", "false", "1", "0"):
                value = _substituted(f"$({value})", {}, one.place)
            if (value in ("true", "1")) != (word == "if"):
                break
        else:
            if not publishes:
                yield from _published(one, defaults)
            elif "args" not in one.attributes:
                message = f"the arguments of `{PUBLISHER}` are no list that can be read without running the file"
                raise bad_input("wrong-value", message, one.place, mend="write them as a list of texts")
            else:
                yield _of_words(_substituted(one.attributes["args"], defaults, one.place), one.place)


def _substituted(text: str, defaults: Mapping[str, str | None], place: Place) -> str:
    """A text with the defaults of the launch arguments in it, such as `$(arg x)`."""
    for _ in range(MOST_SUBSTITUTIONS):  # a default may have others in it
        found = re.search(r"\$\((?:arg|var)\s+([^\s()]+)[^()]*\)", text)
        if found is None or (value := defaults.get(found[1])) is None:
            break
        text = text.replace(found[0], value)
    if left := re.search(r"\$\(((?:[^()]|\([^()]*\))*)\)?", text):
        message = f"`{left[1][:60]}` is not known without running the file; expected text or a number"
        mend = "write the value itself"
        if re.match(r"(arg|var)\s", left[1]):
            message = f"this transform depends on `{left[0][:60]}`, which is not known before a launch"
            mend = "give the argument a default, or write the transform that holds into a file of its own"
        raise bad_input("ambiguous-entry", message, place, mend=mend)
    return text


def _of_words(text: str, place: Place) -> StaticTransform:
    """The transform of the publisher's arguments: with options, or in its older order; `--ros-args` ends them."""
    words = [*takewhile(lambda word: word != "--ros-args", text.split())]
    frames = [word for word in words if not re.fullmatch(r"[-+]?[\d.][\d.eE+-]*", word)]
    if any(word.startswith("--frame-id") for word in words):
        values = dict(re.findall(r"(?<!\S)--([\w-]+)[= ](?=(\S+))", " ".join(words)))
        for name in ("frame-id", "child-frame-id"):
            if name not in values:
                raise bad_input("missing-key", f"`{PUBLISHER}` lacks `--{name}`", place)
        frames = [values["frame-id"], values["child-frame-id"]]
    elif len(words) > 2 and len(frames) == 2 and (count := words.index(frames[0])) in (6, 7):
        names = (*_POSITION, *_ANGLES[::-1]) if count == 6 else (*_POSITION, *_QUATERNION)
        values = dict(zip(names, words, strict=False))
    else:
        message = f"found {len(words)} arguments, expected x y z yaw pitch roll, or x y z qx qy qz qw, and two frames"
        raise bad_input("wrong-length", message, place)

    figures = {}
    for name in (*_POSITION, *_QUATERNION, *_ANGLES):
        figures[name] = as_number(stated := values.get(name, "1" if name == "qw" else "0"))
        if not abs(figures[name]) <= LARGEST_TRANSLATION:
            message = f"`{name}` is `{stated}`, expected a number of at most {LARGEST_TRANSLATION:g}"
            raise bad_input("wrong-value", message, place)
    R, quaternion = rpy_to_matrix([figures[name] for name in _ANGLES]), [figures[name] for name in _QUATERNION]
    if any(name in values for name in _QUATERNION):
        if why := wrong_length(quaternion):
            raise bad_input("not-a-rotation", f"the quaternion {why}", place)
        R = quaternion_to_matrix(quaternion)
    parent, child = (frame.lstrip("/") for frame in frames)
    return StaticTransform(parent, child, pose(R, [figures[name] for name in _POSITION]), place)


def read_bag(path: Path) -> list[StaticTransform]:
    """The static transforms of a recording, the last of each frame. Raises InputError where it cannot be read."""
    with Bag(path) as bag:
        packed = islice((one for one in bag.messages([TOPIC]) if one.type == _TYPE), MOST_MESSAGES)
        stamped = (one for message in packed for one in bag.read(message).transforms)
        found = {one.child: one for one in (StaticTransform.of(each, Place(path)) for each in stamped)}
    if not found:
        raise bad_input("missing-key", f"the recording has no static transforms on `{TOPIC}`", Place(path))
    return list(found.values())


READERS: Mapping[str, Callable[[Path, bytes, str], list[StaticTransform]]] = {
    "a URDF": _read_urdf,
    PUBLISHER: _read_launch,
    "TF messages": _read_messages,
    "easy_handeye": _easy_handeye,
}
"""By format the transforms of a file, of which the camera's are chosen and put together."""
