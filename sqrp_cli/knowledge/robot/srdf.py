"""Semantic robot descriptions in SRDF: groups, named states, end effectors, and pairs whose contact is not checked.

The format: http://wiki.ros.org/srdf/review. Its other elements (virtual joints, spheres) are not read. One SRDF often
serves several variants of a robot: what it says of links and joints that this one lacks is left out, with one warning.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from sqrp_cli.errors import InputError, Problem, bad_input, expected_names
from sqrp_cli.knowledge.frames import link_called
from sqrp_cli.knowledge.robot.robot_source import RobotSource, RobotXml
from sqrp_cli.knowledge.robot.robot_xml import read_robot_xml
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.knowledge.text.xml_file import MAX_DEPTH, Element


@dataclass(frozen=True)
class EndEffector:
    """What a gripper is to the arm that carries it."""

    name: str
    parent_link: str
    """The link of the arm that it is fixed to."""
    group: str
    """Its own joints and links."""
    parent_group: str | None
    """The arm's group; None if it is not stated."""


@dataclass(frozen=True, kw_only=True)
class SrdfModel:
    """The content of an SRDF."""

    groups: Mapping[str, tuple[str, ...]]
    """The movable joints of each group, in the order of the URDF."""
    tips: Mapping[str, str]
    """The last link of each group whose links are in one line."""
    states: Mapping[str, Mapping[str, float]]
    """Named positions [rad or m] of joints; of two states of one name, for different groups, all joints."""
    end_effectors: tuple[EndEffector, ...]
    """In file order."""
    disabled_pairs: frozenset[tuple[str, str]]
    """Pairs of links whose contact is not checked, each pair in alphabetical order."""
    content: bytes = b""
    """What it was read from: the file, or what its xacro stands for."""
    expanded: str | None = None
    """The SRDF as text if the file is a xacro."""
    warnings: tuple[Problem, ...] = ()
    """About what was left out."""


def read_srdf(path: Path, urdf: UrdfModel, source: RobotSource | None = None) -> SrdfModel:
    """Read an SRDF that belongs to a URDF, expanded first if it has xacro elements; source: what else it is made of.

    Raises InputError, with file and line, for XML that cannot be read (see `read_robot_xml`), unknown groups, a group
    that contains itself, and a position that is not a finite number.
    """
    xml = read_robot_xml(path, source)
    return _SrdfReader(urdf).read(xml)


