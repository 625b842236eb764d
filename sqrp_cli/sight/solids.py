"""Parts of the cell as triangles, and as solids of the kernel, for collision and for sight."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.errors import InputError
from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, read_only, transform
from sqrp_cli.kernel import kernel
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere, Triangles, contains, surface

SIDES = 48
"""Sides of the prisms that replace round shapes where sight needs triangles.

They enclose cylinders (0.2 % too wide); the faces of spheres and capsules are within 0.2 % of them.
"""

OBJECT_FACTOR = 50.0  # Ratio of the sizes of an object and its mesh from which the mesh's scale is doubted
_CLOSED = 1e-3  # Tolerance of the winding number of a closed surface around a point
_made: WeakValueDictionary[object, kernel.Solid] = WeakValueDictionary()  # Solids of the kernel still in use
_latest = deque[kernel.Solid](maxlen=500)  # Those that were made last: a cell that is read again needs them again


@dataclass(frozen=True, eq=False)
class Solid:
    """A part as triangles, in the frame of its parent."""

    part: Part
    name: str  # Its name in output; the pieces of a link share one name
    vertices: Array  # Corners of its triangles [m], shape (V, 3)
    triangles: NDArray[np.int64]  # Indices into `vertices`, shape (F, 3)
    center: Array  # Centre of a sphere around it [m], shape (3,)
    radius: float  # Radius of that sphere [m]
    corners: Array  # Corners of a box around it [m], shape (8, 3)
    half_axes: Array  # Vectors from the box's centre to three of its faces, one a row [m], shape (3, 3)
    color: str | None = None
    """The colour of the object that it is of, empty if that has none; None if it is of the robot."""
    movable: bool = False  # Whether it is of an object that may be moved: neither of the robot nor of what is fixed

    @cached_property
    def compiled(self) -> kernel.Solid:
        """The solid as the kernel holds it; made once for all that are alike, whoever loaded them."""
        match self.part.shape:
            case Box((x, y, z)):
                form, half = kernel.Form.BOX, (x / 2, y / 2, z / 2)
            case Sphere(radius):
                form, half = kernel.Form.SPHERE, (radius, 0.0, 0.0)
            case Cylinder(radius, length):
                form, half = kernel.Form.CYLINDER, (radius, 0.0, length / 2)
            case Capsule(radius, length):
                form, half = kernel.Form.CAPSULE, (radius, 0.0, length / 2)
            case Mesh():
                form, half = kernel.Form.MESH, (0.0, 0.0, 0.0)
        surface = hashlib.blake2b(self.vertices.tobytes() + self.triangles.tobytes()).digest()
        key = form, half, self.part.X_PG.tobytes(), surface
        if (made := _made.get(key)) is None:
            made = kernel.Solid(self.vertices, self.triangles, form, self.part.X_PG, half, (*self.center, self.radius))
            _made[key] = made
            _latest.append(made)
        return made

    @property
    def diagonal(self) -> float:
        """Diagonal of the box around it along the axes of the parent's frame [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def contains(self, point: Array) -> bool:
        """Whether a point in the parent's frame (3,) is inside it; never of a mesh that is not closed."""
        if np.linalg.norm(point - self.center) > self.radius:
            return False
        if not isinstance(self.part.shape, Mesh):
            return contains(self.part.shape, transform(inverse(self.part.X_PG), point[None])[0])
        turns = Triangles(self.vertices, self.triangles).turns_around(point)
        return abs(turns) > 0.5 and abs(turns - round(turns)) < _CLOSED


def load_solid(part: Part, name: str | None = None) -> Solid:
    """Make the solid of a part, with the part's name or another one; meshes are read once per file and scale.

    Raises as `read_mesh`, with the name of the part.
    """
    try:
        surface = _load_shape(part.shape)
    except InputError as error:
        whose = f"; it is the mesh of `{part.name}`"
        raise InputError(*(replace(one, message=one.message + whose) for one in error.problems)) from error
    vertices = transform(part.X_PG, surface.vertices)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    corners = transform(part.X_PG, (low + high) / 2 + BOX_SIGNS * (high - low) / 2)
    center = corners.mean(axis=0)
    return Solid(
        part=part,
        name=part.name if name is None else name,
        vertices=read_only(vertices),
        triangles=surface.faces,
        center=read_only(center),
        radius=float(np.linalg.norm(vertices - center, axis=1).max()),
        corners=read_only(corners),
        half_axes=read_only((corners[[4, 2, 1]] - corners[0]) / 2),
    )


def load_solids(parts: Sequence[Part]) -> tuple[Solid, ...]:
    """The solids of several parts, in order."""
    return tuple(load_solid(part) for part in parts)


def scale_doubt(solid: Solid, item: SceneObject) -> str:
    """Why a mesh of an object must be in another unit than said: the sizes of both; empty if it need not be."""
    size, stated = solid.diagonal, float(np.linalg.norm(item.size))
    if not isinstance(solid.part.shape, Mesh) or 1 / OBJECT_FACTOR <= size / stated <= OBJECT_FACTOR:
        return ""
    return f"the mesh of `{item.name}` measures {size:.3g} m, its `size` {stated:.3g} m"


def distance(first: Solid, X_WA: Array, second: Solid, X_WB: Array, within: float, enough: float = 0.0) -> float | None:
    """Distance [m] of two solids if it is at most `within`, otherwise None; 0 where they meet.

    X_WA, X_WB: poses of their parents, shape (4, 4). enough: a distance of at most this may be that of other points
    than the nearest ones, which saves time. A mesh is its surface: nothing touches it inside.
    """
    return first.compiled.distance(second.compiled, inverse(X_WA) @ X_WB, within, enough)


@cache
def _load_shape(shape: Shape) -> Triangles:
    """The triangles of a shape, in its own frame."""
    if isinstance(shape, Mesh):
        return read_mesh(shape.path, shape.scale)
    return surface(shape, SIDES, enclosing=True)
