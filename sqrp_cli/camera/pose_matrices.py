"""Camera poses from numbers: matrices, vectors, and the files of programs that estimate or draw cameras.

A matrix does not say in what it is, so the workspace does: `pose_of`, `unit`, `rotation`, and of the camera `frame` and
`convention`. Formats that define these need not be told. Nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import radians
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.camera.calibration_formats import FACTS, flat, read_calibration_text, refuse_unread, squashed
from sqrp_cli.camera.camera import CameraEntry
from sqrp_cli.errors import Place, bad_input, expected_names, first_names
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.units import as_number
from sqrp_cli.geometry import Array, inverse, pose, quaternion_to_matrix, read_only, rpy_to_matrix, wrong_length

_PAIR = re.compile(
    r"(.*?)(?:(r|rot|rotation|rotmat|rotationmatrix|rmat|rvec|rotvec|quat|quaternion|orientation|q)"
    r"|(t|trans|translation|translationvector|tvec|position|pos|p))"
    r"(|(?:cam|camera|base|gripper|w2c|c2w|world|target|tool|ee|flange).*)"
)
"""Keys of the two parts of a pose: rotation and position, with what is the same in both before and behind it."""
_OTHER_PAIR = re.compile(r"()(?:(rotation|rot|r)|(translation|trans|t))(.*)")  # such as `Rg_c` and `tg_c`
_CARRIER = "(?:base|gripper|world|tool|ee|flange|hand|robot|link)"
_OF_CAMERA = re.compile(rf"cam(?:era)?\d*(?:in|to|2){_CARRIER}|^(?:cam|pose|t|r)?c2w")
_OF_FRAME = re.compile(rf"{_CARRIER}(?:to|2)cam|^(?:cam|pose|t|r)?w2c")
_ROTATIONS = {"rotvec": 3, "rpy": 3, "zyx": 3, "xyzw": 4, "wxyz": 4}  # numbers of a notation
MOST_NESTED = 5  # levels of a file in which poses are looked for
NEAR_ROTATION = 0.01  # how far rows of a rounded rotation matrix may be from orthonormal


class PoseNumbers(NamedTuple):
    """A pose as a file has it, with what the file's format defines of it: as `PoseFile` and `CameraEntry` have that."""

    name: str
    at: KeyPath
    turn: Sequence[float]  # A rotation matrix, row by row, or three or four numbers
    shift: Sequence[float]
    rotation: str | None = None
    pose_of: str | None = None
    unit: float | None = None  # Length of a unit [m]
    axes: str | None = None


def read_pose(
    path: Path, content: bytes, text: str, camera: str | None, asked: str, entry: CameraEntry | None
) -> tuple[PoseNumbers, Array, SourceDocument, str]:
    """The wanted pose of a file of numbers, or its only one, X_FC of it, its document, and the name of its format.

    X_FC has the camera's axes as the file has them. camera: its name in the file; asked: the key of the workspace that
    says so; entry: what the workspace says of the camera. Raises InputError where there is none, or several, where
    neither file nor workspace says what the numbers are, and for those that are no rotation.
    """
    if re.search(FACTS["colmap_images"], text):
        document, title = SourceDocument(path, content, {}, {}, {}), "COLMAP's images.txt"
        found = list[PoseNumbers]()
        # In every other line number, quaternion, position, camera and name of an image.
        lines = [line.split(maxsplit=9) for line in text.splitlines() if not line.lstrip().startswith("#")]
        for words in [words for words in lines[::2] if words]:
            numbers = [as_number(word) for word in words[1:8]]
            if len(words) < 10 or not np.isfinite(numbers).all():
                message = f"found `{' '.join(words)[:60]}`, expected number, qw qx qy qz, tx ty tz, camera and name"
                raise bad_input("wrong-length", message, Place(path))
            name = words[9].strip()
            found.append(PoseNumbers(name, (), numbers[:4], numbers[4:], "wxyz", "frame", None, "optical"))
    else:
        refuse_unread(path, content, "hand_eye")
        document, syntax = read_calibration_text(path, FACTS["pose_keys"])
        title, found = "transforms.json" if "frames" in document.data else f"a matrix ({syntax})", _poses_in(document)
    names, place = [one.name for one in found], Place(path)
    if not found:
        message = f"found no camera pose; expected {', '.join(FACTS['poses'])}, a recording, a matrix or a vector of 6"
        raise bad_input("unknown-calibration", message, place)
    if camera is not None and camera not in names:
        message = f"`{asked}.camera`: found `{camera}`, which has no pose in the file; "
        raise bad_input("unknown-camera", message + expected_names(camera, names), place)
    one, *more = [one for one in found if camera in (None, one.name)]
    if more:
        mend = f"say which: `{asked}: {{file: {path.name}, camera: {names[0]}}}`"
        raise bad_input("ambiguous-entry", f"the file has the poses {first_names(names)}", place, mend=mend)
    return one, _X_of(one, document.value_place(one.at), asked, entry), document, title


