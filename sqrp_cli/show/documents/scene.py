"""`show` and `init`: a workspace as understood, and one just made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from importlib import import_module
from typing import Any, Literal

import numpy as np

from sqrp_cli.camera import camera, detector
from sqrp_cli.camera.camera import DistortionModel
from sqrp_cli.camera.detector import Curve, DetectorKind, marker_ranges
from sqrp_cli.camera.light import Light
from sqrp_cli.cell.mesh import mesh_unit
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.document import LEFT_OUT, Document, Pose, Record, WorkspaceDocument, how_many, live
from sqrp_cli.errors import Problem
from sqrp_cli.files.entries import from_fields
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.robot import robot
from sqrp_cli.robot.robot import Fingers, Marker
from sqrp_cli.run.record.report import Outcome
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere
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

    @classmethod
    def of(cls, limits: robot.JointLimits) -> JointScene:
        """The limits of a joint."""
        return from_fields(cls, limits, lower=_finite(limits.lower), upper=_finite(limits.upper))


@dataclass(frozen=True, kw_only=True)
class ToolScene(Record):
    """A tool with a description of its own."""

    urdf: str | None
    """Resolved path of its URDF; null for a tool of boxes."""
    link: str
    """The link of the robot that carries it."""
    pose: Pose
    """Of the tool's root in that link."""

    @classmethod
    def of(cls, tool: robot.Tool) -> ToolScene:
        """The tool of a robot."""
        return cls(urdf=None if tool.file is None else str(tool.file), link=tool.link, pose=tool.X_LT.tolist())


@dataclass(frozen=True, kw_only=True)
class RobotScene(Record):
    """The robot."""

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
    tool_frame: str
    """The link of robot or tool that grasps; its z axis points out of the tool."""
    joints: Mapping[str, JointScene]
    """Limits of every movable joint, by its name."""
    home: Mapping[str, float]
    """Position of every movable joint [rad or m]."""
    fingers: Fingers | None
    """Of the gripper; null if it has none that move."""
    held: str | None
    """The object that the tool holds at the start."""
    markers: Mapping[str, Marker]
    """By link."""
    angle_tolerance: float
    """By how much the tool may be turned away from a pose, of an arm with fewer than six axes [rad]; else 0."""
    geometry: Literal["collision", "visual"]
    """The geometry of the links that is opaque."""
    unchecked_pairs: list[list[str]]
    """Pairs of links that are not checked for contact, besides neighbours."""

    @classmethod
    def of(cls, cell: Cell) -> RobotScene:
        """The robot of a cell."""
        own, model = cell.workspace.robot, cell.model
        return from_fields(
            cls,
            own,
            urdf=str(own.urdf.path),
            expanded=own.urdf.expanded,
            srdf=None if own.srdf is None else str(own.srdf),
            package_roots=[str(root) for root in own.package_roots],
            base=own.X_WB.tolist(),
            tool=None if own.tool is None else ToolScene.of(own.tool),
            joints={name: JointScene.of(limits) for name, limits in own.limits.items()},
            home=model.joint_values(model.home),
            held=cell.initial_world.held,
            unchecked_pairs=sorted(map(list, cell.unchecked_pairs)),
        )


@dataclass(frozen=True, kw_only=True)
class CameraScene(Record):
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
    rate: float
    """Images per second [Hz]."""
    latency: float
    """From exposure to the image being available [s]."""
    exposure: float | None = field(default=None, metadata=LEFT_OUT)
    """How long the shutter is open [s]; left out where nothing is said."""
    gain: float | None = field(default=None, metadata=LEFT_OUT)
    """Brightness of its images; left out where nothing is said, as 1."""
    lens_file: str | None = field(default=None, metadata=LEFT_OUT)
    """Format of the calibration file, and the camera's name in it; left out if the workspace states the image."""
    pose_file: str | None = field(default=None, metadata=LEFT_OUT)
    """Format of the file with the pose; left out if the workspace states it."""

    @classmethod
    def of(cls, cell: Cell, seen_by: camera.Camera) -> CameraScene:
        """A camera of a cell."""
        frame, X_FC = on_robot(cell.workspace.robot, cell.model, seen_by.frame, seen_by.X_FC)
        straight = seen_by.distortion_model == "none"
        return from_fields(
            cls,
            seen_by,
            K=seen_by.matrix.tolist(),
            # ROS has no name for the absence of distortion; it writes five zeros.
            distortion_model="plumb_bob" if straight else seen_by.distortion_model,
            D=[0.0] * 5 if straight else seen_by.distortion.tolist(),
            frame=frame,
            pose=X_FC.tolist(),
            far=_finite(seen_by.far),
            latency=seen_by.lag,
            exposure=seen_by.exposure or None,
        )


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

    @classmethod
    def of(cls, found: detector.Detector, workspace: Workspace) -> DetectorScene:
        """The limits of a detector."""
        ranges = marker_ranges(workspace.cameras, workspace.markers) if found.kind == "aruco" else {}
        return from_fields(cls, found, ranges=ranges if any(ranges.values()) else None)


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

    @classmethod
    def of(cls, light: Light) -> LightScene:
        """A light of a cell."""
        lamp = light.position is not None
        return cls(
            intensity=light.intensity,
            direction=None if light.is_ambient else light.heading.tolist(),
            position=list(light.position) if light.position is not None else None,
            beam=2.0 * light.half_beam if lamp else None,
        )


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

    @classmethod
    def of(cls, cell: Cell, part: Part) -> OpaquePart:
        """A part of a cell."""
        parent, X_PG = on_robot(cell.workspace.robot, cell.model, part.parent, part.X_PG)
        return cls(name=part.name, parent=parent, **_shape(part.shape), pose=X_PG.tolist())


