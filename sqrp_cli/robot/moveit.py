"""What MoveIt adds to a URDF: semantic descriptions in SRDF, and joint limits in `joint_limits.yaml`.

SRDF has groups, named states, end effectors, and pairs whose contact is not checked. The format:
http://wiki.ros.org/srdf/review. Its other elements (virtual joints, spheres) are not read. One SRDF often serves
several variants of a robot: what it says of links and joints that this one lacks is left out, with one warning.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Problem, bad_input, expected_names, first_names
from sqrp_cli.files.frames import link_called
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import KeyPath, SourceDocument, describe
from sqrp_cli.files.units import NO_LIMIT, SMALLEST_LIMIT, as_number
from sqrp_cli.files.xml_file import MAX_DEPTH, Element
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot_xml import RobotSource, read_robot_xml
from sqrp_cli.robot.urdf import UrdfModel


@dataclass(frozen=True, kw_only=True)
class SrdfModel:
    """The content of an SRDF."""

    groups: Mapping[str, tuple[str, ...]]  # the movable joints of each group, in the order of the URDF
    tips: Mapping[str, str]  # the last link of each group whose links are in one line
    states: Mapping[str, Mapping[str, float]]
    """Named positions [rad or m] of joints; of two states of one name, for different groups, all joints."""
    grippers: frozenset[str]  # the groups of end effectors
    tool_links: Mapping[str, str]
    """The link of the arm that carries the first end effector, for each group that is stated as an arm with one."""
    disabled_pairs: frozenset[tuple[str, str]]
    """Pairs of links whose contact is not checked, each pair in alphabetical order."""
    content: bytes = b""  # what it was read from: the file, or what its xacro stands for
    warnings: tuple[Problem, ...] = ()  # about what was left out


def read_srdf(path: Path, urdf: UrdfModel, source: RobotSource | None = None) -> SrdfModel:
    """Read an SRDF that belongs to a URDF, expanded first if it has xacro elements; source: what else it is made of.

    Raises InputError, with file and line, for XML that cannot be read (see `read_robot_xml`), unknown groups, a group
    that contains itself, and a position that is not a finite number.
    """
    xml = read_robot_xml(path, source)
    robot = xml.robot
    unknown: list[Problem] = []

    def known(element: Element, attribute: str, kind: str) -> str | None:
        """The link or joint that an attribute names; None, noted, if the robot has none."""
        name, valid = element.text(attribute), urdf.links if kind == "link" else urdf.joints
        name = link_called(name, valid) if kind == "link" else name
        if name not in valid:
            message = f"unknown {kind} `{name}`; {expected_names(name, valid)}"
            unknown.extend(element.error(f"unknown-{kind}", message).problems)
            return None
        return name

    groups, tips = _groups({element.text("name"): element for element in robot.all("group")}, urdf, known)
    states: dict[str, dict[str, float]] = {}
    for element in robot.all("group_state"):
        positions = states.setdefault(element.text("name"), {})
        for child in element.all("joint"):
            if (name := known(child, "name", "joint")) is not None:
                positions[name] = child.number("value")
    grippers, tool_links = set[str](), dict[str, str]()
    for element in robot.all("end_effector"):
        if (link := known(element, "parent_link", "link")) is not None:
            grippers.add(element.text("group"))
            tool_links.setdefault(element.attributes.get("parent_group", "").strip(), link)
    pairs = set()
    for element in robot.all("disable_collisions"):
        first, second = (known(element, key, "link") for key in ("link1", "link2"))
        if first is not None and second is not None:
            pairs.add((min(first, second), max(first, second)))
    warnings = list(xml.warnings)
    if unknown:
        more = sum(problem.message != unknown[0].message for problem in unknown)
        others = f"; {more} more such mention{'s' * (more > 1)}" if more else ""
        message = f"{unknown[0].message}; what the SRDF says of it is left out{others}"
        mend = "check that the SRDF is of this robot"
        warnings.append(replace(unknown[0], message=message, severity="warning", mend=mend))
    return SrdfModel(
        groups=groups,
        tips=tips,
        states=states,
        grippers=frozenset(grippers),
        tool_links=tool_links,
        disabled_pairs=frozenset(pairs),
        content=xml.content,
        warnings=tuple(warnings),
    )


def _groups(
    groups: Mapping[str, Element], urdf: UrdfModel, known: Callable[[Element, str, str], str | None]
) -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    """Movable joints of each group, those of groups in it too, and the last link of each whose links are in one line.

    known: the link or joint that an attribute names.
    """
    members: dict[str, set[str]] = {}

    def collect(name: str, inside: tuple[str, ...]) -> set[str]:
        """inside: the groups that it is in."""
        element = groups[name]
        if name in inside:
            raise element.error("group-cycle", f"group `{name}` contains itself")
        if len(inside) > MAX_DEPTH:
            raise element.error("nesting-too-deep", f"groups contain each other deeper than {MAX_DEPTH} levels")
        if name in members:
            return members[name]
        joints = {joint for child in element.all("joint") if (joint := known(child, "name", "joint"))}
        for child in element.all("chain"):
            base, tip = (known(child, key, "link") for key in ("base_link", "tip_link"))
            if base is not None and tip is not None:
                chain = urdf.chain(tip)
                links = [*(joint.parent for joint in chain), tip]
                if base not in links:
                    raise child.error("wrong-chain", f"link `{tip}` is not carried by link `{base}`")
                joints |= {joint.name for joint in chain[links.index(base) :]}
        for child in element.all("link"):
            link = known(child, "name", "link")
            joints |= {joint.name for joint in urdf.joints.values() if joint.child == link}
        for child in element.all("group"):
            other = child.text("name")
            if other not in groups:
                raise child.error("unknown-group", f"unknown group `{other}`; {expected_names(other, groups)}")
            joints |= collect(other, (*inside, name))
        members[name] = joints
        return joints

    joints, tips = dict[str, tuple[str, ...]](), dict[str, str]()
    for name, group in groups.items():
        joints[name] = tuple(joint.name for joint in urdf.movable_joints if joint.name in collect(name, ()))
        ends = [child.attributes.get("tip_link", "") for child in group.all("chain")]
        ends += [child.attributes.get("name", "") for child in group.all("link")]
        named = [child.attributes.get("name", "") for child in group.all("joint")]
        ends += [urdf.joints[one].child for one in named if one in urdf.joints]
        chains = {end: {joint.child for joint in urdf.chain(end)} for end in ends if end in urdf.links}
        tip = max(chains, key=lambda end: len(chains[end]), default=None)
        if tip is not None and all(end in chains[tip] or end == urdf.root for end in chains):
            tips[name] = tip
    return joints, tips


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
_KEYS += ["max_effort", "has_effort_limits", "max_deceleration", "has_deceleration_limits", "has_soft_limits",
          "has_jerk"]  # fmt: skip
"""And what other programs read there, KUKA's the last."""
_TOPS = (TOP, "robot_description_planning", "/**", *(f"default_{kind}_scaling_factor" for kind in SCALED))
"""With one of these keys a file is one of MoveIt."""
_DEGREES = re.compile(rb"!(degrees|radians)\s+([-+.\deE]+)")


