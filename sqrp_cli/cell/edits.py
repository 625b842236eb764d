"""The text of a workspace file with one camera, object or task changed; comments and layout stay."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from sqrp_cli.camera.camera import Camera, ImageEntry
from sqrp_cli.camera.detector import Curve
from sqrp_cli.cell.read_cell import X_AXES_OPTICAL
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Place, bad_input, bad_option
from sqrp_cli.files.frames import WORLD
from sqrp_cli.files.source import Data, KeyPath, SourceDocument, dotted
from sqrp_cli.files.units import ANGLE, FREQUENCY, LENGTH, PIXELS, SHARE, TIME, Dimension, read_quantity
from sqrp_cli.files.yaml_edit import appended, with_entries, with_values
from sqrp_cli.files.yaml_file import parse_yaml
from sqrp_cli.geometry import Array, inverse, matrix_to_quaternion, matrix_to_rpy

_SAME = 1e-9  # numbers that differ by less are the same
_THEN = " then "  # between the steps of a task of several
_LEAST = ("min_q_eoi", "min_q_avg")  # the thresholds of tasks that are least shares; the others are longest times


def stated_look_at(workspace: Workspace, camera: str) -> Array | None:
    """The point in the middle of a camera's image [m] over what is up in it, (2, 3), if the workspace states it so."""
    path = f"cameras.{camera}.pose"
    point, up = (
        [one.value for axis in range(3) if (one := read_quantity(workspace.values.get(f"{path}.{key}.{axis}")))]
        for key in ("look_at", "up")
    )
    return np.array([point, up if len(up) == 3 else (0.0, 0.0, 1.0)]) if len(point) == 3 else None


def with_camera(document: SourceDocument, before: Camera, camera: Camera, look_at: Array | None) -> bytes:
    """The file with a camera at another pose or with another lens.

    before: as the file has it. look_at: the point in the middle of its image, (3,), for a pose that states one; None to
    state the orientation instead. Raises InputError where the file does not say it itself, as with a lens in a
    calibration file.
    """
    path: KeyPath = ("cameras", camera.name)
    entry, content, X, K = _at(document, path), document.content, camera.X_FC, camera.matrix
    is_moved, is_focused = not np.array_equal(before.X_FC, X), not np.array_equal(before.matrix, K)
    turn = f"quaternion {_flow(_rounded(matrix_to_quaternion(X[:3, :3])))} in `{camera.frame}`"
    for key, file, is_changed, numbers in (
        ("pose", "hand_eye", is_moved, f"position {_flow(_rounded(X[:3, 3]))}, {turn}"),
        ("image", "calibration", is_focused, f"camera_matrix fx {K[0, 0]:.6g}, fy {K[1, 1]:.6g}"),
    ):
        if is_changed and key not in entry:
            at = (*path, file)
            message = f"`{dotted(at)}` names another file, which would have to say {numbers}"
            raise bad_option(message, document.value_place(at), mend=f"state `{dotted(path)}` by `{key}`")
    if is_moved:
        content = with_pose(document, (*path, "pose"), X, look_at, entry.get("convention", "optical"))
    if is_focused:
        image, focal = entry["image"], float(K[0, 0])
        if "fx" in image:
            wanted = {"fx": focal} | ({"fy": float(K[1, 1])} if "fy" in image else {})
            values = {name: _number(image[name], value, PIXELS) for name, value in wanted.items()}
        else:
            values = {"horizontal_fov": _number(image["horizontal_fov"], camera.field_of_view, ANGLE)}
        named = {f"{dotted(path)}.image.{name}": text for name, text in values.items()}
        content = with_values(parse_yaml(document.path, content), named)
    return content


def with_further_camera(document: SourceDocument, camera: Camera, like: str, look_at: Array) -> bytes:
    """The file with one more camera, with image and sensing of another one of that name."""
    entry = {"pose": {"position": _rounded(camera.X_FC[:3, 3]), "look_at": _rounded(look_at)}}
    where = ("pose", "hand_eye", "convention", "frame")
    entry |= {key: value for key, value in _at(document, ("cameras", like)).items() if key not in where}
    return appended(document, ("cameras",), f"{camera.name}: {_flow(entry)}")


_SENSING = (
    ("near", "m", LENGTH), ("far", "m", LENGTH), ("rate", "Hz", FREQUENCY), ("exposure", "ms", TIME),
    ("latency", "ms", TIME),
)  # fmt: skip
"""How a camera senses, with the units that people use."""
NewCamera = tuple[Camera, ImageEntry, Array | None, Array]
"""A camera that a workspace file is to have, its image, the point in the middle of that, (3,) in the camera's frame, or
None to state the orientation, and what is up in it, (3,)."""


def with_cameras(document: SourceDocument, kept: Collection[str], cameras: Sequence[NewCamera]) -> bytes:
    """The file with these cameras instead of all that it has but the kept ones."""
    entries = []
    for camera, image, look_at, up in cameras:
        pose_entry: Data = {"position": _rounded(camera.X_FC[:3, 3])}
        if look_at is None:
            pose_entry["quaternion"] = _rounded(matrix_to_quaternion(camera.X_FC[:3, :3]), 9)
        else:
            pose_entry["look_at"] = _rounded(look_at)
            if not np.allclose(up, (0.0, 0.0, 1.0), atol=_SAME):
                pose_entry["up"] = _rounded(up, 9)
        lens = {name: value for name, value in vars(image).items() if value is not None and name != "distortion"}
        if image.horizontal_fov is not None:
            lens["horizontal_fov"] = _number("0 deg", image.horizontal_fov, ANGLE)
        if image.distortion is not None:
            distortion = {"model": image.distortion.model, "coefficients": list(image.distortion.coefficients)}
            lens["distortion"] = distortion
        sensing = {}
        for name, unit, dimension in _SENSING:
            value = getattr(camera, name)
            if value is not None and (value or name != "exposure"):
                sensing[name] = _number(f"0 {unit}", value, dimension)
        if camera.gain is not None:
            sensing["gain"] = f"{camera.gain:.6g}"
        frame = {} if camera.frame == WORLD else {"frame": camera.frame}
        entries.append(f"{camera.name}: {_flow({**frame, 'pose': pose_entry, 'image': lens, **sensing})}")
    return with_entries(document, ("cameras",), kept, entries)


