"""Cameras inside something solid: `knowledge.lint_scene` finds those in objects without meshes, before any model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sqrp_cli.errors import Problem
from sqrp_cli.geometry import inverse, transform
from sqrp_cli.knowledge.frames import WORLD, frame_poses
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.sensing.solids import Solid
from sqrp_cli.shapes import Mesh


def cameras_inside(workspace: Workspace, model: RobotModel, solids: Sequence[Solid]) -> Iterator[Problem]:
    """Cameras that are inside a link or an object before anything moves, so that it hides everything from them.

    The link that carries a camera hides as much as any other, if the camera is truly inside its shape.
    """
    X_WL = {link: poses[0] for link, poses in model.link_poses(model.home[None]).items()}
    X_WO = {thing.name: thing.X_WO for thing in workspace.objects.values() if thing.X_WO is not None}
    X_WF = frame_poses(X_WL, X_WO, {})
    for camera in workspace.cameras.values():
        eye = (X_WF[camera.frame] @ camera.X_FC)[:3, 3]
        for solid in solids:
            parent = solid.part.parent
            told = camera.frame == WORLD and parent in workspace.objects and not isinstance(solid.part.shape, Mesh)
            if told or parent not in X_WF or not solid.contains(transform(inverse(X_WF[parent]), eye[None])[0]):
                continue
            code, what = ("camera-inside-robot", "link ") if parent in model.links else ("camera-inside-object", "")
            message = f"camera `{camera.name}` is inside {what}`{parent}` at the start, which hides everything from it"
            mend = "correct the camera's pose"
            if parent == camera.frame:
                mend += f", whose origin is that of `{parent}`; its lens must be outside of the link's shape"
            place = workspace.places.get(f"cameras.{camera.name}")
            yield Problem(code, message, place, severity="warning", mend=mend)
            break
