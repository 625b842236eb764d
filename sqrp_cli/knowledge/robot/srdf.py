"""Semantic robot descriptions in SRDF: groups of joints, named states, and pairs of links whose contact is not checked.

The format: http://wiki.ros.org/srdf/review. Its other elements (end effectors, virtual joints,
spheres) are not read.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.knowledge.frames import link_called
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.knowledge.text.xml_file import MAX_DEPTH, Element, read_xml


@dataclass(frozen=True)
class SrdfModel:
    """The content of an SRDF.

    groups: the movable joints of each group, in the order of the URDF. states: named positions [rad or m] of joints.
    disabled_pairs: pairs of links whose contact is not checked, each pair in alphabetical order.
    """

    groups: Mapping[str, tuple[str, ...]]
    states: Mapping[str, Mapping[str, float]]
    disabled_pairs: frozenset[tuple[str, str]]


def read_srdf(path: Path, urdf: UrdfModel) -> SrdfModel:
    """Read an SRDF that belongs to a URDF.

    Raises InputError, with file and line, for XML that cannot be read (see `read_xml`), unknown links, joints and
    groups, a group that contains itself, and a position that is not a finite number.
    """
    robot = read_xml(path, "robot")
    disabled = frozenset(_pair(element, urdf) for element in robot.all("disable_collisions"))
    return SrdfModel(_groups(robot, urdf), _states(robot, urdf), disabled)


def _pair(element: Element, urdf: UrdfModel) -> tuple[str, str]:
    first, second = sorted(_known(element, key, "link", urdf.links) for key in ("link1", "link2"))
    return first, second


def _groups(robot: Element, urdf: UrdfModel) -> dict[str, tuple[str, ...]]:
    elements = {element.text("name"): element for element in robot.all("group")}
    members: dict[str, set[str]] = {}

    def collect(name: str, inside: tuple[str, ...]) -> set[str]:
        element = elements[name]
        if name in inside:
            raise element.error("group-cycle", f"group `{name}` contains itself")
        if len(inside) > MAX_DEPTH:
            raise element.error("nesting-too-deep", f"groups contain each other deeper than {MAX_DEPTH} levels")
        if name not in members:
            joints = {_known(child, "name", "joint", urdf.joints) for child in element.all("joint")}
            for child in element.all("chain"):
                joints |= _chain(child, urdf)
            for child in element.all("link"):
                link = _known(child, "name", "link", urdf.links)
                joints |= {joint.name for joint in urdf.joints.values() if joint.child == link}
            for child in element.all("group"):
                joints |= collect(_known(child, "name", "group", elements), (*inside, name))
            members[name] = joints
        return members[name]

    return {
        name: tuple(joint.name for joint in urdf.movable_joints if joint.name in collect(name, ())) for name in elements
    }


def _chain(element: Element, urdf: UrdfModel) -> set[str]:
    """The joints on the way from `base_link` to `tip_link`."""
    base, tip = (_known(element, key, "link", urdf.links) for key in ("base_link", "tip_link"))
    chain = urdf.chain(tip)
    links = [*(joint.parent for joint in chain), tip]
    if base not in links:
        raise element.error("wrong-chain", f"link `{tip}` is not carried by link `{base}`")
    return {joint.name for joint in chain[links.index(base) :]}


def _states(robot: Element, urdf: UrdfModel) -> dict[str, dict[str, float]]:
    states: dict[str, dict[str, float]] = {}
    for element in robot.all("group_state"):
        positions = {}
        for child in element.all("joint"):
            name = _known(child, "name", "joint", urdf.joints)
            positions[name] = child.number("value")
        states[element.text("name")] = positions
    return states


def _known(element: Element, attribute: str, kind: str, valid: Collection[str]) -> str:
    name = link_called(element.text(attribute), valid) if kind == "link" else element.text(attribute)
    if name not in valid:
        raise InputError(
            Problem(f"unknown-{kind}", f"unknown {kind} `{name}`; {expected_names(name, valid)}", element.place)
        )
    return name