def with_curve(document: SourceDocument, detector: str, curve: Curve) -> bytes:
    """The file with another curve of a detector."""
    text = _flow({"bias": curve.bias, **curve.terms, "most": curve.most})
    return with_values(document, {f"detectors.{detector}.curve": text})


def with_task(document: SourceDocument, task: str, thresholds: dict[str, float], instead_of: str | None) -> bytes:
    """The file with a further task, or with another text of a task that it lists, which keeps its thresholds.

    thresholds: by key. One that the listed task has as well becomes the stricter of both. A task that the file lists
    with this text gets no second entry. instead_of: the text of the listed task that is replaced; None: of none.
    """
    listed = list[str | None]()  # None where a step has steps itself
    for entry in (one for one in document.data.get("tasks") or [] if isinstance(one, dict)):
        steps = entry.get("steps") or []
        listed.append(None if any(_THEN in step for step in steps) else _THEN.join(steps) or entry.get("task"))
    replaced = next((text for text in (task, instead_of) if text is not None and text in listed), None)
    if replaced is None:
        said = {"steps": task.split(_THEN)} if _THEN in task else {"task": task}
        return appended(document, ("tasks",), _flow({**said, **thresholds}))
    path: KeyPath = ("tasks", listed.index(replaced))
    stated = _at(document, path)
    if "steps" in stated:
        pairs = enumerate(zip(stated["steps"], task.split(_THEN), strict=True))
        changed = {dotted((*path, "steps", index)): _flow(new) for index, (old, new) in pairs if old != new}
    else:
        changed = {} if stated["task"] == task else {dotted((*path, "task")): _flow(task)}
    for key in [key for key in thresholds if key in stated]:
        text = _number(stated[key], thresholds[key], SHARE if key in _LEAST else TIME)
        old, new = read_quantity(stated[key]), read_quantity(text)
        if old is None or new is None or (new.value - old.value) * (1 if key in _LEAST else -1) > 0:
            changed[dotted((*path, key))] = text
    added = {dotted((*path, key)): _flow(value) for key, value in thresholds.items() if key not in stated}
    return with_values(document, changed | added)


def with_pose(
    document: SourceDocument, path: KeyPath, X: Array, look_at: Array | None = None, axes: str = "optical"
) -> bytes:
    """The file with another pose, (4, 4), of what has it at this path, such as an object or the robot's base.

    In the notation that it has there. look_at: the point in the middle of a camera's image, (3,), for a pose that
    states one. axes: the `convention` of the file for a camera. Raises InputError for what is no pose.
    """
    stated: Data = _at(document, path) if path in document.values else {}
    X_stated = X @ inverse(X_AXES_OPTICAL[axes])
    wanted: dict[str, list[float]] = {"position": _rounded(X[:3, 3])}
    if "look_at" in stated and look_at is not None:
        wanted["look_at"] = _rounded(look_at)
    elif "quaternion" in stated:
        wanted["quaternion"] = _rounded(matrix_to_quaternion(X_stated[:3, :3]), 9)
    elif "rpy" in stated or "look_at" in stated or not np.allclose(X_stated[:3, :3], np.eye(3), atol=_SAME):
        wanted["rpy"] = _rounded(matrix_to_rpy(X_stated[:3, :3]), 9)
    if all(key in stated for key in wanted):
        leaves = {}  # the numbers that differ from the stated ones, in the unit of each
        for key, numbers in wanted.items():
            dimension = LENGTH if key in ("position", "look_at") else ANGLE
            for axis, number in enumerate(numbers):
                before = _at(document, (*path, key))[axis]
                old = read_quantity(before)
                if old is None or abs(old.value - number) > _SAME:
                    leaves[f"{dotted(path)}.{key}.{axis}"] = _number(before, number, dimension)
        return with_values(document, leaves)
    aimed = ("look_at", "up") if look_at is None else ()
    kept = {key: value for key, value in stated.items() if key not in (*wanted, *aimed)}
    return with_values(document, {dotted(path): _flow({**wanted, **kept})})


def _number(stated: object, value: float, dimension: Dimension) -> str:
    """A number as YAML text, in the unit of what is stated now; unchanged where it says the same."""
    old = read_quantity(stated)
    if old is not None and abs(old.value - value) <= _SAME * max(1.0, abs(value)):
        return str(stated)
    unit = str(stated).strip().lstrip("+-.0123456789eE").strip() if isinstance(stated, str) else ""
    factor = dimension.units.get(unit, 1.0)
    return f"{value / factor:.9g}" + (f" {unit}" if unit else "")


def _at(document: SourceDocument, path: KeyPath) -> Any:  # noqa: ANN401 # a mapping or list of a YAML file
    value = document.at(path)
    if isinstance(value, dict | list):
        return value
    raise bad_input("unknown-value", f"`{dotted(path)}` states no pose", Place(document.path))


def _rounded(values: Iterable[float], digits: int = 6) -> list[float]:
    return [round(float(value), digits) + 0.0 for value in values]


def _flow(value: object) -> str:
    """A value of a YAML file in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9g}"
    text = str(value)
    plain = text and not set(text) & set("{}[],:#&*!|>'\"%@`") and text[0] not in "-? "
    return text if not isinstance(value, str) or plain else '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
