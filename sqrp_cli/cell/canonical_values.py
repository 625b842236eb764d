"""What a workspace says, in plain values: what programs, baselines and kept results depend on.

Comments, layout, the order of keys, how numbers and poses are written, and where files lie have no part in it; nor have
names of folders, expected tasks, and geometry that is not used. Programs keep these values, so that they can say what
has changed since they were made.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.errors import Place, Problem
from sqrp_cli.files.entries import Pose
from sqrp_cli.geometry import matrix_to_quaternion, quaternion_to_matrix
from sqrp_cli.robot.robot import Robot
from sqrp_cli.shapes import Box, Mesh, Shape
from sqrp_cli.skill.settings import MotionParameter

Plain = str | bool | int | float | tuple[float, ...] | None
CanonicalValues = Mapping[str, Mapping[str, Plain]]
"""By what it is about, such as `camera cam1`, and by the name of each value; a pose is x, y, z [m] and a quaternion."""
DIGITS = 12  # significant digits of a number: the notations of one quantity, such as `5 cm` and `50 mm`, differ less
DECIMALS = 9  # decimals of poses [m], which come from sines and cosines
_LONGEST = 40  # most characters of a value that a sentence shows
_POSE = re.compile(r"X_[A-Z]{2}")
_WORDS = re.compile(r"primitives\.[0-9]+\.does")  # for people alone; programs have long kept them

_LEFT_OUT = {
    "Workspace": {"name", "path", "files", "values", "warnings", "places", "tasks", "derived", "recordings"},
    "Robot": {"urdf", "srdf", "package_roots", "tool", "parts", "limits", "stop_limits", "home", "fingers", "markers"},
    "Tool": {"urdf", "file"},
    "UrdfJoint": {"name", "lower", "upper", "velocity"},  # `Robot.limits` has them
    "UrdfLink": {"name", "collision", "visual"},  # `Robot.parts` has what is used
    "Camera": {"name", "lens_file", "pose_file"},
    "Detector": {"dictionaries", "is_usual"},  # of markers, which are there
    "SceneObject": {"name", "parts", "X_FO"},
    "Part": {"name"},
    "Skill": {"name", "folder", "places", "warnings", "initially"},  # `state` has what follows,
    "Domain": {"name", "path", "requirements", "actions"},
    "FormulaEntry": {"formula", "words"},  # the parsed formula is there
    "RetryEntry": {"when"},
    "MotionParameter": {"name", "kinds"},
}
"""Fields without a meaning of their own, by the name of their record."""
_KEPT = {"adds": "effect.adds", "deletes": "effect.deletes"}  # names of fields as programs have long kept them
_UNITS = {"lower": "", "upper": "", "velocity": "/s", "acceleration": "/s^2", "jerk": "/s^3"}
"""Limits of joints, with what comes after their unit."""


def canonical_values(workspace: object, meshes: Mapping[Path, str]) -> CanonicalValues:
    """The values of a `Workspace`; meshes: the digest of each mesh file."""
    places: Mapping[str, object] = getattr(workspace, "places", {})
    about: list[tuple[str, str, Any]] = []  # what each value is about, its name, and the value
    for name, value in _said(workspace):
        if isinstance(value, Robot):
            about.append(("robot", "", value))
            if value.tool is not None:
                about.append(("tool", "", value.tool))
            for urdf in value.urdfs:
                about += [(f"joint {joint.name}", "", joint) for joint in urdf.joints.values()]
                about += [(f"link {one.name}", "", one) for one in urdf.links.values() if one.inertial is not None]
            stops = {name: {"acceleration": of.acceleration, "jerk": of.jerk} for name, of in value.stop_limits.items()}
            joints = {"": value.limits, "stop": stops, "home": value.home}
            joints |= {} if value.fingers is None else {"open": value.fingers.open, "closed": value.fingers.closed}
            about += [(f"joint {joint}", what, of) for what, values in joints.items() for joint, of in values.items()]
            about += [(f"link {link}", "marker", marker) for link, marker in value.markers.items()]
            about += [(f"part {part.name}", "", part) for part in value.parts]
        elif name == "state":
            about.append(("state", "", dict.fromkeys(sorted(map(str, value)), True)))
        elif isinstance(value, Mapping):
            for key, entry in value.items():
                if isinstance(entry, SceneObject) and f"objects.{key}" not in places and entry.X_WO is None:
                    continue  # of a recording, which no program knows
                about.append((f"{name.removesuffix('s')} {key}", "", entry))
                parts = entry.parts if isinstance(entry, SceneObject) else ()
                # What `size` says is not said again.
                others = [part for part in parts if part.name != entry.name or part.shape != Box(entry.size)]
                about += [(f"part {part.name}", "", part) for part in others]
        else:
            about.append(("cell", name, value))
    found: dict[str, dict[str, Plain]] = {}
    for subject, name, value in about:
        found.setdefault(subject, {}).update(_leaves(value, name, meshes))
    return found


def with_skills(values: CanonicalValues, skills: Collection[str]) -> CanonicalValues:
    """The values with these skills alone."""
    parts = ((subject, subject.partition(" ")) for subject in values)
    return {subject: values[subject] for subject, (kind, _, name) in parts if kind != "skill" or name in skills}


def without_words(values: CanonicalValues) -> CanonicalValues:
    """The values without what skills say for people alone."""
    return {about: {name: of[name] for name in of if not _WORDS.fullmatch(name)} for about, of in values.items()}


def digest_of_values(values: CanonicalValues) -> str:
    """SHA-256 of values, whatever their order."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def what_changed(before: CanonicalValues, now: CanonicalValues, skills: Collection[str]) -> tuple[str, ...]:
    """What differs, in a short sentence each, such as `cam1 moved 2.0 cm`; skills: those that matter."""
    before, now = (without_words(with_skills(values, skills)) for values in (before, now))
    found: list[str] = []
    for subject in dict.fromkeys((*before, *now)):
        old, new = before.get(subject), now.get(subject)
        if subject == "state":
            found += [f"{fact} no longer holds" for fact in old or {} if fact not in (new or {})]
            found += [f"{fact} holds now" for fact in new or {} if fact not in (old or {})]
        elif old is None or new is None:
            found.append(f"{subject} is {'new' if old is None else 'gone'}")
        else:
            unit = "m" if "prismatic" in (old.get("type"), new.get("type")) else "rad"
            changes = (_change(subject, name, old.get(name), new.get(name), unit) for name in {**old, **new})
            found += filter(None, changes)
    return tuple(found)


