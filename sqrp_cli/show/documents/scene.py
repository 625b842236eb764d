"""`show`: a workspace as understood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any, Literal

import numpy as np

from sqrp_cli.camera.camera import Camera, DistortionModel
from sqrp_cli.camera.detector import PERIMETER_RATE, Curve, DetectorKind, marker_range
from sqrp_cli.cell.mesh import mesh_unit
from sqrp_cli.document import LEFT_OUT, Pose, Record, WorkspaceDocument, how_many
from sqrp_cli.files.entries import from_fields
from sqrp_cli.geometry import finite_or_none
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import RobotTraits
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from sqrp_cli.show.documents.explanation import CameraTiming
from sqrp_cli.task.grounding import on_robot


@dataclass(frozen=True, kw_only=True)
class JointScene(Record):
    """What a joint can do [rad or m, s]; no limit is null."""

    lower: float | None
    """Least position [rad or m]."""
    upper: float | None
    """Greatest position [rad or m]."""
    velocity: float
    """Greatest speed [rad/s or m/s]."""
    acceleration: float
    """Greatest acceleration [rad/s^2 or m/s^2]."""
    jerk: float
    """Greatest jerk [rad/s^3 or m/s^3]."""
    slides: bool = field(default=False, metadata=LEFT_OUT)
    """True of a joint that slides; left out where it turns."""


@dataclass(frozen=True, kw_only=True)
class ToolScene(Record):
    """A tool with a description of its own."""

    urdf: str | None
    """Resolved path of its URDF; null for a tool of boxes."""
    link: str
    """The link of the robot that carries it."""
    pose: Pose
    """Of the tool's root in that link."""


@dataclass(frozen=True, kw_only=True)
class RobotScene(RobotTraits, Record):
    """The robot; `home` is of every movable joint."""

    urdf: str
    """Resolved path; of the xacro file if it is one."""
    expanded: str | None
    """The URDF that the xacro stands for; null for a plain URDF."""
    srdf: str | None
    """Resolved path; null if there is none."""
    package_roots: list[str]
    """Folders in which `package://NAME/` is looked up, first hit wins."""
    base: Pose
    """Of the root link in the world."""
    tool: ToolScene | None
    """Null if the tool is part of the robot's URDF, or there is none."""
    arm: list[str]
    """The joints of the arm, from the root to the tool frame."""
    joints: Mapping[str, JointScene]
    """Limits of every movable joint, by its name."""
    held: str | None
    """The object that the tool holds at the start."""
    unchecked_pairs: list[list[str]]
    """Pairs of links that are not checked for contact, besides neighbours."""
    contact: str
    """How many pairs of parts are checked for contact, and which are not, in words."""


@dataclass(frozen=True, kw_only=True)
class CameraScene(CameraTiming):
    """A calibrated camera. Pixel (0, 0) is the centre of the first pixel."""

    width: int
    """Columns of the image [pixels]."""
    height: int
    """Rows of the image [pixels]."""
    K: list[list[float]]
    """Intrinsic matrix [pixels], 3 rows of 3."""
    distortion_model: DistortionModel
    """As ROS calls it; `plumb_bob` with zeros where the lens does not distort."""
    D: list[float]
    """Distortion coefficients in the order of ROS: k1, k2, p1, p2, k3, ..."""
    frame: str
    """`world`, or the link that carries the camera."""
    pose: Pose
    """Of the optical frame (x right, y down, z forward) in `frame`."""
    near: float
    """Nearest depth at which it sees [m]."""
    far: float | None
    """Farthest depth at which it sees [m]; null if there is none."""
    exposure: float | None = field(default=None, metadata=LEFT_OUT)
    """How long the shutter is open [s]; left out where nothing is said."""
    gain: float | None = field(default=None, metadata=LEFT_OUT)
    """Brightness of its images; left out where nothing is said, as 1."""
    lens_file: str | None = field(default=None, metadata=LEFT_OUT)
    """Format of the calibration file, and the camera's name in it; left out if the workspace states the image."""
    pose_file: str | None = field(default=None, metadata=LEFT_OUT)
    """Format of the file with the pose; left out if the workspace states it."""


@dataclass(frozen=True, kw_only=True)
class DetectorScene(Record):
    """The limits of a detection algorithm."""

    kind: DetectorKind
    """What it detects: `aruco` (markers), `color`, or a kind that an installed package brings."""
    distance: tuple[float, ...]
    """Nearest and farthest [m]."""
    max_incidence: float
    """Largest angle between a box's normal and the direction to the camera [rad]."""
    min_pixels: float
    """Least size of a box in the image: square root of its area [pixels]."""
    min_visible: float
    """Least share of a box that must be seen, in 0..1."""
    curve: Curve | None = field(default=None, metadata=LEFT_OUT)
    """How likely it sees a box, by how a camera sees it."""
    ranges: Mapping[str, Mapping[str, tuple[float, ...]]] | None = field(default=None, metadata=LEFT_OUT)
    """Of `aruco`: nearest and farthest distance at which each camera reads each marker that faces it, by the names of
    cameras and of what carries the markers [m]; left out in a cell without markers."""


