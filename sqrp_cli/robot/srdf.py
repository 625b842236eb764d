"""Semantic robot descriptions in SRDF: groups, named states, end effectors, and pairs whose contact is not checked.

The format: http://wiki.ros.org/srdf/review. Its other elements (virtual joints, spheres) are not read. One SRDF often
serves several variants of a robot: what it says of links and joints that this one lacks is left out, with one warning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from sqrp_cli.errors import Problem, expected_names
from sqrp_cli.files.frames import link_called
from sqrp_cli.files.xml_file import MAX_DEPTH, Element
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot_xml import RobotSource, read_robot_xml
from sqrp_cli.robot.urdf import UrdfModel


@dataclass(frozen=True)
class EndEffector:
    """What a gripper is to the arm that carries it."""

    name: str
    parent_link: str
    """The link of the arm that it is fixed to."""
    group: str  # its own joints and links
    parent_group: str | None  # the arm's group; None if it is not stated


@dataclass(frozen=True, kw_only=True)
class SrdfModel:
    """The content of an SRDF."""

    groups: Mapping[str, tuple[str, ...]]  # the movable joints of each group, in the order of the URDF
    tips: Mapping[str, str]  # the last link of each group whose links are in one line
    states: Mapping[str, Mapping[str, float]]
    """Named positions [rad or m] of joints; of two states of one name, for different groups, all joints."""
    end_effectors: tuple[EndEffector, ...]  # in file order
    disabled_pairs: frozenset[tuple[str, str]]
    """Pairs of links whose contact is not checked, each pair in alphabetical order."""
    content: bytes = b""  # what it was read from: the file, or what its xacro stands for
    expanded: str | None = None  # the SRDF as text if the file is a xacro
    warnings: tuple[Problem, ...] = ()  # about what was left out


def read_srdf(path: Path, urdf: UrdfModel, source: RobotSource | None = None) -> SrdfModel:
    """Read an SRDF that belongs to a URDF, expanded first if it has xacro elements; source: what else it is made of.

    Raises InputError, with file and line, for XML that cannot be read (see `read_robot_xml`), unknown groups, a group
    that contains itself, and a position that is not a finite number.
    """
    xml = read_robot_xml(path, source)
    robot = xml.root
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

    groups = _group_joints({element.text("name"): element for element in robot.all("group")}, urdf, known)
    states: dict[str, dict[str, float]] = {}
    for element in robot.all("group_state"):
        positions = states.setdefault(element.text("name"), {})
        for child in element.all("joint"):
            if (name := known(child, "name", "joint")) is not None:
                positions[name] = child.number("value")
    end_effectors = []
    for element in robot.all("end_effector"):
        if (link := known(element, "parent_link", "link")) is not None:
            parent = element.attributes.get("parent_group", "").strip() or None
            end_effectors.append(EndEffector(element.text("name"), link, element.text("group"), parent))
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
        tips=_tips(robot, urdf),
        states=states,
        end_effectors=tuple(end_effectors),
        disabled_pairs=frozenset(pairs),
        content=xml.content,
        expanded=xml.expanded,
        warnings=tuple(warnings),
    )


def _group_joints(
    groups: Mapping[str, Element], urdf: UrdfModel, known: Callable[[Element, str, str], str | None]
) -> dict[str, tuple[str, ...]]:
    """The movable joints of each group, those of groups in it too; known: the link or joint that an attribute names."""
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

    return {
        name: tuple(joint.name for joint in urdf.movable_joints if joint.name in collect(name, ())) for name in groups
    }


def _tips(robot: Element, urdf: UrdfModel) -> dict[str, str]:
    """The last link of each group whose links are in one line."""
    tips = {}
    for group in robot.all("group"):
        ends = [child.attributes.get("tip_link", "") for child in group.all("chain")]
        ends += [child.attributes.get("name", "") for child in group.all("link")]
        named = [child.attributes.get("name", "") for child in group.all("joint")]
        ends += [urdf.joints[name].child for name in named if name in urdf.joints]
        chains = {end: {joint.child for joint in urdf.chain(end)} for end in ends if end in urdf.links}
        tip = max(chains, key=lambda end: len(chains[end]), default=None)
        if tip is not None and all(end in chains[tip] or end == urdf.root for end in chains):
            tips[group.text("name")] = tip
    return tips