@dataclass(frozen=True, kw_only=True, repr=False)
class ShowDocument(WorkspaceDocument):
    """What `sqrp show` prints."""

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
    skills: list[str]
    """Names of the skills that tasks can use."""
    tasks: list[str]
    """The tasks that `sqrp score` ranks, as the workspace has them."""

    cell: Any = live()
    """The `Cell`, of which the table shows more than the document has."""

    @classmethod
    def of(cls, cell: Cell) -> ShowDocument:
        """What was understood of a cell."""
        workspace = cell.workspace
        return cls(
            cell=cell,
            workspace=workspace.name,
            digest=workspace.digest,
            robot=RobotScene.of(cell),
            cameras={name: CameraScene.of(cell, one) for name, one in workspace.cameras.items()},
            detectors={name: DetectorScene.of(one, workspace) for name, one in workspace.detectors.items()},
            objects=_objects(workspace, cell),
            lights={name: LightScene.of(one) for name, one in workspace.lights.items()} or None,
            opaque=[OpaquePart.of(cell, part) for part in _opaque_parts(cell)],
            state=sorted(map(str, workspace.state)),
            skills=list(workspace.skills),
            tasks=[expected.task for expected in workspace.tasks],
        )

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.workspace}: {how_many(self.cameras, 'camera')}, {how_many(self.objects, 'object')}"

    def show(self, **how: bool) -> None:
        """Print it, while its cell is known."""
        import_module("sqrp_cli.show.terminal.cell_tables").print_scene(self.cell, **how)


@dataclass(frozen=True, kw_only=True)
class FirstRun(Record):
    """How the best candidate of a new workspace ran in the simulated cell, once."""

    outcome: Outcome
    """Whether all was done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    reason: str | None
    """Why it stopped, or what was not noticed; null if it is done."""
    time: float
    """Simulated [s]."""
    promised: int
    """Images of a camera that were predicted to show a literal."""
    seen: int
    """Those of them that did."""


@dataclass(frozen=True, kw_only=True, repr=False)
class NewCell(Document):
    """What `sqrp init` has made: a new workspace."""

    VIEW = "sqrp_cli.show.terminal.cell_tables:print_new_cell"

    document: Literal["init"] = "init"
    workspace: str
    """Its folder."""
    tool_link: str
    """The link of the robot that carries the tool, or grasps itself."""
    objects: list[str]
    """Names of the cubes that stand on the table."""
    task: str | None
    """A task that can be ranked at once."""
    run: FirstRun | None
    """Of its best candidate; null if it was not run, as without a simulator."""
    path: str
    """Of its folder, as it was given."""
    own_arm: bool
    """Whether the arm is the user's, so that some values were guessed."""

    problems: Sequence[Problem] = live(())
    """Warnings about the arm."""

    @property
    def works(self) -> bool:
        """Whether there is a task to rank and, if it was run, it was done."""
        return self.task is not None and (self.run is None or self.run.outcome == "done")

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.path}: {self.task or 'nothing within reach'}"


def _objects(workspace: Workspace, cell: Cell) -> dict[str, ObjectScene]:
    X_WO = cell.initial_world.X_WO
    return {
        name: from_fields(ObjectScene, one, size=list(one.size), pose=X_WO[name].tolist() if name in X_WO else None)
        for name, one in workspace.objects.items()
    }


def _opaque_parts(cell: Cell) -> list[Part]:
    tool = [part for part in cell.model.parts if part.parent in cell.model.tool_links]
    shaped = [
        one
        for one in cell.workspace.objects.values()
        if not (
            len(one.parts) == 1 and one.parts[0].shape == Box(one.size) and np.array_equal(one.parts[0].X_PG, np.eye(4))
        )
    ]
    return [*tool, *(part for one in shaped for part in one.parts)]


def _shape(shape: Shape) -> dict[str, Any]:
    match shape:
        case Mesh(path, scale):
            return {"mesh": str(path), "scale": [mesh_unit(path) * along for along in scale]}
        case Box(size):
            return {"shape": "box", "size": list(size)}
        case Sphere(radius):
            return {"shape": "sphere", "size": radius}
        case Cylinder() | Capsule():
            return {"shape": type(shape).__name__.lower(), "size": [shape.radius, shape.length]}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
