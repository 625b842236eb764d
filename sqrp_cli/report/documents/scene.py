"""`show` and `init`: a workspace as understood, and one just made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sqrp_cli.knowledge.camera.camera import DistortionModel
from sqrp_cli.knowledge.camera.detector import DetectorKind
from sqrp_cli.knowledge.robot.robot import Fingers, Marker
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.programming.grounding import on_robot
from sqrp_cli.report.documents.document import LEFT_OUT, Document, Pose, Record
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere

if TYPE_CHECKING:
    from sqrp_cli.knowledge.camera import camera, detector
    from sqrp_cli.knowledge.robot import robot
    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.programming.cell import Cell


@dataclass(frozen=True, kw_only=True)
class JointScene(Record):
    """What a joint can do [rad or m, s]; no limit is null."""

    lower: float | None
    upper: float | None
    velocity: float
    acceleration: float
    jerk: float

    @classmethod
    def of(cls, limits: robot.JointLimits) -> JointScene:
        """The limits of a joint."""
        return completed(cls, limits, lower=_finite(limits.lower), upper=_finite(limits.upper))


@dataclass(frozen=True, kw_only=True)
class ToolScene(Record):
    """A tool with a description of its own."""

    urdf: str | None
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
    """Resolved path."""
    srdf: str | None
    package_roots: list[str]
    base: Pose
    """Of the root link in the world."""
    tool: ToolScene | None
    tool_frame: str
    joints: Mapping[str, JointScene]
    home: Mapping[str, float]
    """Position of every movable joint [rad or m]."""
    fingers: Fingers | None
    held: str | None
    """The object that the tool holds at the start."""
    markers: Mapping[str, Marker]
    """By link."""
    geometry: Literal["collision", "visual"]
    """The geometry of the links that is opaque."""
    unchecked_pairs: list[list[str]]
    """Pairs of links that are not checked for contact, besides neighbours."""

    @classmethod
    def of(cls, cell: Cell) -> RobotScene:
        """The robot of a cell."""
        own, model = cell.workspace.robot, cell.model
        return cls(
            urdf=str(own.urdf.path),
            srdf=None if own.srdf is None else str(own.srdf),
            package_roots=[str(root) for root in own.package_roots],
            base=own.X_WB.tolist(),
            tool=None if own.tool is None else ToolScene.of(own.tool),
            tool_frame=own.tool_frame,
            joints={name: JointScene.of(limits) for name, limits in own.limits.items()},
            home=model.joint_values(model.home),
            fingers=own.fingers,
            held=cell.initial_world.held,
            markers=own.markers,
            geometry=own.geometry,
            unchecked_pairs=sorted(map(list, cell.unchecked_pairs)),
        )


@dataclass(frozen=True, kw_only=True)
class CameraScene(Record):
    """A calibrated camera. Pixel (0, 0) is the centre of the first pixel."""

    width: int
    height: int
    K: list[list[float]]
    distortion_model: DistortionModel
    D: list[float]
    frame: str
    pose: Pose
    """Of the optical frame (x right, y down, z forward) in `frame`."""
    near: float
    far: float | None
    rate: float
    latency: float

    @classmethod
    def of(cls, cell: Cell, seen_by: camera.Camera) -> CameraScene:
        """A camera of a cell."""
        frame, X_FC = on_robot(cell.workspace.robot, cell.model, seen_by.frame, seen_by.X_FC)
        straight = seen_by.distortion_model == "none"
        return completed(
            cls,
            seen_by,
            K=seen_by.matrix.tolist(),
            # ROS has no name for the absence of distortion; it writes five zeros.
            distortion_model="plumb_bob" if straight else seen_by.distortion_model,
            D=[0.0] * 5 if straight else seen_by.distortion.tolist(),
            frame=frame,
            pose=X_FC.tolist(),
            far=_finite(seen_by.far),
        )


@dataclass(frozen=True, kw_only=True)
class DetectorScene(Record):
    """The limits of a detection algorithm."""

    kind: DetectorKind
    distance: tuple[float, ...]
    """Nearest and farthest [m]."""
    max_incidence: float
    min_pixels: float
    min_visible: float

    @classmethod
    def of(cls, found: detector.Detector) -> DetectorScene:
        """The limits of a detector."""
        return completed(cls, found)


@dataclass(frozen=True, kw_only=True)
class ObjectScene(Record):
    """An object."""

    type: str
    color: str | None
    size: list[float]
    """Full extents of the box that encloses it [m]."""
    pose: Pose | None
    """Of that box's centre in the world; null if unknown."""
    fixed: bool