def _poses_in(document: SourceDocument) -> list[PoseNumbers]:
    """The poses of a file of keys and values, or of arrays, in its order: matrices, vectors, or pairs of these."""
    found = list[PoseNumbers]()
    waiting: list[tuple[KeyPath, object]] = [((), document.data)]
    while waiting:  # depth first
        at, held = waiting.pop()
        inside = held.items() if isinstance(held, dict) else enumerate(held) if isinstance(held, list) else ()
        pairs: dict[tuple[str, str], dict[str, tuple[KeyPath, list[float]]]] = {}
        deeper: list[tuple[KeyPath, object]] = []
        for key, value in inside:
            numbers, path, name = _numbers(value), (*at, key), squashed(str(key))
            label = str(held["file_path"]) if isinstance(held, dict) and "file_path" in held else dotted(path)
            match, count = _PAIR.fullmatch(name) or _OTHER_PAIR.fullmatch(name), len(numbers or ())
            if numbers is None and len(at) < MOST_NESTED:
                deeper.append((path, value))
            elif numbers and match and count in (3, 4, 9):
                pairs.setdefault((match[1], match[4]), {})["turn" if match[2] else "shift"] = path, numbers
            elif numbers and count in (12, 16) and isinstance(value, list | dict):
                M = np.array(numbers).reshape(-1, 4)
                if len(M) == 4 and not M[:3, 3].any() and M[3, :3].any():
                    M = M.T  # column by column, or for points in rows
                turn, shift = M[:3, :3].ravel().tolist(), M[:3, 3].tolist()
                found.append(PoseNumbers(label, path, turn, shift, None, *_defined(name, held)))
            elif numbers and count in (6, 7):
                found.append(PoseNumbers(label, path, numbers[3:], numbers[:3], None, *_defined(name, held)))
        for (before, after), pair in pairs.items():
            if len(pair) == 2 and len(pair["shift"][1]) == 3:
                (path, turn), (_, shift), label = pair["turn"], pair["shift"], dotted(at) or before + after or "pose"
                kind = "rotvec" if "vec" in squashed(str(path[-1])) else None
                is_bop = (before, after) == ("cam", "w2c")  # which defines them
                defined = ("frame", 1e-3, "optical") if is_bop else _defined(before + after, held)
                found.append(PoseNumbers(label, path, turn, shift, kind, *defined))
        waiting += deeper[::-1]
    return found


def _defined(name: str, held: object) -> tuple[str | None, float | None, str | None]:
    """What the key of a matrix, and the mapping that has it, say: which pose it is, its unit and axes."""
    beside = held if isinstance(held, dict) else {}
    if name == "cameraviewtransform" and "metersPerSceneUnit" in beside:  # of Isaac Sim
        unit = beside["metersPerSceneUnit"]
        return "frame", float(unit) if isinstance(unit, int | float) else None, "opengl"
    if name == "transformmatrix" and "file_path" in beside:  # of nerfstudio
        return "camera", None, "opengl"
    return "camera" if _OF_CAMERA.search(name) else "frame" if _OF_FRAME.search(name) else None, None, None