@dataclass
class _SrdfReader:
    """Reads an SRDF and collects what it says of links and joints that the robot lacks."""

    urdf: UrdfModel
    unknown: list[Problem] = field(default_factory=list)

    def read(self, xml: RobotXml) -> SrdfModel:
        robot = xml.root
        elements = {element.text("name"): element for element in robot.all("group")}
        members: dict[str, set[str]] = {}

        def collect(name: str, inside: tuple[str, ...]) -> set[str]:
            element = elements[name]
            if name in inside:
                raise element.error("group-cycle", f"group `{name}` contains itself")
            if len(inside) > MAX_DEPTH:
                raise element.error("nesting-too-deep", f"groups contain each other deeper than {MAX_DEPTH} levels")
            if name not in members:
                joints = self._own_joints(element)
                for child in element.all("group"):
                    joints |= collect(_named(child, "name", "group", elements), (*inside, name))
                members[name] = joints
            return members[name]

        movable = self.urdf.movable_joints
        groups, states = (
            {name: tuple(joint.name for joint in movable if joint.name in collect(name, ())) for name in elements},
            self._states(robot),
        )
        return SrdfModel(
            groups=groups,
            tips=self._tips(robot),
            states=states,
            end_effectors=tuple(self._end_effectors(robot)),
            disabled_pairs=frozenset(self._pairs(robot)),
            content=xml.content,
            expanded=xml.expanded,
            warnings=(*xml.warnings, *self._left_out()),
        )

    def _left_out(self) -> Iterator[Problem]:
        """One warning about all unknown names."""
        if self.unknown:
            first = self.unknown[0]
            more = [problem for problem in self.unknown if problem.message != first.message]
            others = f"; {len(more)} more such mention{'s' * (len(more) > 1)}" if more else ""
            message = f"{first.message}; what the SRDF says of it is left out{others}"
            yield replace(first, message=message, severity="warning", mend="check that the SRDF is of this robot")

    def _known(self, element: Element, attribute: str, kind: str, valid: Collection[str]) -> str | None:
        """The link or joint that an attribute names; None, noted, if the robot has none."""
        try:
            return _named(element, attribute, kind, valid)
        except InputError as error:
            if error.problems[0].code != f"unknown-{kind}":
                raise
            self.unknown.extend(error.problems)
            return None

    def _pairs(self, robot: Element) -> Iterator[tuple[str, str]]:
        for element in robot.all("disable_collisions"):
            names = [self._known(element, key, "link", self.urdf.links) for key in ("link1", "link2")]
            if None not in names:
                first, second = sorted(name for name in names if name is not None)
                yield first, second

    def _own_joints(self, group: Element) -> set[str]:
        """The joints of a group, without those of groups in it."""
        joints: set[str] = set()
        for child in group.all("joint"):
            joints |= {name for name in [self._known(child, "name", "joint", self.urdf.joints)] if name}
        for child in group.all("chain"):
            joints |= self._chain(child)
        for child in group.all("link"):
            link = self._known(child, "name", "link", self.urdf.links)
            joints |= {joint.name for joint in self.urdf.joints.values() if joint.child == link}
        return joints

    def _chain(self, element: Element) -> set[str]:
        """The joints on the way from `base_link` to `tip_link`."""
        base, tip = (self._known(element, key, "link", self.urdf.links) for key in ("base_link", "tip_link"))
        if base is None or tip is None:
            return set()
        chain = self.urdf.chain(tip)
        links = [*(joint.parent for joint in chain), tip]
        if base not in links:
            raise element.error("wrong-chain", f"link `{tip}` is not carried by link `{base}`")
        return {joint.name for joint in chain[links.index(base) :]}

    def _tips(self, robot: Element) -> dict[str, str]:
        tips = {}
        for group in robot.all("group"):
            ends = [child.attributes.get("tip_link", "") for child in group.all("chain")]
            ends += [child.attributes.get("name", "") for child in group.all("link")]
            named = [child.attributes.get("name", "") for child in group.all("joint")]
            ends += [self.urdf.joints[name].child for name in named if name in self.urdf.joints]
            chains = {end: {joint.child for joint in self.urdf.chain(end)} for end in ends if end in self.urdf.links}
            tip = max(chains, key=lambda end: len(chains[end]), default=None)
            if tip is not None and all(end in chains[tip] or end == self.urdf.root for end in chains):
                tips[group.text("name")] = tip
        return tips

    def _states(self, robot: Element) -> dict[str, dict[str, float]]:
        states: dict[str, dict[str, float]] = {}
        for element in robot.all("group_state"):
            positions = states.setdefault(element.text("name"), {})
            for child in element.all("joint"):
                name = self._known(child, "name", "joint", self.urdf.joints)
                if name is not None:
                    positions[name] = child.number("value")
        return states

    def _end_effectors(self, robot: Element) -> Iterator[EndEffector]:
        for element in robot.all("end_effector"):
            link = self._known(element, "parent_link", "link", self.urdf.links)
            if link is not None:
                parent = element.attributes.get("parent_group", "").strip() or None
                yield EndEffector(element.text("name"), link, element.text("group"), parent)


def _named(element: Element, attribute: str, kind: str, valid: Collection[str]) -> str:
    name = link_called(element.text(attribute), valid) if kind == "link" else element.text(attribute)
    if name not in valid:
        raise bad_input(f"unknown-{kind}", f"unknown {kind} `{name}`; {expected_names(name, valid)}", element.place)
    return name