def _said(record: object) -> Iterator[tuple[str, Any]]:
    """The fields of a record that have a meaning."""
    left_out = _LEFT_OUT.get(type(record).__name__, ())
    names = type(record).model_fields if isinstance(record, BaseModel) else [f.name for f in fields(record)]  # type: ignore[arg-type]
    return ((_KEPT.get(name, name), getattr(record, name)) for name in names if name not in left_out)


def _leaves(value: Any, name: str, meshes: Mapping[Path, str]) -> Iterator[tuple[str, Plain]]:  # noqa: ANN401
    """The plain values in a value of any kind, each with its dotted name."""
    if value is None or isinstance(value, (Place, Problem, Path)):
        return
    if (plain := _plain(value)) is not None:
        yield name, plain
        return
    if isinstance(value, Mesh):
        yield name, f"mesh {meshes[value.path][:16]}"
        yield from _leaves(value.scale, f"{name}.scale", meshes)
        return
    items: Iterable[tuple[str, Any]]
    if isinstance(value, Mapping):
        items = ((str(key), item) for key, item in value.items())
    elif isinstance(value, Sequence):
        items = ((one.name if isinstance(one, MotionParameter) else str(index), one) for index, one in enumerate(value))
    else:
        if isinstance(value, get_args(Shape)):
            yield name, type(value).__name__.lower()
        items = _said(value)
    for key, item in items:
        known = "pose" if _POSE.fullmatch(key) and isinstance(item, np.ndarray) and item.shape == (4, 4) else key
        yield from _leaves(item, f"{name}.{known}" if name else known, meshes)


