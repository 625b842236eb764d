"""What was understood of a workspace, as a JSON document."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.cli.documents import Document, header
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.knowledge.scene import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.grounding import on_robot


def scene_document(cell: Cell) -> Document:
    """The resolved scene: what was understood of a workspace."""
    workspace, robot, model = cell.workspace, cell.workspace.robot, cell.model
    X_WO = cell.initial_world.X_WO
    return {
        **header(workspace),
        "digest": workspace.digest,
        "robot": {
            "urdf": str(robot.urdf),
            "srdf": None if robot.srdf is None else str(robot.srdf),
            "package_roots": [str(root) for root in robot.package_roots],
            "base": robot.X_WB.tolist(),
            "tool": None
            if robot.tool is None
            else {
                "urdf": None if robot.tool.urdf is None else str(robot.tool.urdf),
                "link": robot.tool.link,
                "pose": robot.tool.X_LT.tolist(),
            },
            "tool_frame": robot.tool_frame,
            "joints": {
                name: {
                    "lower": _finite(limits.lower),
                    "upper": _finite(limits.upper),
                    "velocity": limits.velocity,
                    "acceleration": limits.acceleration,
                    "jerk": limits.jerk,
                }
                for name, limits in robot.limits.items()
            },
            "home": model.joint_values(model.home),
            "fingers": None
            if robot.fingers is None
            else {"open": dict(robot.fingers.open), "closed": dict(robot.fingers.closed)},
            "held": cell.initial_world.held,
            "markers": {link: {"id": marker.id, "side": marker.side} for link, marker in robot.markers.items()},
            "geometry": robot.geometry,
            "unchecked_pairs": sorted(map(list, cell.unchecked_pairs)),
        },
        "cameras": {name: _camera(cell, camera) for name, camera in workspace.cameras.items()},
        "detectors": {name: _detector(detector) for name, detector in workspace.detectors.items()},
        "objects": {
            name: {
                "type": thing.type,
                "color": thing.color,
                "size": list(thing.size),
                "pose": X_WO[name].tolist() if name in X_WO else None,
                "fixed": thing.fixed,
            }
            for name, thing in workspace.objects.items()
        },
        "opaque": [_part(cell, part) for part in _opaque_parts(cell)],
        "state": sorted(map(str, workspace.state)),
        "skills": list(workspace.skills),
        "tasks": [expected.task for expected in workspace.tasks],
    }


def _opaque_parts(cell: Cell) -> list[Part]:
    """The solid parts that neither the robot's URDF nor a plain box of an object's size tells."""
    tool = [part for part in cell.model.parts if part.parent in cell.model.tool_links]
    shaped = [thing for thing in cell.workspace.objects.values() if not _is_plain_box(thing.parts, thing.size)]
    return [*tool, *(part for thing in shaped for part in thing.parts)]


def _is_plain_box(parts: Sequence[Part], size: tuple[float, float, float]) -> bool:
    return len(parts) == 1 and parts[0].shape == Box(size) and np.array_equal(parts[0].X_PG, np.eye(4))


def _part(cell: Cell, part: Part) -> Document:
    parent, X_PG = on_robot(cell.workspace.robot, cell.model, part.parent, part.X_PG)
    return {"name": part.name, "parent": parent, **_shape(part.shape), "pose": X_PG.tolist()}


def _shape(shape: Shape) -> Document:
    match shape:
        case Box(size):
            return {"shape": "box", "size": list(size)}
        case Sphere(radius):
            return {"shape": "sphere", "size": radius}
        case Cylinder(radius, length):
            return {"shape": "cylinder", "size": [radius, length]}
        case Capsule(radius, length):
            return {"shape": "capsule", "size": [radius, length]}
        case Mesh(path, scale):
            return {"mesh": str(path), "scale": list(scale)}


def _camera(cell: Cell, camera: Camera) -> Document:
    frame, X_FC = on_robot(cell.workspace.robot, cell.model, camera.frame, camera.X_FC)
    return {
        "width": camera.width,
        "height": camera.height,
        "K": camera.matrix.tolist(),
        # ROS has no name for the absence of distortion; it writes five zeros.
        "distortion_model": "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model,
        "D": [0.0] * 5 if camera.distortion_model == "none" else camera.distortion.tolist(),
        "frame": frame,
        "pose": X_FC.tolist(),
        "near": camera.near,
        "far": _finite(camera.far),
        "rate": camera.rate,
        "latency": camera.latency,
    }


def _detector(detector: Detector) -> Document:
    return {
        "kind": detector.kind,
        "distance": list(detector.distance),
        "max_incidence": detector.max_incidence,
        "min_pixels": detector.min_pixels,
        "min_visible": detector.min_visible,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
