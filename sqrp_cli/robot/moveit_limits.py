"""Joint limits as MoveIt's `joint_limits.yaml` states them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Problem, bad_input, expected_names
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import KeyPath, SourceDocument, describe
from sqrp_cli.files.units import NO_LIMIT, SMALLEST_LIMIT, as_number
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.urdf import UrdfModel

TOP = "joint_limits"  # the key of the joints; what is around it, such as a namespace of parameters, does not matter

SCALED = ("velocity", "acceleration")
"""Limits that MoveIt multiplies with a factor, if the file states one; it leaves jerk as it is."""

KINDS = (*SCALED, "jerk")

_LIMITS: dict[str, dict[str, str]] = {
    **{kind: {f"max_{kind}": kind} for kind in KINDS},
    "position": {"min_position": "lower", "max_position": "upper"},
}
"""The keys of each kind of limit, with what they state."""

_KEYS = [key for kind, keys in _LIMITS.items() for key in (*keys, f"has_{kind}_limits")]

_TOPS = (TOP, "robot_description_planning", "/**", *(f"default_{kind}_scaling_factor" for kind in SCALED))
"""With one of these keys a file is one of MoveIt."""

_DEGREES = re.compile(rb"!(degrees|radians)\s+([-+.\deE]+)")


@dataclass(frozen=True, eq=False)
class MoveitLimits:
    """The limits that a file states [rad or m, s], by joint; scaling factors are not applied."""

    document: SourceDocument
    stated: Mapping[str, Mapping[str, float]]
    """Of each kind of `KINDS`, by joint; only limits that are switched on."""
    positions: Mapping[str, tuple[float, float]]  # position limits by joint
    scaling: Mapping[str, float]  # factor of each kind of `SCALED`; 1 where none is stated
    joints: tuple[str, ...]  # all joints that it names

    def unknown(self, known: tuple[str, ...]) -> Problem | None:
        """A warning about joints that the robot lacks; None if there are none."""
        strange = [joint for joint in self.joints if joint not in known]
        if not strange:
            return None
        more = f" and {len(strange) - 1} more" if len(strange) > 1 else ""
        message = f"unknown joint `{strange[0]}`{more}; {expected_names(strange[0], known)}; their limits are left out"
        place = next(place for path, place in self.document.keys.items() if path[-1] == strange[0])
        return Problem("unknown-joint", message, place, severity="warning", mend="check that the file is of this robot")


def read_moveit_limits(path: Path) -> MoveitLimits:
    """Read a `joint_limits.yaml`.

    As MoveIt does, a limit holds if it is stated and not switched off by `has_..._limits: false`. Raises InputError,
    with line and column, for what is no such file, unknown keys of a joint, and values that are no limits.
    """

    def in_radians(match: re.Match[bytes]) -> bytes:
        number = as_number(match[2])
        if math.isnan(number):
            return match[0]
        return repr(math.radians(number) if match[1] == b"degrees" else number).encode()

    document = parse_yaml(path, _DEGREES.sub(in_radians, read_input(path, MAX_BYTES)), keys=_TOPS)
    above: KeyPath = ()  # of what holds the joints
    data: Any = document.data
    while not isinstance(data.get(TOP), dict):
        inner = [key for key, value in data.items() if isinstance(value, dict)]
        if len(inner) != 1 or TOP in data:
            tops = ", ".join(f"`{key}`" for key in [*document.data][:5])
            message = f"found {tops}, expected `{TOP}:` with the limits of each joint, as MoveIt writes them"
            raise bad_input("missing-key", message, document.key_place((TOP,)))
        above, data = (*above, inner[0]), data[inner[0]]
    problems: list[Problem] = []

    def report(code: str, at: KeyPath, message: str) -> None:
        problems.append(document.problem(code, at, message))

    def number(at: KeyPath, value: object, least: float) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            report("wrong-type", at, f"found {describe(value)}, expected a number in rad or m, and s")
        elif not least <= value <= NO_LIMIT:
            report("wrong-value", at, f"found {value:g}, expected at least {least:g}")
        else:
            return float(value)
        return None

    joints: dict[str, dict[str, float]] = {}  # of each kind, and `lower` and `upper`; those that hold
    for name, entry in data[TOP].items():
        at, found = (*above, TOP, name), joints.setdefault(name, {})
        if not isinstance(entry, dict):
            report("wrong-type", at, f"found {describe(entry)}, expected a mapping with `max_velocity`")
            continue
        for key in entry:
            if key not in _KEYS and re.fullmatch(r"(has|max|min)_\w+", key):
                message = f"`{document.name((*at, key))}` is no known key; {expected_names(key, _KEYS)}"
                problems.append(Problem("unknown-key", message, document.key_place((*at, key))))
        for kind, keys in _LIMITS.items():
            flag = entry.get(f"has_{kind}_limits", True)
            if any(entry.get(key) is None for key in keys):
                continue
            if not isinstance(flag, bool):
                message = f"found {describe(flag)}, expected `true` or `false`"
                report("wrong-type", (*at, f"has_{kind}_limits"), message)
            if flag is not True:
                continue
            least = -NO_LIMIT if kind == "position" else SMALLEST_LIMIT
            values = [value for key in keys if (value := number((*at, key), entry[key], least)) is not None]
            if len(values) == len(keys):
                found |= dict(zip(keys.values(), values, strict=True))
            if values and values[0] > values[-1]:
                message = f"found {values[0]:g}, above `max_position`, {values[-1]:g}"
                report("wrong-value", (*at, "min_position"), message)
    scaling = dict.fromkeys(SCALED, 1.0)
    for kind in SCALED:
        at = (*above, f"default_{kind}_scaling_factor")
        if (stated := document.at(at)) is not None:
            factor = number(at, stated, 1e-3)
            if factor is not None and factor > 1.0:
                report("wrong-value", at, f"found {describe(stated)}, expected a factor of at most 1")
            scaling[kind] = factor or 1.0
    if problems:
        raise InputError(*problems)
    stated_of = {kind: {name: found[kind] for name, found in joints.items() if kind in found} for kind in KINDS}
    positions = {name: (found["lower"], found["upper"]) for name, found in joints.items() if "lower" in found}
    return MoveitLimits(document, stated_of, positions, scaling, tuple(joints))


def with_position_limits(urdf: UrdfModel, limits: MoveitLimits) -> UrdfModel:
    """The robot with the position limits of the file where they are narrower: nothing moves past those of the URDF."""
    joints = dict(urdf.joints)
    for name, (lower, upper) in limits.positions.items():
        joint = joints.get(name)
        if joint is not None and joint.movable:
            joints[name] = replace(joint, lower=max(lower, joint.lower), upper=min(upper, joint.upper))
    return replace(urdf, joints=joints)