@dataclass(frozen=True, kw_only=True)
class ObjectScene(Record):
    """An object."""

    type: str
    """Its type in the skills, or any other noun, such as `cube`."""
    color: str | None
    """What a task calls it, and what detectors of colours look for; null if it has none."""
    size: list[float]
    """Full extents of the box that encloses it [m]."""
    pose: Pose | None
    """Of that box's centre in the world; null if unknown."""
    fixed: bool
    """Whether it never moves."""
    attributes: list[str] = field(default_factory=list, metadata=LEFT_OUT)
    """Further words that a task may use for it; left out where there are none."""
    on: str | None = field(default=None, metadata=LEFT_OUT)
    """The object that it stands on; left out where nothing is said."""


@dataclass(frozen=True, kw_only=True)
class LightScene(Record):
    """A light; from everywhere, if it has neither a direction nor a position."""

    intensity: float
    """How bright it makes a white surface that faces it, of a lamp at 1 m; 1 saturates at gain 1."""
    direction: list[float] | None = field(default=None, metadata=LEFT_OUT)
    """Unit vector in the world in which it shines, or in the middle of a lamp's beam."""
    position: list[float] | None = field(default=None, metadata=LEFT_OUT)
    """Of a lamp in the world [m]."""
    beam: float | None = field(default=None, metadata=LEFT_OUT)
    """Opening angle of a lamp's beam [rad]."""


@dataclass(frozen=True, kw_only=True)
class OpaquePart(Record):
    """A solid part that is neither in the URDF nor the box of an object."""

    name: str
    """What output calls it."""
    parent: str
    """The link, object or `world` that carries it."""
    shape: Literal["box", "sphere", "cylinder", "capsule"] | None = field(default=None, metadata=LEFT_OUT)
    """Kind of shape; left out for a mesh."""
    size: list[float] | float | None = field(default=None, metadata=LEFT_OUT)
    """Box: full extents; sphere: radius; cylinder and capsule: radius and length of the straight part along z [m]."""
    mesh: str | None = field(default=None, metadata=LEFT_OUT)
    """Absolute path of its file; left out for other shapes."""
    scale: list[float] | None = field(default=None, metadata=LEFT_OUT)
    """Of a mesh along x, y and z, from the file's numbers to metres."""
    pose: Pose
    """Of the shape in `parent`."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ShowDocument(WorkspaceDocument):
    """What `sqrp show` prints."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_scene"

    document: Literal["show"] = "show"
    digest: str
    """Of what was understood of the workspace: the same whatever its comments, layout and folder."""
    robot: RobotScene
    """The robot with its tool."""
    cameras: Mapping[str, CameraScene]
    """By name."""
    detectors: Mapping[str, DetectorScene]
    """By name."""
    objects: Mapping[str, ObjectScene]
    """By name."""
    lights: Mapping[str, LightScene] | None = field(default=None, metadata=LEFT_OUT)
    """By name; left out where there are none."""
    opaque: list[OpaquePart]
    """Of tools, and of objects that are not just boxes."""
    state: list[str]
    """Literals that hold at the start."""
    recorded: list[str] | None = field(default=None, metadata=LEFT_OUT)
    """Objects whose place each episode of a recording tells; left out where there are none."""
    derived: Mapping[str, str] | None = field(default=None, metadata=LEFT_OUT)
    """Those of them that follow from the cell, each with from what; left out where none does."""
    skills: list[str]
    """Names of the skills that tasks can use."""
    tasks: list[str]
    """The tasks that `sqrp score` ranks, as the workspace has them."""

    @classmethod
    def of(cls, cell: Cell) -> ShowDocument:
        """What was understood of a cell."""
        workspace, X_WO = cell.workspace, cell.initial_world.X_WO
        detectors = {}
        for name, one in workspace.detectors.items():
            rates, markers = one.perimeter_rate or PERIMETER_RATE, workspace.markers if one.kind == "aruco" else {}
            ranges = {
                eye: {marked: marker_range(camera, marker, 0.0, rates) for marked, marker in markers.items()}
                for eye, camera in workspace.cameras.items()
            }
            detectors[name] = from_fields(DetectorScene, one, ranges=ranges if any(ranges.values()) else None)
        objects = {}
        for name, item in workspace.objects.items():
            pose = X_WO[name].tolist() if name in X_WO else None
            lists = {"size": list(item.size), "attributes": list(item.attributes)}
            objects[name] = from_fields(ObjectScene, item, pose=pose, **lists)
        lights = {}
        for name, light in workspace.lights.items():
            lamp = {} if light.position is None else {"position": [*light.position], "beam": 2.0 * light.half_beam}
            heading = None if light.is_ambient else light.heading.tolist()
            lights[name] = from_fields(LightScene, light, direction=heading, **lamp)
        return cls(
            workspace=workspace.name,
            digest=workspace.digest,
            robot=_robot(cell),
            cameras={name: _camera(cell, one) for name, one in workspace.cameras.items()},
            detectors=detectors,
            objects=objects,
            lights=lights or None,
            opaque=_opaque_parts(cell),
            state=sorted(map(str, workspace.state)),
            recorded=[one for own in workspace.recordings.values() for one in own.objects if one not in X_WO] or None,
            derived={str(atom): why for atom, why in sorted(workspace.derived.items())} or None,
            skills=list(workspace.skills),
            tasks=[expected.task for expected in workspace.tasks],
        )

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.workspace}: {how_many(self.cameras, 'camera')}, {how_many(self.objects, 'object')}"