@dataclass(frozen=True, kw_only=True)
class OpaquePart(Record):
    """A solid part that is neither in the URDF nor the box of an object."""

    name: str
    parent: str
    """The link, object or `world` that carries it."""
    shape: Literal["box", "sphere", "cylinder", "capsule"] | None = field(default=None, metadata=LEFT_OUT)
    size: list[float] | float | None = field(default=None, metadata=LEFT_OUT)
    """Box: full extents; sphere: radius; cylinder and capsule: radius and length of the straight part along z [m]."""
    mesh: str | None = field(default=None, metadata=LEFT_OUT)
    """Absolute path."""
    scale: list[float] | None = field(default=None, metadata=LEFT_OUT)
    pose: Pose

    @classmethod
    def of(cls, cell: Cell, part: Part) -> OpaquePart:
        """A part of a cell."""
        parent, X_PG = on_robot(cell.workspace.robot, cell.model, part.parent, part.X_PG)
        return cls(name=part.name, parent=parent, **_shape(part.shape), pose=X_PG.tolist())


@dataclass(frozen=True, kw_only=True)
class ShowDocument(Document):
    """What `sqrp show` prints."""

    workspace: str
    digest: str
    """Of all files that the workspace was read from."""
    robot: RobotScene
    cameras: Mapping[str, CameraScene]
    detectors: Mapping[str, DetectorScene]
    objects: Mapping[str, ObjectScene]
    opaque: list[OpaquePart]
    state: list[str]
    skills: list[str]
    tasks: list[str]

    @classmethod
    def of(cls, cell: Cell) -> ShowDocument:
        """What was understood of a cell."""
        workspace = cell.workspace
        return cls(
            workspace=workspace.name,
            digest=workspace.digest,
            robot=RobotScene.of(cell),
            cameras={name: CameraScene.of(cell, one) for name, one in workspace.cameras.items()},
            detectors={name: DetectorScene.of(one) for name, one in workspace.detectors.items()},
            objects=_objects(workspace, cell),
            opaque=[OpaquePart.of(cell, part) for part in _opaque_parts(cell)],
            state=sorted(map(str, workspace.state)),
            skills=list(workspace.skills),
            tasks=[expected.task for expected in workspace.tasks],
        )


@dataclass(frozen=True, kw_only=True)
class InitDocument(Document):
    """What `sqrp init` has made."""

    workspace: str
    """Its folder."""
    tool_link: str
    """The link of the robot that carries the tool, or grasps itself."""
    objects: list[str]
    task: str | None
    """A task that can be ranked at once."""


def _objects(workspace: Workspace, cell: Cell) -> dict[str, ObjectScene]:
    X_WO = cell.initial_world.X_WO
    return {
        name: ObjectScene(
            type=one.type,
            color=one.color,
            size=list(one.size),
            pose=X_WO[name].tolist() if name in X_WO else None,
            fixed=one.fixed,
        )
        for name, one in workspace.objects.items()
    }


def _opaque_parts(cell: Cell) -> list[Part]:
    tool = [part for part in cell.model.parts if part.parent in cell.model.tool_links]
    shaped = [one for one in cell.workspace.objects.values() if not _is_plain_box(one.parts, one.size)]
    return [*tool, *(part for one in shaped for part in one.parts)]


def _is_plain_box(parts: Sequence[Part], size: tuple[float, float, float]) -> bool:
    return len(parts) == 1 and parts[0].shape == Box(size) and np.array_equal(parts[0].X_PG, np.eye(4))


def _shape(shape: Shape) -> dict[str, Any]:
    match shape:
        case Mesh(path, scale):
            return {"mesh": str(path), "scale": list(scale)}
        case Box(size):
            return {"shape": "box", "size": list(size)}
        case Sphere(radius):
            return {"shape": "sphere", "size": radius}
        case Cylinder() | Capsule():
            return {"shape": type(shape).__name__.lower(), "size": [shape.radius, shape.length]}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
