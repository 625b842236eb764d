"""Reading the robot of a cell: URDF, SRDF, tool, home, limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from sqrp_cli.errors import Problem, bad_input, expected_names, no_such
from sqrp_cli.geometry import read_only
from sqrp_cli.knowledge.frames import link_called
from sqrp_cli.knowledge.robot import robot
from sqrp_cli.knowledge.robot.joint_tree import driving_joints
from sqrp_cli.knowledge.robot.moveit_limits import MoveitLimits, read_moveit_limits, with_position_limits
from sqrp_cli.knowledge.robot.read_urdf import read_urdf
from sqrp_cli.knowledge.robot.srdf import SrdfModel, read_srdf
from sqrp_cli.knowledge.robot.urdf import TOOL_TIP, UrdfJoint, UrdfModel, tool_of_boxes
from sqrp_cli.knowledge.text import packages, units
from sqrp_cli.knowledge.text.entries import Pose, XacroEntry
from sqrp_cli.knowledge.text.source import KeyPath, dotted
from sqrp_cli.knowledge.text.units import SMALLEST_LIMIT, Dimension, Quantity, expected_quantity
from sqrp_cli.knowledge.workspace.entry_reader import EntryReader
from sqrp_cli.shapes import Mesh, Part

MAX_ARM_JOINTS = 20
"""Most joints that move the tool frame; each makes inverse kinematics and motion slower."""


@dataclass(kw_only=True)
class RobotReader(EntryReader):
    """Reads the `robot` entry of a workspace file.

    URDF and SRDF are read first: their InputError is raised at once, because nothing can be checked without them.
    """

    entry: robot.RobotEntry
    _parts: list[Part] = field(default_factory=list)

    def __post_init__(self) -> None:
        folder = self.document.folder
        stated = [folder / root for root in self.entry.package_roots]
        self.roots = packages.package_roots(stated)
        for index, root in enumerate(stated):
            if not root.is_dir():
                self._report("missing-folder", ("robot", "package_roots", index), f"there is no folder {root}")
        self.urdf = self._read_urdf(self.entry.urdf, ("robot", "urdf"))
        self.moveit: MoveitLimits | None = None
        if self.entry.limits.moveit is not None:
            self.moveit = self._read_moveit(self.entry.limits.moveit)
            self.urdf = with_position_limits(self.urdf, self.moveit)
        self.srdf: SrdfModel | None = None
        if self.entry.srdf is not None:
            self.srdf_path, source = self._described(self.entry.srdf, ("robot", "srdf"))
            self.srdf = read_srdf(self.srdf_path, self.urdf, source)
            self.digest.add("robot.srdf", self.srdf_path, self.srdf.content)
            self.warnings += self.srdf.warnings
        self.tool = None if self.entry.tool is None else self._read_tool(self.entry.tool)
        if self.entry.tool_frame is None and (self.entry.tool is None or self.entry.tool.frame is None):
            message = "`robot`: the key `tool_frame` is missing: the link that grasps"
            raise bad_input("missing-key", message, self.document.key_place(("robot",)))
        tip = TOOL_TIP if self.entry.tool is None else self.entry.tool.prefix + TOOL_TIP
        self.tool_frame = link_called(self.entry.tool_frame or tip, self.links)

    @property
    def links(self) -> tuple[str, ...]:
        """The links of robot and tool."""
        return (*self.urdf.links, *(self.tool.links if self.tool else ()))

    def read(self) -> robot.Robot:
        """The robot; meaningful only if `problems` is empty afterwards."""
        tool = self._tool()
        arm = self._arm()
        joints = [*self.urdf.movable_joints, *(self.tool.movable_joints if self.tool else ())]
        limits = self._limits(joints)
        usual = robot.ANGLE_TOLERANCE if len(arm) < robot.AXES_OF_A_POSE else 0.0
        return robot.Robot(
            urdf=self.urdf,
            srdf=self.srdf_path if self.srdf is not None else None,
            package_roots=self.roots,
            X_WB=read_only(self.entry.base.matrix()),
            tool=tool,
            tool_frame=self.tool_frame,
            home=self._home(arm),
            limits=limits,
            stop_limits=self._stop_limits(limits, joints),
            angle_tolerance=usual if self.entry.angle_tolerance is None else self.entry.angle_tolerance,
            geometry=self.entry.geometry,
            parts=tuple(self._parts),
            disabled_pairs=self.srdf.disabled_pairs if self.srdf else frozenset(),
            fingers=self._fingers(joints, arm),
            markers=self._markers(),
        )

    def _read_moveit(self, reference: str) -> MoveitLimits:
        file = self._resolve(reference, self.document.value_place(("robot", "limits", "moveit")))
        limits = read_moveit_limits(file)
        self.digest.add("robot.limits.moveit", file, limits.document.content)
        return limits

    def _read_urdf(self, entry: XacroEntry | str, path: KeyPath, prefix: str = "") -> UrdfModel:
        urdf = read_urdf(*self._described(entry, path)).prefixed(prefix)
        self.warnings += urdf.warnings
        self.digest.add(dotted(path), urdf.path, urdf.content)
        parts = urdf.parts(self.entry.geometry, partial(packages.resolve_mesh, self.roots))
        self._parts += parts
        pieces = (piece for link in urdf.links.values() for piece in link.geometry(self.entry.geometry))
        for part, piece in zip(parts, pieces, strict=True):
            if isinstance(part.shape, Mesh):
                self._add_mesh(f"{dotted(path)}.{part.name}", part.shape, piece.place)
        return urdf

    def _read_tool(self, entry: robot.ToolEntry) -> UrdfModel:
        if entry.urdf is not None:
            return self._read_urdf(entry.urdf, ("robot", "tool", "urdf"), entry.prefix)
        place = self.document.key_place(("robot", "tool", "boxes"))
        boxes = [(box.size, box.pose.matrix()) for box in entry.boxes or ()]
        tool = tool_of_boxes(boxes, (entry.frame or Pose()).matrix(), self.document.path.absolute(), place)
        tool = tool.prefixed(entry.prefix)
        self._parts += tool.parts(self.entry.geometry, partial(packages.resolve_mesh, self.roots))
        return tool

    def _tool(self) -> robot.Tool | None:
        if self.entry.tool is None or self.tool is None:
            return None
        link = link_called(self.entry.tool.link, self.urdf.links)
        if link not in self.urdf.links:
            self._report("unknown-link", ("robot", "tool", "link"), no_such(link, "link", self.urdf.links))
        path = ("robot", "tool", "urdf" if self.entry.tool.urdf else "boxes")
        moving = [{joint.name for joint in model.movable_joints} for model in (self.urdf, self.tool)]
        shared = [f"link `{name}`" for name in self.tool.links if name in self.urdf.links]
        shared += [f"joint `{name}`" for name in sorted(moving[0] & moving[1])]
        if shared:
            others = f", and {len(shared) - 1} more names in common" if len(shared) > 1 else ""
            mend = "tell the tool's apart by a prefix: `prefix: tool_` in `robot.tool`"
            self._report("ambiguous-name", path, f"robot and tool both have a {shared[0]}{others}", mend)
        file = None if self.entry.tool.urdf is None else self.tool.path
        return robot.Tool(self.tool, link, read_only(self.entry.tool.pose.matrix()), file)

    def _arm(self) -> list[UrdfJoint]:
        """The joints that drive those from the root to the tool frame, in order."""
        frame = self.tool_frame
        if frame not in self.links:
            self._report("unknown-link", ("robot", "tool_frame"), no_such(frame, "link", self.links))
            return []
        on_tool: list[UrdfJoint] = []
        if self.tool is not None and self.entry.tool is not None and frame not in self.urdf.links:
            on_tool, frame = self.tool.chain(frame), link_called(self.entry.tool.link, self.urdf.links)
            if frame not in self.urdf.links:
                return []  # `_tool` says so
        chain = (*self.urdf.chain(frame), *on_tool)
        arm = driving_joints(chain, [*self.urdf.movable_joints, *(self.tool.movable_joints if self.tool else ())])
        if not arm:
            message = f"no joint moves `{self.tool_frame}`; expected a link at the end of the arm"
            self._report("unmoved-tool-frame", ("robot", "tool_frame"), message)
        if len(arm) > MAX_ARM_JOINTS:
            message = f"{len(arm)} joints move `{self.tool_frame}`, expected at most {MAX_ARM_JOINTS} in an arm"
            raise bad_input("too-many-joints", message, arm[MAX_ARM_JOINTS].place)
        return arm

    def _home(self, arm: Sequence[UrdfJoint]) -> dict[str, float]:
        path = ("robot", "home")
        positions = self._positions(self.entry.home, arm, path, "no joint that moves the tool frame") if arm else None
        if positions is None:
            return {}
        missing = [joint.name for joint in arm if joint.name not in positions]
        if missing:
            names = ", ".join(f"`{name}`" for name in missing)
            self._report("missing-joint", path, f"lacks a position for {names}")
        return positions

    def _fingers(self, joints: Sequence[UrdfJoint], arm: Sequence[UrdfJoint]) -> robot.Fingers | None:
        entry = self.entry.fingers
        if entry is None:
            return None
        driven = [joint for joint in joints if joint.mimic is None and joint not in arm]
        what = "no joint outside the arm that moves by itself"
        path = ("robot", "fingers")
        opened = self._positions(entry.open, driven, (*path, "open"), what)
        closed = self._positions(entry.closed, driven, (*path, "closed"), what)
        if opened is None or closed is None:
            return None
        if not opened or opened.keys() != closed.keys():
            names = ", ".join(f"`{name}`" for name in sorted(opened.keys() ^ closed.keys()))
            message = f"`open` and `closed` must name the same joints; only one of them has {names or 'any joint'}"
            self._report("missing-joint", path, message)
        if opened == closed:
            self._report("wrong-value", (*path, "closed"), "the fingers are where they are when open, so nothing moves")
        return robot.Fingers(opened, {name: closed[name] for name in opened if name in closed}, entry.width)

    def _markers(self) -> dict[str, robot.Marker]:
        ids: dict[tuple[str, int], str] = {}
        for named, marker in self.entry.markers.items():
            path, link = ("robot", "markers", named), link_called(named, self.links)
            if link not in self.links:
                self._report("unknown-link", path, no_such(link, "link", self.links))
            key = (marker.dictionary, marker.id)
            if ids.setdefault(key, link) != link:
                self._report("repeated-value", (*path, "id"), f"`{ids[key]}` has the marker {marker.id} too")
        return {link_called(link, self.links): marker for link, marker in self.entry.markers.items()}

    def _positions(
        self, entry: Mapping[str, Quantity] | str, joints: Sequence[UrdfJoint], path: KeyPath, what: str
    ) -> dict[str, float] | None:
        """Positions within limits of the joints that an entry names, in their order; None if a name or unit is wrong.

        what: describes a joint that is not among them, in a message. Other joints of an SRDF state are left out.
        """
        if isinstance(entry, str):
            states = self.srdf.states if self.srdf else {}
            if entry not in states:
                self._report("unknown-state", path, no_such(entry, "named state of an SRDF", states))
                return None
            positions = dict(states[entry])
        else:
            positions = self._quantities(entry, joints, path, what)
            if len(positions) < len(entry):
                return None
        for joint in joints:
            position = positions.get(joint.name, joint.lower)
            if not joint.lower - 1e-9 <= position <= joint.upper + 1e-9:
                message = f"{_in_units(joint, position)} is outside the joint's limits, "
                message += _in_units(joint, joint.lower, joint.upper)
                self._report("outside-limits", (*path, joint.name), message)
        return {joint.name: positions[joint.name] for joint in joints if joint.name in positions}

    def _quantities(
        self, entries: Mapping[str, Quantity], known: Sequence[UrdfJoint], path_to: KeyPath, what: str
    ) -> dict[str, float]:
        joints = {joint.name: joint for joint in known}
        positions = {}
        for name, quantity in entries.items():
            path = (*path_to, name)
            if name not in joints:
                self._report("unknown-joint", path, f"found `{name}`, which is {what}; {expected_names(name, joints)}")
                continue
            dimension = units.LENGTH if joints[name].type == "prismatic" else units.ANGLE
            if quantity.dimension not in (None, dimension):
                self._wrong_unit(path, quantity, dimension)
            elif quantity.dimension is None and dimension is units.ANGLE and abs(quantity.value) > units.TURN:
                message = f"found {quantity.value:g}, which would be radians; expected {expected_quantity(dimension)}"
                self._report("wrong-unit", path, message)
            else:
                positions[name] = quantity.value
        return positions

    def _limits(self, joints: Sequence[UrdfJoint]) -> dict[str, robot.JointLimits]:
        limits = {
            limit: {**self._from_files(limit, joints), **self._values(limit, joints)}
            for limit in ("velocity", "acceleration", "jerk")
        }
        assumed = {limit: robot.LimitsEntry.kind(limit).assumed for limit in limits}
        self._warn_of_assumed_limits(joints, limits, assumed)
        return {
            joint.name: robot.JointLimits(
                lower=joint.lower,
                upper=joint.upper,
                **{limit: values.get(joint.name, assumed[limit]) for limit, values in limits.items()},
            )
            for joint in joints
        }

    def _from_files(self, limit: str, joints: Sequence[UrdfJoint]) -> dict[str, float]:
        """The values of one limit that URDF and MoveIt state, with MoveIt's scaling."""
        found = {joint.name: joint.velocity for joint in joints if joint.velocity} if limit == "velocity" else {}
        if self.moveit is None:
            return found
        names = tuple(joint.name for joint in joints)
        strange = self.moveit.unknown(names)
        if strange is not None and strange not in self.warnings:
            self.warnings.append(strange)
        stated = self.moveit.stated[limit]
        factor: float | None = getattr(self.entry.limits, f"{limit}_scaling", None)
        scale = self.moveit.scaling.get(limit, 1.0) if factor is None else factor
        return {name: scale * value for name, value in {**found, **stated}.items() if name in names}

    def _stop_limits(
        self, limits: Mapping[str, robot.JointLimits], joints: Sequence[UrdfJoint]
    ) -> dict[str, robot.StopLimits]:
        stops = {limit: self._values(f"stop_{limit}", joints) for limit in ("acceleration", "jerk")}
        for limit, values in stops.items():
            self._check_stop(limit, values, {name: getattr(usual, limit) for name, usual in limits.items()})
        return {
            name: robot.StopLimits(
                **{limit: values.get(name, getattr(usual, limit)) for limit, values in stops.items()}
            )
            for name, usual in limits.items()
        }

    def _check_stop(self, limit: str, values: Mapping[str, float], usual: Mapping[str, float]) -> None:
        """A stop gentler than the motion could end after the motion."""
        for name, value in values.items():
            if name in usual and value < usual[name]:
                message = f"{value:g} is less than the {usual[name]:g} of every motion of `{name}`"
                mend = f"leave it out to stop with the {limit} of every motion"
                self._report("outside-limits", ("robot", "limits", f"stop_{limit}"), message, mend)
                return

    def _warn_of_assumed_limits(
        self, joints: Sequence[UrdfJoint], limits: Mapping[str, Mapping[str, float]], assumed: Mapping[str, float]
    ) -> None:
        """One warning with the joints without a stated limit, and the assumed values."""
        assumptions = []
        for limit, values in limits.items():
            names = [joint.name for joint in joints if joint.name not in values]
            if names:
                owners = "all joints" if len(names) == len(joints) else ", ".join(names)
                assumptions.append(f"{limit} ({assumed[limit]:g} for {owners})")
        if assumptions:
            message = f"limits are not stated (or are 0) and assumed, in rad or m and s: {', '.join(assumptions)}"
            place = self.document.key_place(("robot", "limits"))
            mend = "state them under `robot.limits`; times depend on them"
            self.warnings.append(Problem("assumed-limit", message, place, severity="warning", mend=mend))

    def _values(self, limit: str, joints: Sequence[UrdfJoint]) -> dict[str, float]:
        """The stated values of one limit by joint. A single value applies to every joint that its unit fits."""
        entry: Quantity | Mapping[str, Quantity] | None = getattr(self.entry.limits, limit)
        path: KeyPath = ("robot", "limits", limit)
        dimensions = {joint.name: robot.LimitsEntry.kind(limit).of(joint) for joint in joints}
        if entry is None:
            return {}
        if isinstance(entry, Quantity):
            values = {name: entry for name, dimension in dimensions.items() if entry.dimension in (None, dimension)}
            if not values:
                self._wrong_unit(path, entry, *dict.fromkeys(dimensions.values()))
            paths = dict.fromkeys(values, path)
        else:
            values = dict(entry)
            paths = {name: (*path, name) for name in values}
        for name, quantity in values.items():
            if name not in dimensions:
                self._report("unknown-joint", paths[name], no_such(name, "movable joint", dimensions))
            elif quantity.dimension not in (None, dimensions[name]):
                self._wrong_unit(paths[name], quantity, dimensions[name])
        wrong = next((name for name, quantity in values.items() if quantity.value < SMALLEST_LIMIT), None)
        if wrong is not None:
            expected = f"expected a value above 0, at least {SMALLEST_LIMIT:g}"
            self._report("wrong-value", paths[wrong], f"found {values[wrong].value:g}, {expected}")
        return {name: quantity.value for name, quantity in values.items()}

    def _wrong_unit(self, path: KeyPath, quantity: Quantity, *dimensions: Dimension) -> None:
        found = quantity.dimension.name if quantity.dimension else f"{quantity.value:g}"
        self._report("wrong-unit", path, f"found {found}, expected {expected_quantity(*dimensions)}")


def _in_units(joint: UrdfJoint, *positions: float) -> str:
    """A position of a joint [rad or m], or a range, with its unit; for a turning joint in degrees as well."""
    stated = " to ".join(f"{position:.4g}" for position in positions)
    if joint.type == "prismatic":
        return f"{stated} m"
    return f"{stated} rad ({' to '.join(f'{math.degrees(position):.4g}' for position in positions)} deg)"
