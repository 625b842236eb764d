"""Joint limits as MoveIt's `joint_limits.yaml` states them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from sqrp_cli.errors import InputError, Problem, bad_input, expected_names
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import KeyPath, SourceDocument, describe
from sqrp_cli.files.units import NO_LIMIT, SMALLEST_LIMIT, as_number
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.urdf import UrdfModel

TOP = "joint_limits"
"""The key of the joints; what is around it, such as a namespace of parameters, does not matter."""

SCALED = ("velocity", "acceleration")
"""Limits that MoveIt multiplies with a factor, if the file states one; it leaves jerk as it is."""

KINDS = (*SCALED, "jerk")

_KEYS = (
    "max_position", "min_position", "has_position_limits", *(f"max_{kind}" for kind in KINDS),
    *(f"has_{kind}_limits" for kind in KINDS),
)  # fmt: skip

_TOPS = (TOP, "robot_description_planning", "/**", *(f"default_{kind}_scaling_factor" for kind in SCALED))
"""With one of these keys a file is one of MoveIt."""

_DEGREES = re.compile(rb"!(degrees|radians)\s+([-+.\deE]+)")


@dataclass(frozen=True, eq=False)
class MoveitLimits:
    """The limits that a file states [rad or m, s], by joint; scaling factors are not applied."""

    document: SourceDocument
    stated: Mapping[str, Mapping[str, float]]
    """Of each kind of `KINDS`, by joint; only limits that are switched on."""
    positions: Mapping[str, tuple[float, float]]
    """Position limits by joint."""
    scaling: Mapping[str, float]
    """Factor of each kind of `SCALED`; 1 where none is stated."""
    joints: tuple[str, ...]
    """All joints that it names."""

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
            found = ", ".join(f"`{key}`" for key in [*document.data][:5])
            message = f"found {found}, expected `{TOP}:` with the limits of each joint, as MoveIt writes them"
            raise bad_input("missing-key", message, document.key_place((TOP,)))
        above, data = (*above, inner[0]), data[inner[0]]
    reader = _LimitsReader(document, [])
    joints = {name: reader.joint((*above, TOP, name), entry) for name, entry in data[TOP].items()}
    scaling = {kind: reader.factor((*above, f"default_{kind}_scaling_factor")) for kind in SCALED}
    if reader.problems:
        raise InputError(*reader.problems)
    stated = {kind: {name: found[kind] for name, found in joints.items() if kind in found} for kind in KINDS}
    positions = {name: (found["lower"], found["upper"]) for name, found in joints.items() if "lower" in found}
    return MoveitLimits(document, stated, positions, scaling, tuple(joints))


def with_position_limits(urdf: UrdfModel, limits: MoveitLimits) -> UrdfModel:
    """The robot with the position limits of the file where they are narrower: nothing moves past those of the URDF."""
    joints = dict(urdf.joints)
    for name, (lower, upper) in limits.positions.items():
        joint = joints.get(name)
        if joint is not None and joint.movable:
            joints[name] = replace(joint, lower=max(lower, joint.lower), upper=min(upper, joint.upper))
    return replace(urdf, joints=joints)


class _LimitsReader(NamedTuple):
    """Reads joints and collects problems."""

    document: SourceDocument
    problems: list[Problem]

    def joint(self, path: KeyPath, entry: object) -> dict[str, float]:
        """The limits of a joint that hold: of each kind, and `lower` and `upper`."""
        if not isinstance(entry, dict):
            self._report("wrong-type", path, f"found {describe(entry)}, expected a mapping with `max_velocity`")
            return {}
        for key in entry:
            if key not in _KEYS and re.fullmatch(r"(has|max|min)_\w+", key):
                message = f"`{self.document.name((*path, key))}` is no known key; {expected_names(key, _KEYS)}"
                self.problems.append(Problem("unknown-key", message, self.document.key_place((*path, key))))
        found: dict[str, float] = {}
        for kind in KINDS:
            if entry.get(f"max_{kind}") is not None and self._on(path, entry, kind):
                value = self._number((*path, f"max_{kind}"), entry[f"max_{kind}"], SMALLEST_LIMIT)
                found |= {} if value is None else {kind: value}
        if "max_position" in entry and "min_position" in entry and self._on(path, entry, "position"):
            keys = ("min_position", "max_position")
            lower, upper = (self._number((*path, key), entry[key], -NO_LIMIT) for key in keys)
            if lower is None or upper is None:
                return found
            if lower > upper:
                message = f"found {lower:g}, above `max_position`, {upper:g}"
                self._report("wrong-value", (*path, "min_position"), message)
            found |= {"lower": lower, "upper": upper}
        return found

    def factor(self, path: KeyPath) -> float:
        """A scaling factor, above 0 and at most 1; 1 if it is not stated."""
        data = self.document.at(path)
        if data is None:
            return 1.0
        value = self._number(path, data, 1e-3)
        if value is not None and value > 1.0:
            self._report("wrong-value", path, f"found {describe(data)}, expected a factor of at most 1")
        return value or 1.0

    def _on(self, path: KeyPath, entry: Mapping[str, object], kind: str) -> bool:
        flag = entry.get(f"has_{kind}_limits", True)
        if not isinstance(flag, bool):
            message = f"found {describe(flag)}, expected `true` or `false`"
            self._report("wrong-type", (*path, f"has_{kind}_limits"), message)
        return flag is True

    def _number(self, path: KeyPath, value: object, least: float) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._report("wrong-type", path, f"found {describe(value)}, expected a number in rad or m, and s")
        elif not least <= value <= NO_LIMIT:
            self._report("wrong-value", path, f"found {value:g}, expected at least {least:g}")
        else:
            return float(value)
        return None

    def _report(self, code: str, path: KeyPath, message: str) -> None:
        self.problems.append(self.document.problem(code, path, message))