def _numbers(value: object) -> list[float] | None:
    """The numbers of a vector or a matrix, also of OpenCV, or of x, y, z, w; None for anything else."""
    if isinstance(value, dict):
        value = value.get("data", [value.get(key) for key in ("x", "y", "z", *(["w"] if "w" in value else ()))])
    value = flat(flat(value))
    if not isinstance(value, list) or not all(type(one) in (int, float) for one in value):
        return None
    return [float(one) for one in value]


def _X_of(one: PoseNumbers, place: Place, asked: str, entry: CameraEntry | None) -> Array:
    """X_FC of a pose, by what the file says of its numbers, and what the workspace does."""
    means = {key: getattr(one, key) for key in ("pose_of", "unit", "rotation")}
    for key, own in means.items():
        told = getattr(entry.hand_eye, key, None) if entry is not None else None
        if None not in (own, told) and own != told:
            message = (
                f"`{asked}.{key}` is `{told}`, but by the format of the file, or the name of its key, it is `{own}`"
            )
            raise bad_input("wrong-value", message, place, mend=f"leave `{key}` out")
        means[key] = told if own is None else own

    kinds = ", ".join(f"`{name}`" for name, count in _ROTATIONS.items() if count == len(one.turn))
    degrees = ", in radians, or with ` deg` behind it" if len(one.turn) == 3 else ""
    asks = {**FACTS["asked"], "rotation": f"{FACTS['asked']['rotation']} {kinds}{degrees}"}
    no_need = {"unit": not any(one.shift), "rotation": not kinds, "convention": one.axes is not None}
    stated = {**means, "frame": getattr(entry, "frame", None), "convention": getattr(entry, "convention", None)}
    lacks = [key for key in asks if stated[key] is None and not no_need.get(key)]
    if lacks:
        where = {f"in `{asked}`": means.keys(), "beside `hand_eye`": stated.keys() - means}
        said = {at: " and ".join(asks[key] for key in lacks if key in keys) for at, keys in where.items()}
        message = f"the file does not say what the {len(one.turn) + len(one.shift)} numbers of `{one.name}` mean"
        mend = f"say {'; '.join(f'{at} {words}' for at, words in said.items() if words)}"
        raise bad_input("missing-key", message, place, mend=mend)
    R, unit = _rotation(np.array(one.turn, dtype=float), means["rotation"] or "", place), means["unit"] or 1.0
    X = pose(R, np.array(one.shift) * unit)
    return read_only(inverse(X) if means["pose_of"] == "frame" else X)


def _rotation(turn: Array, notation: str, place: Place) -> Array:
    """The rotation matrix (3, 3) of its numbers."""
    kind, _, unit = notation.partition(" ")
    if len(turn) == 9:
        R = turn.reshape(3, 3)
        if np.abs(R @ R.T - np.eye(3)).max() > NEAR_ROTATION or np.linalg.det(R) < 0:
            message = "this is no rotation: rows of length 1 at right angles, right-handed, are expected"
            raise bad_input("not-a-rotation", message, place, mend="is it a pose, and has it no scale or mirror in it?")
        U, _, V = np.linalg.svd(R)
        return np.asarray(U @ V)  # the nearest one to rounded numbers
    if len(turn) != _ROTATIONS[kind]:
        raise bad_input("wrong-length", f"found {len(turn)} numbers, `{kind}` has {_ROTATIONS[kind]}", place)
    if len(turn) == 4:
        if why := wrong_length(turn := turn if kind == "xyzw" else turn[[1, 2, 3, 0]]):
            raise bad_input("not-a-rotation", f"the quaternion {why}", place)
        return quaternion_to_matrix(turn)
    length = float(np.linalg.norm(turn))
    if not unit and length > 2 * np.pi * 3**0.5:
        mend = f"say `rotation: {kind} deg` if these are degrees"
        raise bad_input("wrong-value", f"found {np.abs(turn).max():g} rad, more than a turn", place, mend=mend)
    turn, length = (turn * radians(1.0), radians(length)) if unit else (turn, length)
    if kind != "rotvec":
        return rpy_to_matrix(turn if kind == "rpy" else turn[::-1])
    return quaternion_to_matrix([*(0.5 * np.sinc(length / (2 * np.pi)) * turn), np.cos(0.5 * length)])