def _robot(cell: Cell) -> RobotScene:
    from sqrp_cli.motion.collision import SAMPLES

    own, model = cell.workspace.robot, cell.model
    tool = None
    if own.tool is not None:
        urdf = None if own.tool.file is None else str(own.tool.file)
        tool = ToolScene(urdf=urdf, link=own.tool.link, pose=own.tool.X_LT.tolist())
    contact = f"{len(cell.collision.self_pairs)} pairs of parts are checked for contact"
    if cell.never_touching is None:
        named = "the SRDF" if own.srdf is None else own.srdf.name
        contact += f"; {named} leaves out {len(own.disabled_pairs)} pairs of links."
    else:
        names = ", ".join(f"{a}-{b}" for a, b in sorted(cell.unchecked_pairs)) or "none"
        contact += (
            f". There is no SRDF: left out are neighbours, and links that touch at home or always: {names}. "
            f"{len(cell.never_touching)} pairs of links touched at none of {SAMPLES} positions tried, and are checked "
            "all the same."
        )
    turns, joints = dict(zip((one.name for one in model.tree.joints), model.tree.turns.tolist(), strict=True)), {}
    for name, one in own.limits.items():
        ends = {"lower": finite_or_none(one.lower), "upper": finite_or_none(one.upper)}
        joints[name] = from_fields(JointScene, one, **ends, slides=not turns[name])
    return from_fields(
        RobotScene,
        own,
        urdf=str(own.urdf.path),
        expanded=own.urdf.expanded,
        srdf=None if own.srdf is None else str(own.srdf),
        package_roots=[str(root) for root in own.package_roots],
        base=own.X_WB.tolist(),
        tool=tool,
        joints=joints,
        arm=list(model.arm),
        home=model.joint_values(model.home),
        held=cell.initial_world.held,
        unchecked_pairs=sorted(map(list, cell.unchecked_pairs)),
        contact=contact,
    )


def _camera(cell: Cell, one: Camera) -> CameraScene:
    frame, X_FC = on_robot(cell.workspace.robot, cell.model, one.frame, one.X_FC)
    lens = {"K": one.matrix.tolist(), "distortion_model": one.distortion_model, "D": one.distortion.tolist()}
    if one.distortion_model == "none":  # ROS has no name for the absence of distortion; it writes five zeros
        lens |= {"distortion_model": "plumb_bob", "D": [0.0] * 5}
    limits = {"far": finite_or_none(one.far), "exposure": one.exposure or None}
    return from_fields(CameraScene, one, CameraTiming.of(one), **lens, **limits, frame=frame, pose=X_FC.tolist())


def _opaque_parts(cell: Cell) -> list[OpaquePart]:
    """The parts of the tool, and those of objects that are not just their boxes."""
    parts = [part for part in cell.model.parts if part.parent in cell.model.tool_links]
    for one in cell.workspace.objects.values():
        own = one.parts
        if not (len(own) == 1 and own[0].shape == Box(one.size) and np.array_equal(own[0].X_PG, np.eye(4))):
            parts += own
    found = []
    for part in parts:
        parent, X_PG = on_robot(cell.workspace.robot, cell.model, part.parent, part.X_PG)
        shown: dict[str, Any] = {"shape": type(part.shape).__name__.lower()}
        match part.shape:
            case Mesh(path, scale):
                shown = {"mesh": str(path), "scale": [mesh_unit(path) * along for along in scale]}
            case Box(size):
                shown["size"] = list(size)
            case Sphere(radius):
                shown["size"] = radius
            case Cylinder(radius, length) | Capsule(radius, length):
                shown["size"] = [radius, length]
        found.append(OpaquePart(name=part.name, parent=parent, **shown, pose=X_PG.tolist()))
    return found