def _plain(value: Any) -> Plain:  # noqa: ANN401
    """A value that needs no more than one word or row of numbers; None for others."""
    match value:
        case bool() | int():
            return value
        case str():
            return str(value)
        case float():
            row = _row([value])
            return row if isinstance(row, str) else row[0]
        case Pose() | np.ndarray():
            X = value.matrix() if isinstance(value, Pose) else value
            if X.shape != (4, 4):
                return _row(X)
            # Position [m] and quaternion x, y, z, w; of the two quaternions the same one, whatever the rounding.
            quaternion = np.round(matrix_to_quaternion(X[:3, :3]), DECIMALS)
            sign = next((np.sign(part) for part in quaternion[::-1] if part), 1.0)
            return tuple((np.concatenate([np.round(X[:3, 3], DECIMALS), sign * quaternion]) + 0.0).tolist())
        case frozenset():
            return ", ".join(sorted("-".join(map(str, one)) if isinstance(one, tuple) else str(one) for one in value))
        case tuple() | list() if all(isinstance(item, int | float) and not isinstance(item, bool) for item in value):
            return _row(value)
        case tuple() | list() if all(isinstance(item, str | int | float) for item in value):
            return ", ".join(map(str, value))
    logical = type(value).__module__.startswith("sqrp_cli.logic.") and str(value) != repr(value)
    return str(value) if logical else None


def _row(values: Any) -> tuple[float, ...] | str:  # noqa: ANN401
    """Numbers to `DIGITS` digits; as text if some are infinite, which no file of ours has."""
    numbers = np.asarray(values, dtype=float).ravel().tolist()
    rounded = [0.0 if abs(number) < 10.0**-DIGITS else float(f"{number:.{DIGITS}g}") for number in numbers]
    return tuple(rounded) if all(map(math.isfinite, rounded)) else ", ".join(map(str, rounded))


def _change(subject: str, name: str, old: Plain, new: Plain, unit: str) -> str | None:
    """A sentence about a value before and now, of a pose how far it has moved and turned; None if they are the same."""
    same = old == new and isinstance(old, bool) == isinstance(new, bool)
    one, other = ((value,) if isinstance(value, float) else value for value in (old, new))
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        same = np.allclose(one, other, rtol=1e-9, atol=1e-9)
    if same:
        return None
    kind, _, named = subject.partition(" ")
    whose = named if kind in ("camera", "object") else subject if named else f"the {subject}"
    inside, _, last = name.rpartition(".")
    if last == "pose" and isinstance(old, tuple) and isinstance(new, tuple):
        way = float(np.linalg.norm(np.subtract(new[:3], old[:3])))
        # The angle of a rotation matrix [rad], exact for small ones, too.
        R = quaternion_to_matrix(old[3:]).T @ quaternion_to_matrix(new[3:])
        axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        turn = math.atan2(float(np.linalg.norm(axis)), float(np.trace(R)) - 1.0)
        length = f"{100 * way:.1f} cm" if 0.01 <= way < 1 else f"{way:.4g} m" if way >= 1 else f"{1000 * way:.3g} mm"
        parts = [f"moved {length}"] if way > 1e-9 else []
        parts += [f"turned {math.degrees(turn):.3g} deg"] if turn > 1e-9 else []
        return f"{whose}{f' {inside}' if inside else ''} {' and '.join(parts)}"
    what, after = f"`{name}`", ""
    if kind == "joint" and last in _UNITS:
        what, whose = f"{'stop ' if name.startswith('stop.') else ''}{last} joint limit", named
        after = f" {unit}{_UNITS[last]}"
    elif kind == "joint" and name in ("home", "open", "closed"):
        what, after = name, f" {unit}"
    before, now = (
        f"[{', '.join(f'{number:g}' for number in value)}]" if isinstance(value, tuple)
        else "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
        for value in (old, new)
    )  # fmt: skip
    before, now = (before, now) if before != now else (str(old), str(new))
    if name == "shape" and before.startswith("mesh ") and now.startswith("mesh "):
        return f"the mesh of {whose} is another"
    if max(len(before), len(now)) > _LONGEST or before == now:
        return f"{what} of {whose} is another"
    return f"{what} of {whose} {before} -> {now}{after}"
