"""Reading a URDF into the records of `urdf`, checking that its links form a tree, and doubting its values.

The format: http://wiki.ros.org/urdf/XML. Transmissions, sensors, materials and simulator extensions are not read. A
`<capsule>` (radius and length of its straight part) is accepted besides the standard shapes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.errors import Problem, bad_input, expected_names, first_names
from sqrp_cli.files.frames import WORLD, WORLD_LINK
from sqrp_cli.files.units import LARGEST_LENGTH, NO_LIMIT, SMALLEST_LIMIT, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import Element
from sqrp_cli.geometry import Array, displacement, pose, read_only, rpy_to_matrix
from sqrp_cli.robot import urdf
from sqrp_cli.robot.robot_xml import RobotSource, read_robot_xml
from sqrp_cli.shapes import FIGURES, shape_of

MAX_LINKS, MAX_JOINTS, MAX_SHAPES = 2000, 200, 500
"""Most links, movable joints and shapes of a robot, collision and visual ones together."""
LONGEST_SLIDE = 100.0  # largest position limit of a prismatic joint [m]
MOST_TURNS = 100
"""Largest position limit of a turning joint [turns]; larger ones mean "no limit" and are clipped to this."""
NAMED = 5  # most links or joints that a warning names
LEAST_MOMENT = 1e-9  # moments of inertia below this are rounding [kg m^2]
ROUNDING = 1e-4  # share of the largest principal moment by which another may be below 0: exported moments are rounded
TRIANGLE_ROUNDING = 0.05  # share by which a principal moment may be above the sum of the others, likewise
_JOINT_TYPES: tuple[urdf.JointType, ...] = ("fixed", "revolute", "continuous", "prismatic")
_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius",)}
"""Attributes of shapes that are nothing if one is 0; a capsule without a straight part is a sphere."""


def read_urdf(path: Path, source: RobotSource | None = None) -> urdf.UrdfModel:
    """Read and validate a URDF, expanded first if it has xacro elements; source: what else it is made of.

    A turning joint has limits of at most `MOST_TURNS`: that many turns are as good as no limit, and joint positions
    keep their precision. Doubtful values get a warning.

    Raises InputError, with file and line, for XML that cannot be read (see `read_robot_xml`), missing or malformed
    values, a repeated name, an unknown link or joint, an axis of length zero, a missing position limit, a joint type
    that is not supported (floating, planar), a mass or moment of inertia below 0, too many links, joints or shapes, and
    links that do not form one tree.
    """
    xml = read_robot_xml(path, source, mjcf=True)
    robot = xml.robot
    moving = sum(joint.attributes.get("type", "").strip() != "fixed" for joint in robot.all("joint"))
    if (count := len([*robot.all("link")])) > MAX_LINKS or moving > MAX_JOINTS:
        message = f"the robot has {count:,} links and {moving:,} joints that move"
        message += f", expected at most {MAX_LINKS:,} links and {MAX_JOINTS} joints that move"
        raise robot.error("too-many-links", message)
    pieces = [(link, one) for link in robot.all("link") for one in link.children if one.tag in ("collision", "visual")]
    if len(pieces) > MAX_SHAPES:
        message = f"this is shape {MAX_SHAPES + 1:,} of {len(pieces):,}, expected at most {MAX_SHAPES:,} <collision>"
        message += " and <visual> of a robot together"
        mend = "join them into meshes, or state what stands around the robot as objects of the workspace"
        raise pieces[MAX_SHAPES][1].error("too-many-shapes", message, mend)
    links, joints = dict[str, urdf.UrdfLink](), dict[str, urdf.UrdfJoint]()
    for element in (*robot.all("link"), *robot.all("joint")):
        known: dict[str, Any] = links if element.tag == "link" else joints
        item = _link(element) if element.tag == "link" else _joint(element)
        if item.name in known:
            message = f"{element.tag} `{item.name}` is defined twice, first at line {known[item.name].place.line}"
            raise bad_input("duplicate-name", message, item.place)
        known[item.name] = item
    if not links:
        raise robot.error("no-links", "the robot has no <link>")
    root = _root(links, joints)
    # Every joint after the one that carries it, otherwise in file order.
    ordered: dict[str, urdf.UrdfJoint] = {}
    children: dict[str, list[urdf.UrdfJoint]] = {}
    for joint in joints.values():
        children.setdefault(joint.parent, []).insert(0, joint)
    waiting = [*children.get(root, [])]
    while waiting:
        joint = waiting.pop()
        ordered[joint.name] = joint
        waiting += children.get(joint.child, [])
    model = urdf.UrdfModel(robot.attributes.get("name", path.stem), path, links, ordered, root)
    warnings = (*xml.warnings, *_let_go(model, ordered), *_doubts(model, pieces))
    most = 2 * math.pi * MOST_TURNS
    for name, joint in ordered.items():
        if joint.type == "revolute":
            ordered[name] = replace(joint, lower=max(joint.lower, -most), upper=min(joint.upper, most))
    if WORLD in links:
        called = {name: name for name in links} | {WORLD: WORLD_LINK}
        links = {called[name]: replace(link, name=called[name]) for name, link in links.items()}
        for name, joint in ordered.items():
            ordered[name] = replace(joint, parent=called[joint.parent], child=called[joint.child])
        model = replace(model, links=links, root=called[root])
    model = replace(model, content=xml.content, expanded=xml.expanded, packages=xml.packages, warnings=warnings)
    return replace(model, is_mjcf=xml.is_mjcf)


def _link(element: Element) -> urdf.UrdfLink:
    pieces: dict[str, list[urdf.LinkGeometry]] = {"collision": [], "visual": []}
    for piece in (child for child in element.children if child.tag in pieces and not _is_empty(child)):
        holder = piece.need("geometry")
        if len(holder.children) != 1:
            raise holder.error("wrong-geometry", f"<geometry> has {len(holder.children)} shapes, expected one")
        shape = holder.children[0]
        if shape.tag == "mesh":
            x, y, z = shape.numbers("scale", 3, (1.0, 1.0, 1.0))
            if 0.0 in (x, y, z):
                raise shape.error("wrong-value", "the mesh's `scale` has a zero, which would flatten it")
            form: urdf.LinkShape = (shape.text("filename"), (x, y, z))
        elif shape.tag in FIGURES:
            figures: list[float] = []
            for key, count in FIGURES[shape.tag].items():
                figures += shape.numbers(key, count, most=LARGEST_LENGTH)
                if min(figures) < SMALLEST_SIZE:
                    found = f"{shape}: `{key}` is `{shape.text(key)}`"
                    raise shape.error("wrong-value", f"{found}, expected it above 0, at least {SMALLEST_SIZE:g}")
            form = shape_of(shape.tag, figures)
        else:
            expected = expected_names(shape.tag, (*FIGURES, "mesh"))
            raise shape.error("unknown-shape", f"unknown shape {shape}; {expected}")
        name = piece.attributes.get("name")
        pieces[piece.tag].append(urdf.LinkGeometry(name, form, _origin(piece), shape.place))
    name, inertial, body = element.text("name"), element.first("inertial"), None
    if inertial is not None and inertial.first("mass") is not None:
        moments, keys = inertial.first("inertia"), ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        xx, xy, xz, yy, yz, zz = (0.0 if moments is None else moments.number(key, 0.0) for key in keys)
        mass, least = inertial.need("mass").number("value"), min(xx, yy, zz)
        if mass < 0.0:
            raise inertial.need("mass").error("wrong-value", f"link `{name}` has a mass of {mass:g} kg")
        if moments is not None and least < -LEAST_MOMENT:
            message = f"link `{name}` has a moment of inertia of {least:g} kg m^2, expected none below 0"
            raise moments.error("wrong-value", message)
        inertia = read_only([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = urdf.Inertial(mass, _origin(inertial), inertia)
    return urdf.UrdfLink(name, tuple(pieces["collision"]), tuple(pieces["visual"]), body, element.place)


def _is_empty(piece: Element) -> bool:
    """Whether a <collision> or <visual> is nothing: a box, sphere, cylinder or capsule with a size of 0."""
    shapes = [shape for holder in piece.all("geometry") for shape in holder.children if shape.tag in _SIZES]
    sizes = [size for shape in shapes for key in _SIZES[shape.tag] for size in shape.attributes.get(key, "").split()]
    return any(as_number(size) == 0.0 for size in sizes)


def _joint(element: Element) -> urdf.UrdfJoint:
    name, kind = element.text("name"), element.text("type")
    if kind in ("floating", "planar"):
        message = f"joint `{name}` is {kind}; only {', '.join(_JOINT_TYPES)} are supported"
        raise element.error("unsupported-joint", message)
    if kind not in _JOINT_TYPES:
        expected = expected_names(kind, _JOINT_TYPES)
        raise element.error("unknown-joint-type", f"joint `{name}` has the unknown type `{kind}`; {expected}")
    fixed, bounded = kind == "fixed", kind in ("revolute", "prismatic")
    lower, upper = (-math.inf, math.inf) if kind == "continuous" else (0.0, 0.0)
    velocity, effort, limit = 0.0, 0.0, element.first("limit")  # 0 where URDF states none
    if limit is None and bounded:
        raise element.error("missing-limit", f"joint `{name}` is {kind} but has no <limit>")
    if limit is not None:
        figures = {key: limit.number(key, 0.0, NO_LIMIT) for key in ("velocity", "effort")[fixed:]}
        for key, value in figures.items():
            if value < 0.0:
                raise limit.error("wrong-value", f"`{key}` is {value:g}, expected a positive number")
        velocity, effort = figures.get("velocity", 0.0), figures["effort"]
        if 0.0 < velocity < SMALLEST_LIMIT:
            message = f"`velocity` is {velocity:g}, expected at least {SMALLEST_LIMIT:g}, or 0 for none stated"
            raise limit.error("wrong-value", message)
        if bounded:
            most = NO_LIMIT if kind == "revolute" else LONGEST_SLIDE
            lower, upper = (limit.number(bound, 0.0, most) for bound in ("lower", "upper"))
        if lower > upper:
            message = f"joint `{name}` has a lower limit of {lower:g}, above its upper limit of {upper:g}"
            raise limit.error("wrong-value", message)
    direction = np.array([1.0, 0.0, 0.0])
    if (axis := element.first("axis")) is not None and not fixed:
        direction = np.array(axis.numbers("xyz", 3))
        if (length := np.linalg.norm(direction)) < 1e-9:
            message, mend = f"the axis of joint `{name}` has length zero", 'name it, such as xyz="0 0 1"'
            raise axis.error("zero-axis", message, mend)
        direction = direction / length
    mimic, follows = element.first("mimic"), None
    if mimic is not None and not fixed:
        multiplier, offset = mimic.number("multiplier", 1.0), mimic.number("offset", 0.0)
        follows = urdf.Mimic(mimic.text("joint"), multiplier, offset)
    return urdf.UrdfJoint(
        name=name,
        type=_JOINT_TYPES[_JOINT_TYPES.index(kind)],
        parent=element.need("parent").text("link"),
        child=element.need("child").text("link"),
        X_PJ=_origin(element),
        axis=read_only(direction),
        lower=lower,
        upper=upper,
        velocity=velocity or None,
        effort=effort or None,
        mimic=follows,
        place=element.place,
    )


def _origin(element: Element) -> Array:
    origin = element.first("origin")
    if origin is None:
        return read_only(np.eye(4))
    xyz = origin.numbers("xyz", 3, (0.0, 0.0, 0.0), LARGEST_LENGTH)
    return read_only(pose(rpy_to_matrix(origin.numbers("rpy", 3, (0.0, 0.0, 0.0))), xyz))


def _root(links: Mapping[str, urdf.UrdfLink], joints: Mapping[str, urdf.UrdfJoint]) -> str:
    """The one link that no joint carries; checks that every link is reached from it exactly once.

    Raises InputError also for joints between unknown links, or that follow a joint that follows another one.
    """
    for joint in joints.values():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                message = f"joint `{joint.name}` has the unknown {role} link `{link}`; {expected_names(link, links)}"
                raise bad_input("unknown-link", message, joint.place)
        leader = None if joint.mimic is None else joints.get(joint.mimic.joint)
        if leader is not None and joint.mimic is not None and leader.mimic is not None and leader is not joint:
            message = f"joint `{joint.name}` follows `{leader.name}`, which follows `{leader.mimic.joint}` itself"
            raise bad_input("wrong-mimic", message, joint.place, mend=f"let it follow `{leader.mimic.joint}`")
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
    try:
        TopologicalSorter({child: [joint.parent] for child, joint in carriers.items()}).prepare()
    except CycleError as error:
        cycle: list[str] = error.args[1]
        message = "links form a cycle: " + " -> ".join(f"`{link}`" for link in cycle)
        last = max((carriers[link] for link in cycle), key=lambda joint: joint.place.line or 0)
        mend = f"leave out one of their joints, such as `{last.name}`: a URDF is a tree"
        raise bad_input("cycle", message, last.place, mend=mend) from None
    return roots[0]


def _let_go(model: urdf.UrdfModel, joints: dict[str, urdf.UrdfJoint]) -> Iterator[Problem]:
    """Change the joints that follow no joint that moves, such as fingers of a hand in parts; a warning for each.

    One that follows a fixed joint stands still at its offset, any other one moves by itself. Raises InputError for one
    that carries joints which move by themselves: it is of an arm.
    """
    for joint in [*joints.values()]:
        leader = None if joint.mimic is None else joints.get(joint.mimic.joint)
        if joint.mimic is None or (leader is not None and leader.movable and leader is not joint):
            continue
        message, beyond = f"joint `{joint.name}` follows `{joint.mimic.joint}`", model.beyond(joint.child)
        if any(other.movable and other.mimic is None and other.parent in beyond for other in joints.values()):
            movable = [name for name, other in joints.items() if other.movable and name != joint.name]
            message += f", which is no other movable joint; {expected_names(joint.mimic.joint, movable)}"
            raise bad_input("unknown-joint", message, joint.place)
        joints[joint.name] = replace(joint, mimic=None)
        found = "is no other joint of this file: it moves by itself"
        if leader is not None and leader is not joint:
            turn = displacement(np.zeros(3), joint.axis * joint.mimic.offset)
            moved = pose(position=joint.axis * joint.mimic.offset) if joint.type == "prismatic" else turn
            joints[joint.name] = replace(joint, mimic=None, type="fixed", X_PJ=read_only(joint.X_PJ @ moved))
            found = "is fixed: it stands still"
        yield Problem("unknown-joint", f"{message}, which {found}", joint.place, severity="warning",
                      mend="name the joint that it follows, or leave <mimic> out")  # fmt: skip


def _doubts(model: urdf.UrdfModel, pieces: Sequence[tuple[Element, Element]]) -> Iterator[Problem]:
    """Warnings about limits that are none, joints that cannot move, impossible inertias and shapes without a size.

    pieces: each <collision> and <visual>, after its link.
    No principal moment of a body is below 0 or above the sum of the others (the triangle rule). Exported products of
    inertia sometimes break it, so it is not an error. Links fixed to each other make one body.
    """
    joints, most = model.joints.values(), 2 * math.pi * MOST_TURNS
    endless = [joint for joint in joints if joint.type == "revolute" and max(-joint.lower, joint.upper) > most]
    blocked = [joint for joint in joints if joint.movable and joint.lower == joint.upper and not joint.mimic]
    stated = [(link, link.inertial) for link in model.links.values() if link.inertial is not None]
    sound = {model.root, *(model.body_of[link.name] for link, inertial in stated if inertial.mass > 0.0)}
    weightless = [link for link, _ in stated if link.collision and model.body_of[link.name] not in sound]
    impossible = []
    for link, inertial in stated:
        low, middle, high = np.linalg.eigvalsh(inertial.inertia).tolist()
        too_large = high > (1.0 + TRIANGLE_ROUNDING) * (low + middle) + LEAST_MOMENT
        if too_large or low < -ROUNDING * max(high, 0.0) - LEAST_MOMENT:
            impossible.append(link)
    turns = f"position limits of {MOST_TURNS} turns ({most:.0f} rad) or more, which are taken as {MOST_TURNS} turns"
    doubts: tuple[tuple[str, Sequence[urdf.UrdfLink | urdf.UrdfJoint], str, str], ...] = (
        ("no-limit", endless, turns, 'a joint without limits has the type "continuous"'),
        ("no-motion", blocked, "a `lower` that is its `upper` limit, and cannot move",
            'state both limits, or make it a joint of the type "fixed"'),
        ("no-mass", weightless, "a mass of 0 kg although solid and moving, simulated as 500 kg/m^3",
            "state the mass, usually 0.01 kg to 1000 kg"),
        ("doubtful-inertia", impossible,
            "a principal moment of inertia below 0 or above the sum of the other two, which no body has",
            "check units and signs of <inertia>, in kg m^2"),
    )  # fmt: skip
    for code, found, doubt, mend in doubts:
        if found:  # one warning names all of them, at the place of the first
            kind = "link" if isinstance(found[0], urdf.UrdfLink) else "joint"
            names, several = first_names((item.name for item in found), NAMED), len(found) > 1
            message = f"{kind}{'s' * several} {names} {'have' if several else 'has'} {doubt}"
            yield Problem(code, message, found[0].place, severity="warning", mend=mend)
    if empty := [(link.text("name"), piece) for link, piece in pieces if _is_empty(piece)]:
        names, place = first_names(dict.fromkeys(name for name, _ in empty)), empty[0][1].place
        message = f"a shape with a size of 0 is left out, of {names}"
        yield Problem("no-size", message, place, severity="warning", mend="state its size, or remove it")
