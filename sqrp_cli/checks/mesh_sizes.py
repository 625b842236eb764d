"""Meshes whose size is off by about a thousand: millimetres taken for metres, or the other way round."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sqrp_cli.errors import Place, Problem
from sqrp_cli.knowledge.mesh.mesh_unit import mesh_unit
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.sensing.solids import Solid, load_solid
from sqrp_cli.shapes import Mesh

LARGEST, SMALLEST = 20.0, 1e-3
"""Sizes of a link's mesh, as shares of the robot's length, from which its scale is doubted."""

OBJECT_FACTOR = 50.0
"""Ratio of the sizes of an object and its mesh from which the mesh's scale is doubted."""


def doubtful_meshes(workspace: Workspace, model: RobotModel) -> Iterator[Problem]:
    """Warnings about meshes of the robot, measured against its length, and of objects, against their `size`."""
    origins = np.concatenate([model.joint_origins(model.home), model.tool_pose(model.home)[None, :3, 3]])
    length = float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())
    for part in model.parts:
        if isinstance(part.shape, Mesh):
            size = load_solid(part).diagonal
            if size > LARGEST * length or size < SMALLEST * length:
                told = f"the mesh of link `{part.parent}` measures {_metres(size)}, the arm {_metres(length)}"
                yield _doubt(told, Place(part.shape.path), part.shape, size > length, "the <mesh> of the URDF")
    for thing in workspace.objects.values():
        for index, part in enumerate(thing.parts):
            if isinstance(part.shape, Mesh):
                solid = load_solid(part)
                if scale_is_doubtful(solid, thing):
                    size, stated = solid.diagonal, float(np.linalg.norm(thing.size))
                    place = workspace.places.get(f"objects.{thing.name}.parts.{index}.mesh")
                    told = f"the mesh of `{thing.name}` measures {_metres(size)}, its `size` {_metres(stated)}"
                    yield _doubt(told, place, part.shape, size > stated, "this part")


def scale_is_doubtful(solid: Solid, thing: SceneObject) -> bool:
    """Whether the size of an object's mesh is so far from the object's `size` that the unit must be another one."""
    ratio = solid.diagonal / float(np.linalg.norm(thing.size))
    return not 1 / OBJECT_FACTOR <= ratio <= OBJECT_FACTOR


def _doubt(told: str, place: Place | None, mesh: Mesh, too_large: bool, where: str) -> Problem:
    factor, unit = "0.001" if too_large else "1000", mesh_unit(mesh.path)
    if unit == 1.0:
        mend = f"if its unit is not the metre, give {where} a `scale` of {factor}"
    else:
        mend = f"it counts already that the file gives its unit as {unit:g} m: see the `scale` of {where}"
    return Problem("doubtful-mesh-size", f"{told}; its scale may be off by 1000", place, severity="warning", mend=mend)


def _metres(size: float) -> str:
    return f"{size:.3g} m" if size >= 0.01 else f"{1e3 * size:.2g} mm"
