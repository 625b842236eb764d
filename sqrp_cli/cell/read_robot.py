"""Reading entries of a workspace file, and the files that they name; the robot: URDF, SRDF, tool, home, limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from functools import partial
from pathlib import Path

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, first_names, no_such
from sqrp_cli.files import packages, units
from sqrp_cli.files.entries import XacroEntry
from sqrp_cli.files.frames import link_called
from sqrp_cli.files.input_file import SourceFile, source_file
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.units import SMALLEST_LIMIT, Dimension, Quantity, expected_quantity
from sqrp_cli.geometry import read_only
from sqrp_cli.records import dataclass
from sqrp_cli.robot import robot
from sqrp_cli.robot.kinematics import driving_joints
from sqrp_cli.robot.moveit import MoveitLimits, SrdfModel, read_moveit_limits, read_srdf, with_position_limits
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot_xml import RobotSource
from sqrp_cli.robot.urdf import TOOL_TIP, LinkGeometry, UrdfJoint, UrdfModel, tool_of_boxes, with_tip
from sqrp_cli.shapes import Mesh, Part

MAX_ARM_JOINTS = 20  # most joints that move the tool frame; each makes inverse kinematics and motion slower


@dataclass(kw_only=True)
class RobotReader:
    """Reads the `robot` entry of a workspace file, adds the files that it names to the digest, and collects problems.

    URDF and SRDF are read first: their InputError is raised at once, because nothing can be checked without them.
    """

    document: SourceDocument
    digest: dict[str, SourceFile]
    entry: robot.RobotEntry
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    _parts: list[Part] = field(default_factory=list)

    def __post_init__(self) -> None:
        entry, folder = self.entry, self.document.folder
        stated = [folder / root for root in entry.package_roots]
        self.roots = packages.package_roots(stated)  # folders for `package://`
        for index, root in enumerate(stated):
            if not root.is_dir():
                self.report("missing-folder", ("robot", "package_roots", index), f"there is no folder {root}")
        named, key = (entry.urdf, "urdf") if entry.urdf is not None else (entry.mjcf or "", "mjcf")
        self.urdf = self._read_urdf(named, ("robot", key))
        self.moveit: MoveitLimits | None = None
        if entry.limits.moveit is not None:
            file = self.resolve(entry.limits.moveit, ("robot", "limits", "moveit"))
            self.moveit = read_moveit_limits(file)
            self.digest["robot.limits.moveit"] = source_file(file, self.moveit.document.content)
            self.urdf = with_position_limits(self.urdf, self.moveit)
        self.srdf: SrdfModel | None = None
        if entry.srdf is not None:
            self.srdf_path, source = self.described(entry.srdf, ("robot", "srdf"))
            self.srdf = read_srdf(self.srdf_path, self.urdf, source)
            self.digest["robot.srdf"] = source_file(self.srdf_path, self.srdf.content)
            self.warnings += self.srdf.warnings
        self.tool: UrdfModel | None = None
        if entry.tool is not None:
            of_tool, place = entry.tool, self.document.key_place(("robot", "tool"))
            if of_tool.urdf is not None:
                self.tool = self._read_urdf(of_tool.urdf, ("robot", "tool", "urdf"), of_tool.prefix)
            else:
                boxes = [(box.size, box.pose.matrix()) for box in of_tool.boxes or ()]
                self.tool = tool_of_boxes(boxes, self.document.path.absolute(), place).prefixed(of_tool.prefix)
                self._parts += self.tool.parts(entry.geometry, partial(packages.resolve_mesh, self.roots))
            if of_tool.frame is not None:
                self.tool = with_tip(self.tool, of_tool.frame.matrix(), place)
        if entry.tool_frame is None and (entry.tool is None or entry.tool.frame is None):
            message = "`robot`: the key `tool_frame` is missing: the link that grasps"
            raise bad_input("missing-key", message, self.document.key_place(("robot",)))
        self.links = (*self.urdf.links, *(self.tool.links if self.tool else ()))  # of robot and tool
        tip_name = TOOL_TIP if entry.tool is None else entry.tool.prefix + TOOL_TIP
        self.tool_frame = link_called(entry.tool_frame or tip_name, self.links)

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Adds the problems of an InputError to those that were found; what could not be read is left out."""
        try:
            yield
        except InputError as error:
            self.problems.extend(error.problems)

    def report(self, code: str, path: KeyPath, message: str, mend: str | None = None) -> None:
        """Add the problem of the entry at a path, as `SourceDocument.problem`."""
        self.problems.append(self.document.problem(code, path, message, mend))

    def resolve(self, reference: str, path: KeyPath) -> Path:
        """The file that the entry at a path names, itself, or under `file` or `xacro`. Raises InputError for none."""
        named = next((at for key in ("file", "xacro") if (at := (*path, key)) in self.document.keys), path)
        return packages.resolve(reference, self.document.folder, self.roots, self.document.value_place(named))

    def described(self, entry: XacroEntry | str, path: KeyPath) -> tuple[Path, RobotSource]:
        """The file of a URDF or SRDF that the entry at `path` names, and what else it is made of."""
        file, arguments = (entry, {}) if isinstance(entry, str) else (entry.xacro, entry.args)
        return self.resolve(file, path), RobotSource((*self.roots, self.document.folder), arguments)

    def add_mesh(self, role: str, mesh: Mesh, place: Place) -> None:
        """Add a mesh file to the digest; place: where it is named. Raises as `read_mesh`."""
        try:
            self.digest[role] = source_file(mesh.path)  # first checks that this is a regular file
            read_mesh(mesh.path, mesh.scale)
        except InputError as error:
            named = [replace(one, message=f"{one.message}; {place} names this file") for one in error.problems]
            raise InputError(*named) from error

    def _read_urdf(self, entry: XacroEntry | str, path: KeyPath, prefix: str = "") -> UrdfModel:
        """A description with its meshes; those without triangles are left out of it, with a warning."""
        urdf, empty, count = read_urdf(*self.described(entry, path)).prefixed(prefix), set[LinkGeometry](), -1
        self.warnings += urdf.warnings
        self.digest[dotted(path)] = source_file(urdf.path, urdf.content)
        while count < len(empty):  # without its collision geometry, a link has its visual one
            count = len(empty)
            for name, link in urdf.links.items() if empty else ():
                solid, drawn = ([one for one in of if one not in empty] for of in (link.collision, link.visual))
                links = {**urdf.links, name: replace(link, collision=tuple(solid), visual=tuple(drawn))}
                urdf = replace(urdf, links=links)
            parts = urdf.parts(self.entry.geometry, partial(packages.resolve_mesh, self.roots))
            pieces = (piece for link in urdf.links.values() for piece in link.geometry(self.entry.geometry))
            for part, piece in zip(parts, pieces, strict=True):
                if isinstance(part.shape, Mesh):
                    try:
                        self.add_mesh(f"{dotted(path)}.{part.name}", part.shape, piece.place)
                    except InputError as error:
                        if error.problems[0].code != "mesh-empty":
                            raise
                        empty.add(piece)
                        message = f"a mesh without triangles is left out, of `{part.parent}`: {part.shape.path}"
                        self.warnings.append(Problem("no-size", message, piece.place, severity="warning"))
        self._parts += parts
        return urdf

    def read_robot(self) -> robot.Robot:
        """The robot; meaningful only if `problems` is empty afterwards."""
        entry, of_tool, tool = self.entry, self.entry.tool, None
        if of_tool is not None and self.tool is not None:
            link = link_called(of_tool.link, self.urdf.links)
            if link not in self.urdf.links:
                self.report("unknown-link", ("robot", "tool", "link"), no_such(link, "link", self.urdf.links))
            moving = [{joint.name for joint in model.movable_joints} for model in (self.urdf, self.tool)]
            shared = [f"link `{name}`" for name in self.tool.links if name in self.urdf.links]
            shared += [f"joint `{name}`" for name in sorted(moving[0] & moving[1])]
            if shared:
                others = f", and {len(shared) - 1} more names in common" if len(shared) > 1 else ""
                mend = "tell the tool's apart by a prefix: `prefix: tool_` in `robot.tool`"
                at = ("robot", "tool", "urdf" if of_tool.urdf else "boxes")
                self.report("ambiguous-name", at, f"robot and tool both have a {shared[0]}{others}", mend)
            file = None if of_tool.urdf is None else self.tool.path
            tool = robot.Tool(self.tool, link, read_only(of_tool.pose.matrix()), file)
        joints = [*self.urdf.movable_joints, *(self.tool.movable_joints if self.tool else ())]
        axes, home, fingers = self._arm_and_fingers(joints)
        limits, stop_limits = self._limits(joints)
        usual = robot.ANGLE_TOLERANCE if axes < robot.AXES_OF_A_POSE else 0.0
        markers, carriers = {}, dict[tuple[str, int], str]()
        for named, marker in entry.markers.items():
            path, link = ("robot", "markers", named), link_called(named, self.links)
            if link not in self.links:
                self.report("unknown-link", path, no_such(link, "link", self.links))
            other = carriers.setdefault((marker.dictionary, marker.id), link)
            if other != link:
                self.report("repeated-value", (*path, "id"), f"`{other}` has the marker {marker.id} too")
            markers[link] = marker
        return robot.Robot(
            urdf=self.urdf,
            srdf=self.srdf_path if self.srdf is not None else None,
            package_roots=self.roots,
            X_WB=read_only(entry.base.matrix()),
            tool=tool,
            tool_frame=self.tool_frame,
            home=home,
            limits=limits,
            stop_limits=stop_limits,
            angle_tolerance=usual if entry.angle_tolerance is None else entry.angle_tolerance,
            geometry=entry.geometry,
            parts=tuple(self._parts),
            disabled_pairs=self.srdf.disabled_pairs if self.srdf else frozenset(),
            fingers=fingers,
            markers=markers,
        )

    def _arm_and_fingers(self, joints: Sequence[UrdfJoint]) -> tuple[int, dict[str, float], robot.Fingers | None]:
        """How many joints the arm has, where each of them is at home, and the fingers; without those with problems."""
        # The arm's joints drive those from the root to the tool frame.
        frame, on_tool, arm = self.tool_frame, list[UrdfJoint](), list[UrdfJoint]()
        if frame not in self.links:
            self.report("unknown-link", ("robot", "tool_frame"), no_such(frame, "link", self.links))
        elif self.tool is not None and self.entry.tool is not None and frame not in self.urdf.links:
            on_tool, frame = self.tool.chain(frame), link_called(self.entry.tool.link, self.urdf.links)
        if frame in self.urdf.links:  # else that is reported
            arm = driving_joints((*self.urdf.chain(frame), *on_tool), joints)
            if not arm:
                message = f"no joint moves `{self.tool_frame}`; expected a link at the end of the arm"
                self.report("unmoved-tool-frame", ("robot", "tool_frame"), message)
            driven_by = self.entry.fingers.open if self.entry.fingers is not None else {}
            # A joint that only the fingers state is none of the arm.
            moving = next((one.name for one in arm if one.name in driven_by and one.name not in self.entry.home), None)
            if moving is not None:
                message = (
                    f"`{self.tool_frame}` is on a finger, which `{moving}` moves; expected what carries the fingers"
                )
                mend = "name the link that carries the fingers, or state in `robot.tool.frame` where they grasp"
                raise self.document.error("tool-frame-on-finger", ("robot", "tool_frame"), message, mend)
            if len(arm) > MAX_ARM_JOINTS:
                message = f"{len(arm)} joints move `{self.tool_frame}`, expected at most {MAX_ARM_JOINTS} in an arm"
                raise bad_input("too-many-joints", message, arm[MAX_ARM_JOINTS].place)
        what, home = "no joint that moves the tool frame", None
        if arm:
            home = self._positions(self.entry.home, arm, ("robot", "home"), what)
        if home is not None and (missing := [joint.name for joint in arm if joint.name not in home]):
            self.report("missing-joint", ("robot", "home"), f"lacks a position for {first_names(missing)}")
        entry, path, fingers = self.entry.fingers, ("robot", "fingers"), None
        if entry is not None:
            what = "no joint outside the arm that moves by itself"
            driven = [joint for joint in joints if joint.mimic is None and joint not in arm]
            opened = self._positions(entry.open, driven, (*path, "open"), what)
            closed = self._positions(entry.closed, driven, (*path, "closed"), what)
            if opened is not None and closed is not None:
                if not opened or opened.keys() != closed.keys():
                    names = first_names(sorted(opened.keys() ^ closed.keys())) or "any joint"
                    message = f"`open` and `closed` must name the same joints; only one of them has {names}"
                    self.report("missing-joint", path, message)
                if opened == closed:
                    message = "the fingers are where they are when open, so nothing moves"
                    self.report("wrong-value", (*path, "closed"), message)
                closed = {name: closed[name] for name in opened if name in closed}
                fingers = robot.Fingers(opened, closed, entry.width)
        return len(arm), home or {}, fingers

    def _positions(
        self, entry: Mapping[str, Quantity] | str, joints: Sequence[UrdfJoint], path: KeyPath, what: str
    ) -> dict[str, float] | None:
        """Positions within limits of the joints that an entry names, in their order; None if a name or unit is wrong.

        what: describes a joint that is not among them, in a message. Other joints of an SRDF state are left out.
        """
        known, positions = {joint.name: joint for joint in joints}, dict[str, float]()
        if isinstance(entry, str):
            states = self.srdf.states if self.srdf else {}
            if entry not in states:
                self.report("unknown-state", path, no_such(entry, "named state of an SRDF", states))
                return None
            positions = dict(states[entry])
        else:
            for name, quantity in entry.items():
                at = (*path, name)
                if name not in known:
                    message = f"found `{name}`, which is {what}; {expected_names(name, known)}"
                    self.report("unknown-joint", at, message)
                    continue
                dimension = units.LENGTH if known[name].type == "prismatic" else units.ANGLE
                if quantity.dimension not in (None, dimension):
                    self._wrong_unit(at, quantity, dimension)
                elif quantity.dimension is None and dimension is units.ANGLE and abs(quantity.value) > units.TURN:
                    found = f"found {quantity.value:g}, which would be radians"
                    self.report("wrong-unit", at, f"{found}; expected {expected_quantity(dimension)}")
                else:
                    positions[name] = quantity.value
            if len(positions) < len(entry):
                return None
        for joint in joints:
            position = positions.get(joint.name, joint.lower)
            if not joint.lower - 1e-9 <= position <= joint.upper + 1e-9:
                said = []
                for values in ((position,), (joint.lower, joint.upper)):
                    plain = " to ".join(f"{value:.4g}" for value in values)
                    degrees = " to ".join(f"{math.degrees(value):.4g}" for value in values)
                    said.append(f"{plain} m" if joint.type == "prismatic" else f"{plain} rad ({degrees} deg)")
                message = f"{said[0]} is outside the joint's limits, {said[1]}"
                self.report("outside-limits", (*path, joint.name), message)
        return {joint.name: positions[joint.name] for joint in joints if joint.name in positions}

    def _limits(
        self, joints: Sequence[UrdfJoint]
    ) -> tuple[dict[str, robot.JointLimits[float]], dict[str, robot.JointLimits[float]]]:
        """The limits of every joint: stated here, else by MoveIt, else by the URDF, else assumed, with a warning.

        And those while the robot stops to protect itself and others.
        """
        names, moveit = [joint.name for joint in joints], self.moveit
        strange = [] if moveit is None else [joint for joint in moveit.joints if joint not in names]
        if strange and moveit is not None:
            message = f"unknown joint {first_names(strange, 1)}; {expected_names(strange[0], names)}"
            message += "; their limits are left out"
            place = next(place for path, place in moveit.document.keys.items() if path[-1] == strange[0])
            mend = "check that the file is of this robot"
            self.warnings.append(Problem("unknown-joint", message, place, severity="warning", mend=mend))
        limits: dict[str, dict[str, float]] = {name: {} for name in names}
        stops, assumptions = dict[str, dict[str, float]](), list[str]()
        for limit, (_, _, assumed) in robot.LIMITS.items():
            found = {joint.name: joint.velocity for joint in joints if joint.velocity} if limit == "velocity" else {}
            if moveit is not None:
                factor: float | None = getattr(self.entry.limits, f"{limit}_scaling", None)
                scale = moveit.scaling.get(limit, 1.0) if factor is None else factor
                of_files = {**found, **moveit.stated[limit]}
                found = {name: scale * value for name, value in of_files.items() if name in names}
            found |= self._values(limit, joints)
            if lacking := [name for name in names if name not in found]:
                owners = "all joints" if len(lacking) == len(joints) else ", ".join(lacking)
                assumptions.append(f"{limit} ({assumed:g} for {owners})")
            for name in names:
                limits[name][limit] = found.get(name, assumed)
            if limit != "velocity":
                stops[limit] = stop = self._values(f"stop_{limit}", joints)
                gentle = next((name for name in stop if name in limits and stop[name] < limits[name][limit]), None)
                if gentle is not None:  # a stop gentler than the motion could end after the motion
                    usual = limits[gentle][limit]
                    message = f"{stop[gentle]:g} is less than the {usual:g} of every motion of `{gentle}`"
                    mend = f"leave it out to stop with the {limit} of every motion"
                    self.report("outside-limits", ("robot", "limits", f"stop_{limit}"), message, mend)
        if assumptions:
            message = f"limits are not stated (or are 0) and assumed, in rad or m and s: {', '.join(assumptions)}"
            mend = "state them under `robot.limits`; times depend on them"
            place = self.document.key_place(("robot", "limits"))
            self.warnings.append(Problem("assumed-limit", message, place, severity="warning", mend=mend))
        of = {one.name: robot.JointLimits(one.lower, one.upper, **limits[one.name]) for one in joints}
        stopping = {
            name: replace(usual, **{limit: values[name] for limit, values in stops.items() if name in values})
            for name, usual in of.items()
        }
        return of, stopping

    def _values(self, limit: str, joints: Sequence[UrdfJoint]) -> dict[str, float]:
        """The stated values of one limit by joint. A single value applies to every joint that its unit fits."""
        entry: Quantity | Mapping[str, Quantity] | None = getattr(self.entry.limits, limit)
        path: KeyPath = ("robot", "limits", limit)
        turning, sliding, _ = robot.LIMITS[limit.removeprefix("stop_")]
        dimensions = {joint.name: sliding if joint.type == "prismatic" else turning for joint in joints}
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
                self.report("unknown-joint", paths[name], no_such(name, "movable joint", dimensions))
            elif quantity.dimension not in (None, dimensions[name]):
                self._wrong_unit(paths[name], quantity, dimensions[name])
        wrong = next((name for name, quantity in values.items() if quantity.value < SMALLEST_LIMIT), None)
        if wrong is not None:
            expected = f"expected a value above 0, at least {SMALLEST_LIMIT:g}"
            self.report("wrong-value", paths[wrong], f"found {values[wrong].value:g}, {expected}")
        return {name: quantity.value for name, quantity in values.items()}

    def _wrong_unit(self, path: KeyPath, quantity: Quantity, *dimensions: Dimension) -> None:
        found = quantity.dimension.name if quantity.dimension else f"{quantity.value:g}"
        self.report("wrong-unit", path, f"found {found}, expected {expected_quantity(*dimensions)}")
