"""Reading a URDF into the records of `urdf`, and checking that its links form a tree."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Place, Problem, bad_input, expected_names
from sqrp_cli.geometry import Array, pose, read_only, rpy_to_matrix
from sqrp_cli.knowledge.frames import WORLD, WORLD_LINK
from sqrp_cli.knowledge.robot import urdf
from sqrp_cli.knowledge.robot.robot_source import RobotSource
from sqrp_cli.knowledge.robot.robot_xml import read_robot_xml
from sqrp_cli.knowledge.robot.urdf import LEAST_MOMENT, as_meant
from sqrp_cli.knowledge.text.units import LARGEST_LENGTH, NO_LIMIT, SMALLEST_LIMIT, SMALLEST_SIZE
from sqrp_cli.knowledge.text.xml_file import Element
from sqrp_cli.shapes import FIGURES, Box, Capsule, Cylinder, Sphere, shape_of

MAX_LINKS = 2000
"""Most links of a robot."""
MAX_JOINTS = 200
"""Most movable joints of a robot."""
MAX_SHAPES = 500
"""Most shapes of a robot, collision and visual ones together."""

LONGEST_SLIDE = 100.0
"""Largest position limit of a prismatic joint [m]."""

_JOINT_TYPES: tuple[urdf.JointType, ...] = ("fixed", "revolute", "continuous", "prismatic")
_OTHER_JOINT_TYPES = ("floating", "planar")

_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius",)}
"""Attributes of shapes that are nothing if one is 0; a capsule without a straight part is a sphere."""

_Named = TypeVar("_Named", urdf.UrdfLink, urdf.UrdfJoint)


def read_urdf(path: Path, source: RobotSource | None = None) -> urdf.UrdfModel:
    """Read and validate a URDF, expanded first if it has xacro elements; source: what else it is made of.

    Raises InputError, with file and line, for XML that cannot be read (see `read_robot_xml`), missing or malformed
    values, a repeated name, an unknown link or joint, an axis of length zero, a missing position limit, a joint type
    that is not supported (floating, planar), a mass or moment of inertia below 0, too many links, joints or shapes, and
    links that do not form one tree.
    """
    xml = read_robot_xml(path, source)
    model = _model(path, xml.root)
    warnings = (*xml.warnings, *model.warnings)
    return replace(model, content=xml.content, expanded=xml.expanded, packages=xml.packages, warnings=warnings)


def _model(path: Path, robot: Element) -> urdf.UrdfModel:
    _check_size(robot)
    links = _unique(_link(element) for element in robot.all("link"))
    if not links:
        raise robot.error("no-links", "the robot has no <link>")
    joints = _unique(_joint(element) for element in robot.all("joint"))
    for joint in joints.values():
        _check_references(joint, links, joints)
    root = _root(links, joints, robot.place)
    name = robot.attributes.get("name", path.stem)
    model = as_meant(urdf.UrdfModel(name, path, links, _outwards(root, joints), root))
    model = replace(model, warnings=(*model.warnings, *_flat_shapes(robot)))
    return _with_renamed_world(model) if WORLD in links else model


def _check_size(robot: Element) -> None:
    """Raises InputError, before reading any, for too many links, movable joints or shapes."""
    links = [*robot.all("link")]
    joints = sum(joint.attributes.get("type", "").strip() != "fixed" for joint in robot.all("joint"))
    if len(links) > MAX_LINKS or joints > MAX_JOINTS:
        message = f"the robot has {len(links):,} links and {joints:,} joints that move"
        message += f", expected at most {MAX_LINKS:,} links and {MAX_JOINTS} joints that move"
        raise robot.error("too-many-links", message)
    shapes = [shape for link in links for shape in link.children if shape.tag in ("collision", "visual")]
    if len(shapes) > MAX_SHAPES:
        message = (
            f"this is shape {MAX_SHAPES + 1:,} of {len(shapes):,}, expected at most {MAX_SHAPES:,} <collision> and "
        )
        message += "<visual> of a robot together"
        mend = "join them into meshes, or state what stands around the robot as objects of the workspace"
        raise bad_input("too-many-shapes", message, shapes[MAX_SHAPES].place, mend=mend)


def _with_renamed_world(model: urdf.UrdfModel) -> urdf.UrdfModel:
    def called(name: str) -> str:
        return WORLD_LINK if name == WORLD else name

    links = {called(name): replace(link, name=called(name)) for name, link in model.links.items()}
    joints = {
        name: replace(joint, parent=called(joint.parent), child=called(joint.child))
        for name, joint in model.joints.items()
    }
    return replace(model, links=links, joints=joints, root=called(model.root))


def _unique(items: Iterable[_Named]) -> dict[str, _Named]:
    named: dict[str, _Named] = {}
    for item in items:
        if item.name in named:
            kind = "link" if isinstance(item, urdf.UrdfLink) else "joint"
            message = f"{kind} `{item.name}` is defined twice, first at line {named[item.name].place.line}"
            raise bad_input("duplicate-name", message, item.place)
        named[item.name] = item
    return named


def _link(element: Element) -> urdf.UrdfLink:
    collision = tuple(_geometry(child) for child in element.all("collision") if not _is_empty(child))
    visual = tuple(_geometry(child) for child in element.all("visual") if not _is_empty(child))
    return urdf.UrdfLink(element.text("name"), collision, visual, _inertial(element), element.place)


def _is_empty(piece: Element) -> bool:
    """Whether a <collision> or <visual> is nothing: a box, sphere, cylinder or capsule with a size of 0."""
    shapes = [shape for holder in piece.all("geometry") for shape in holder.children if shape.tag in _SIZES]
    sizes = [size for shape in shapes for key in _SIZES[shape.tag] for size in shape.attributes.get(key, "").split()]
    return any(re.fullmatch(r"[+-]?(0+\.?0*|\.0+)(e[+-]?\d+)?", size, re.IGNORECASE) for size in sizes)


def _flat_shapes(robot: Element) -> Iterator[Problem]:
    """A warning about shapes that are nothing, and left out; none without any."""
    owners = [
        (link.text("name"), piece)
        for link in robot.all("link")
        for piece in link.children
        if piece.tag in ("collision", "visual") and _is_empty(piece)
    ]
    if owners:
        names = ", ".join(f"`{name}`" for name in dict.fromkeys(name for name, _ in owners))
        message = f"a shape with a size of 0 is left out, of {names}"
        yield Problem("no-size", message, owners[0][1].place, severity="warning", mend="state its size, or remove it")


def _inertial(link: Element) -> urdf.Inertial | None:
    inertial = link.first("inertial")
    if inertial is None or inertial.first("mass") is None:
        return None
    moments = inertial.first("inertia")
    xx, xy, xz, yy, yz, zz = (
        0.0 if moments is None else moments.number(key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    mass = inertial.need("mass").number("value")
    if mass < 0.0:
        raise inertial.need("mass").error("wrong-value", f"link `{link.text('name')}` has a mass of {mass:g} kg")
    if moments is not None and min(xx, yy, zz) < -LEAST_MOMENT:
        message = (
            f"link `{link.text('name')}` has a moment of inertia of {min(xx, yy, zz):g} kg m^2, expected none below 0"
        )
        raise moments.error("wrong-value", message)
    return urdf.Inertial(mass, _origin(inertial), read_only([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _geometry(element: Element) -> urdf.LinkGeometry:
    holder = element.need("geometry")
    if len(holder.children) != 1:
        raise holder.error("wrong-geometry", f"<geometry> has {len(holder.children)} shapes, expected one")
    shape = holder.children[0]
    return urdf.LinkGeometry(element.attributes.get("name"), _shape(shape), _origin(element), shape.place)


def _shape(element: Element) -> Box | Sphere | Cylinder | Capsule | urdf.MeshReference:
    if element.tag in FIGURES:
        figures = FIGURES[element.tag].items()
        return shape_of(element.tag, [number for key, count in figures for number in _positive(element, key, count)])
    if element.tag == "mesh":
        x, y, z = element.numbers("scale", 3, (1.0, 1.0, 1.0))
        if 0.0 in (x, y, z):
            raise element.error("wrong-value", "the mesh's `scale` has a zero, which would flatten it")
        return urdf.MeshReference(element.text("filename"), (x, y, z))
    expected = expected_names(element.tag, (*FIGURES, "mesh"))
    raise element.error("unknown-shape", f"unknown shape {element}; {expected}")


def _joint(element: Element) -> urdf.UrdfJoint:
    name, kind = element.text("name"), element.text("type")
    if kind not in _JOINT_TYPES:
        if kind in _OTHER_JOINT_TYPES:
            raise element.error(
                "unsupported-joint", f"joint `{name}` is {kind}; only {', '.join(_JOINT_TYPES)} are supported"
            )
        expected = expected_names(kind, _JOINT_TYPES)
        raise element.error("unknown-joint-type", f"joint `{name}` has the unknown type `{kind}`; {expected}")
    joint_type = _JOINT_TYPES[_JOINT_TYPES.index(kind)]
    lower, upper, velocity = _limits(element, name, joint_type)
    limit = element.first("limit")
    effort = None if limit is None else _magnitude(limit, "effort")
    return urdf.UrdfJoint(
        name=name,
        type=joint_type,
        parent=element.need("parent").text("link"),
        child=element.need("child").text("link"),
        X_PJ=_origin(element),
        axis=_axis(element, joint_type),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort or None,
        mimic=None if joint_type == "fixed" else _mimic(element),
        place=element.place,
    )


def _axis(element: Element, joint_type: urdf.JointType) -> Array:
    axis = element.first("axis")
    if axis is None or joint_type == "fixed":
        return read_only([1.0, 0.0, 0.0])
    direction = np.array(axis.numbers("xyz", 3))
    length = np.linalg.norm(direction)
    if length < 1e-9:
        message, mend = f"the axis of joint `{element.text('name')}` has length zero", 'name it, such as xyz="0 0 1"'
        raise axis.error("zero-axis", message, mend)
    return read_only(direction / length)


def _limits(element: Element, name: str, joint_type: urdf.JointType) -> tuple[float, float, float | None]:
    limit = element.first("limit")
    if joint_type == "fixed":
        return 0.0, 0.0, None
    if limit is None:
        if joint_type == "continuous":
            return -math.inf, math.inf, None
        raise element.error("missing-limit", f"joint `{name}` is {joint_type} but has no <limit>")
    velocity = _magnitude(limit, "velocity")
    if 0.0 < velocity < SMALLEST_LIMIT:
        message = f"`velocity` is {velocity:g}, expected at least {SMALLEST_LIMIT:g}, or 0 for none stated"
        raise limit.error("wrong-value", message)
    if joint_type == "continuous":
        return -math.inf, math.inf, velocity or None
    most = NO_LIMIT if joint_type == "revolute" else LONGEST_SLIDE
    lower, upper = (limit.number(bound, 0.0, most) for bound in ("lower", "upper"))
    if lower > upper:
        message = f"joint `{name}` has a lower limit of {lower:g}, above its upper limit of {upper:g}"
        raise limit.error("wrong-value", message)
    return lower, upper, velocity or None


def _magnitude(limit: Element, attribute: str) -> float:
    """A limit without sign; 0 if it is not stated."""
    value = limit.number(attribute, 0.0, NO_LIMIT)
    if value < 0.0:
        raise limit.error("wrong-value", f"`{attribute}` is {value:g}, expected a positive number")
    return value


def _mimic(element: Element) -> urdf.Mimic | None:
    mimic = element.first("mimic")
    if mimic is None:
        return None
    multiplier, offset = mimic.number("multiplier", 1.0), mimic.number("offset", 0.0)
    return urdf.Mimic(mimic.text("joint"), multiplier, offset)


def _origin(element: Element) -> Array:
    origin = element.first("origin")
    if origin is None:
        return read_only(np.eye(4))
    xyz = origin.numbers("xyz", 3, (0.0, 0.0, 0.0), LARGEST_LENGTH)
    rpy = origin.numbers("rpy", 3, (0.0, 0.0, 0.0))
    return read_only(pose(rpy_to_matrix(rpy), xyz))


def _positive(element: Element, attribute: str, count: int) -> tuple[float, ...]:
    numbers = element.numbers(attribute, count, most=LARGEST_LENGTH)
    if min(numbers) < SMALLEST_SIZE:
        found = f"{element}: `{attribute}` is `{element.text(attribute)}`"
        raise element.error("wrong-value", f"{found}, expected it above 0, at least {SMALLEST_SIZE:g}")
    return numbers


def _check_references(
    joint: urdf.UrdfJoint, links: Mapping[str, urdf.UrdfLink], joints: Mapping[str, urdf.UrdfJoint]
) -> None:
    for role, link in (("parent", joint.parent), ("child", joint.child)):
        if link not in links:
            message = f"joint `{joint.name}` has the unknown {role} link `{link}`; {expected_names(link, links)}"
            raise bad_input("unknown-link", message, joint.place)
    if joint.mimic is None:
        return
    movable = {name: other for name, other in joints.items() if other.movable and name != joint.name}
    leader = movable.get(joint.mimic.joint)
    if leader is None:
        expected = expected_names(joint.mimic.joint, movable)
        message = f"joint `{joint.name}` follows `{joint.mimic.joint}`, which is no other movable joint; {expected}"
        raise bad_input("unknown-joint", message, joint.place)
    if leader.mimic is not None:
        message = f"joint `{joint.name}` follows `{leader.name}`, which follows `{leader.mimic.joint}` itself"
        raise bad_input("wrong-mimic", message, joint.place, mend=f"let it follow `{leader.mimic.joint}`")


def _root(links: Mapping[str, urdf.UrdfLink], joints: Mapping[str, urdf.UrdfJoint], place: Place) -> str:
    """The one link that no joint carries; checks that every link is reached from it exactly once."""
    carriers: dict[str, urdf.UrdfJoint] = {}
    for joint in joints.values():
        if joint.child in carriers:
            other = carriers[joint.child].name
            message = f"link `{joint.child}` is the child of two joints, `{other}` and `{joint.name}`"
            raise bad_input("two-parents", message, joint.place)
        carriers[joint.child] = joint
    roots = [name for name in links if name not in carriers]
    if len(roots) > 1:
        message = f"links `{roots[0]}` and `{roots[1]}` are both roots; a joint must connect them"
        raise bad_input("two-roots", message, links[roots[1]].place)
    rooted: set[str] = set()
    for name in links:
        walked = {name: None}
        while name in carriers and name not in rooted:
            name = carriers[name].parent
            if name in walked:
                way = [*walked]
                cycle = [*way[way.index(name) :], name]
                message = "links form a cycle: " + " -> ".join(f"`{link}`" for link in reversed(cycle))
                mend = f"leave out one of their joints, such as `{carriers[cycle[0]].name}`: a URDF is a tree"
                raise bad_input("cycle", message, carriers[cycle[0]].place, mend=mend)
            walked[name] = None
        rooted.update(walked)
    if not roots:
        raise bad_input("cycle", "no link is a root", place)
    return roots[0]


def _outwards(root: str, joints: Mapping[str, urdf.UrdfJoint]) -> dict[str, urdf.UrdfJoint]:
    """The joints with every joint after the one that carries it, otherwise in file order."""
    children: dict[str, list[urdf.UrdfJoint]] = {}
    for joint in joints.values():
        children.setdefault(joint.parent, []).append(joint)
    ordered: dict[str, urdf.UrdfJoint] = {}
    waiting = list(reversed(children.get(root, [])))
    while waiting:
        joint = waiting.pop()
        ordered[joint.name] = joint
        waiting.extend(reversed(children.get(joint.child, [])))
    return ordered