@dataclass(frozen=True, eq=False)
class MoveitLimits:
    """The limits that a file states [rad or m, s], by joint; scaling factors are not applied."""

    document: SourceDocument
    stated: Mapping[str, Mapping[str, float]]  # of each kind of `KINDS`, by joint; only limits that are switched on
    positions: Mapping[str, tuple[float, float]]  # position limits by joint
    scaling: Mapping[str, float]  # factor of each kind of `SCALED`; 1 where none is stated
    joints: tuple[str, ...]  # all joints that it names


def read_moveit_limits(path: Path) -> MoveitLimits:
    """Read a `joint_limits.yaml`.

    As MoveIt does, a limit holds if it is stated and not switched off by `has_..._limits: false`. Raises InputError,
    with line and column, for what is no such file, unknown keys of a joint, and values that are no limits.
    """
    content = _DEGREES.sub(
        lambda match: match[0] if math.isnan(number := as_number(match[2]))
        else repr(math.radians(number) if match[1] == b"degrees" else number).encode(),
        re.sub(rb"\$\(var \w+\)", b"", read_input(path, MAX_BYTES)),  # prefixes, mostly empty, of launch files
    )  # fmt: skip
    document = parse_yaml(path, content, keys=_TOPS)
    above: KeyPath = ()  # of what holds the joints
    data: Any = document.data
    while not isinstance(data.get(TOP), dict):
        inner = [key for key, value in data.items() if isinstance(value, dict)]
        if len(inner) != 1 or TOP in data:
            tops = first_names(document.data, 5)
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
            if not isinstance(flag, bool):
                message = f"found {describe(flag)}, expected `true` or `false`"
                report("wrong-type", (*at, f"has_{kind}_limits"), message)
            if flag is not True or any(entry.get(key) is None for key in keys):
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
