"""Robot descriptions from URDF: links with their solid geometry, and the joints between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Literal

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Part, Sphere

JointType = Literal["fixed", "revolute", "continuous", "prismatic"]
Resolve = Callable[[str, Path], Path]
"""Finds the file of a mesh reference: (reference, URDF that has it) -> path; raises InputError if there is none."""
MeshReference = tuple[str, tuple[float, float, float]]
"""A mesh as the URDF names it, `package://...`, `file://...` or a path relative to it, and its scale along x, y, z."""
LinkShape = Box | Sphere | Cylinder | Capsule | MeshReference


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """One solid piece of a link."""

    name: str | None  # none where the URDF gives none
    shape: LinkShape
    X_LG: Array  # its pose in the link, shape (4, 4)
    place: Place


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass and inertia of a link."""

    mass: float  # [kg]
    X_LI: Array  # pose of the inertial frame, whose origin is the centre of mass, in the link, shape (4, 4)
    inertia: Array  # about the centre of mass, along the axes of that frame [kg m^2], shape (3, 3)


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A link with everything solid on it, in file order."""

    name: str
    collision: tuple[LinkGeometry, ...]
    visual: tuple[LinkGeometry, ...]
    inertial: Inertial | None  # none where the URDF gives none
    place: Place

    def geometry(self, preferred: Geometry) -> tuple[LinkGeometry, ...]:
        """The preferred geometry, or the other one if the link has none of it."""
        pair = (self.collision, self.visual) if preferred == "collision" else (self.visual, self.collision)
        return pair[0] or pair[1]


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: position = multiplier * position of `joint` + offset [rad or m]."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False, kw_only=True)
class UrdfJoint:
    """A joint between two links."""

    name: str
    type: JointType
    parent: str
    child: str
    X_PJ: Array  # pose of the joint, and of the child link when the joint is at 0, in the parent link, shape (4, 4)
    axis: Array  # unit vector in the joint's frame, shape (3,); meaningless for a fixed joint
    lower: float = 0.0  # position limit [rad or m], infinite for a continuous joint
    upper: float = 0.0  # likewise
    velocity: float | None = None  # limit [rad/s or m/s]; None if the URDF gives none (0 means the same)
    effort: float | None = None  # limit [Nm or N], likewise
    mimic: Mimic | None = None  # never set for a fixed joint
    place: Place

    @property
    def movable(self) -> bool:
        """Whether the joint moves, driven or by mimicking another one."""
        return self.type != "fixed"

    @property
    def rest(self) -> float:
        """Where the joint rests: 0, or the position limit nearest to it [rad or m]."""
        return min(max(0.0, self.lower), self.upper)


@dataclass(frozen=True, eq=False)
class UrdfModel:
    """A robot description: a tree of links."""

    name: str
    path: Path  # the file that it was read from
    links: Mapping[str, UrdfLink]  # in file order
    joints: Mapping[str, UrdfJoint]  # from the root outwards, parents first
    root: str
    warnings: tuple[Problem, ...] = ()  # about doubtful values
    content: bytes = b""  # what it was read from: the file, or what its xacro stands for
    expanded: str | None = None  # the URDF as text if the file is a xacro; None for a plain one
    packages: tuple[str, ...] = ()  # the packages that the xacro names
    is_mjcf: bool = False  # whether the file is an MJCF
    prefix: str = ""  # before the names of all links, joints and pieces, but not in the content

    def prefixed(self, prefix: str) -> UrdfModel:
        """The same description with a prefix before the name of every link, joint and piece of geometry."""
        links, joints = {}, {}
        for link in self.links.values():
            collision, visual = (
                tuple(replace(piece, name=piece.name and prefix + piece.name) for piece in pieces)
                for pieces in (link.collision, link.visual)
            )
            links[prefix + link.name] = replace(link, name=prefix + link.name, collision=collision, visual=visual)
        for joint in self.joints.values():
            name, parent, child = prefix + joint.name, prefix + joint.parent, prefix + joint.child
            mimic = joint.mimic and replace(joint.mimic, joint=prefix + joint.mimic.joint)
            joints[name] = replace(joint, name=name, parent=parent, child=child, mimic=mimic)
        return replace(self, links=links, joints=joints, root=prefix + self.root, prefix=prefix + self.prefix)

    @property
    def movable_joints(self) -> tuple[UrdfJoint, ...]:
        """Every joint that is not fixed, parents first."""
        return tuple(joint for joint in self.joints.values() if joint.movable)

    @cached_property
    def _carriers(self) -> Mapping[str, UrdfJoint]:
        """The joint that carries each link but the root."""
        return {joint.child: joint for joint in self.joints.values()}

    @cached_property
    def body_of(self) -> Mapping[str, str]:
        """The rigid body that each link belongs to, named by its link nearest to the root; parents first."""
        body_of = {self.root: self.root}
        for joint in self.joints.values():
            body_of[joint.child] = joint.child if joint.movable else body_of[joint.parent]
        return body_of

    def chain(self, link: str) -> list[UrdfJoint]:
        """The joints on the way from the root to a link; none if there is no such link."""
        chain: list[UrdfJoint] = []
        while link in self._carriers:
            chain.append(self._carriers[link])
            link = chain[-1].parent
        return chain[::-1]

    def rigid_with(self, link: str) -> list[str]:
        """The links rigidly connected to a link, itself included; parents first."""
        body = self.body_of[link]
        return [other for other, of in self.body_of.items() if of == body]

    def beyond(self, link: str) -> list[str]:
        """Every link that moves with a link, itself first."""
        links = {link: None}
        for joint in self.joints.values():
            if joint.parent in links:
                links[joint.child] = None
        return [*links]

    def pose_in(self, root: str, link: str) -> Array:
        """Pose of a link in another one that carries it, shape (4, 4), with the joints between them at 0."""
        X = np.eye(4)
        while link != root:
            X = self._carriers[link].X_PJ @ X
            link = self._carriers[link].parent
        return X

    def parts(self, geometry: Geometry, resolve: Resolve) -> tuple[Part, ...]:
        """The solid parts of every link, in file order.

        A link's first part has the link's name, further ones the name that the URDF gives them if no other part or link
        has it, else the link's name with a number. A link without the chosen geometry uses the other one.

        Raises InputError if `resolve` does not find a mesh, at the line that names it.
        """
        named = Counter(piece.name for link in self.links.values() for piece in link.geometry(geometry))
        taken = set(self.links)
        parts = []
        for link in self.links.values():
            for index, piece in enumerate(link.geometry(geometry)):
                name = link.name
                if index > 0:
                    own = piece.name if named[piece.name] == 1 and piece.name not in taken else None
                    numbered = (f"{link.name}_{number}" for number in count(index + 1))
                    name = own or next(other for other in numbered if other not in taken)
                taken.add(name)
                try:
                    meant = piece.shape
                    shape = Mesh(resolve(meant[0], self.path), meant[1]) if isinstance(meant, tuple) else meant
                except InputError as error:
                    first = error.problems[0]
                    raise bad_input(first.code, first.message, piece.place, mend=first.mend) from error
                parts.append(Part(name, link.name, shape, piece.X_LG))
        return tuple(parts)


TOOL_BODY, TOOL_TIP = "tool_body", "tool_tip"  # the links of such a tool: its root with the boxes, and the grasp frame


def tool_of_boxes(boxes: Sequence[tuple[tuple[float, float, float], Array]], path: Path, place: Place) -> UrdfModel:
    """A tool as a robot description without a file of its own, or of no box just its root link.

    boxes: full extents [m] of each, and the pose of its centre in the root link, shape (4, 4). path, place: of the file
    and the entry that describe it.
    """
    solid = tuple(LinkGeometry(None, Box(size), read_only(X_BG), place) for size, X_BG in boxes)
    return UrdfModel("tool", path, {TOOL_BODY: UrdfLink(TOOL_BODY, solid, (), None, place)}, {}, TOOL_BODY)


def with_tip(tool: UrdfModel, X_RT: Array, place: Place) -> UrdfModel:
    """A tool with the frame that grasps as one more link. X_RT: its pose in the root link, shape (4, 4)."""
    tip, X_PJ, axis = tool.prefix + TOOL_TIP, read_only(X_RT), read_only([1.0, 0.0, 0.0])
    name = f"{tip}_joint"
    joint = UrdfJoint(name=name, type="fixed", parent=tool.root, child=tip, X_PJ=X_PJ, axis=axis, place=place)
    links = {**tool.links, tip: UrdfLink(tip, (), (), None, place)}
    return replace(tool, links=links, joints={**tool.joints, name: joint})
