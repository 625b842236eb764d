"""Parts of the cell as coal geometry, for collision and for sight.

The one place that turns shapes into coal's classes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import BOX_SIGNS, Array, read_only, transform
from sqrp_cli.knowledge.text.bounds import LARGEST_LENGTH
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere

SIDES = 48
"""Sides of the prisms that stand for round shapes where triangles are needed.

They enclose the shape (0.2 % too wide).
"""

BOX_TRIANGLES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
"""Triangles of a box over its corners in the order of `geometry.BOX_SIGNS`, outward, shape (12, 3)."""

BOX_TRIANGLES.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Solid:
    """A part as coal geometry and as triangles.

    name: what output calls it; the pieces of a link have one name.
    geometry: coal's collision geometry, in the shape's frame; place it with X_WP @ part.X_PG.
    vertices: shape (V, 3) [m], in the parent's frame; triangles: shape (F, 3), indices into `vertices`.
    center, radius: a sphere around it, in the parent's frame [m].
    corners, half_axes: the corners of a box around it, shape (8, 3), and the vectors from its centre to three of its
    faces, one a row, shape (3, 3), in the parent's frame [m].
    """

    part: Part
    name: str
    geometry: Any
    vertices: Array
    triangles: NDArray[np.int64]
    center: Array
    radius: float
    corners: Array
    half_axes: Array

    @cached_property
    def box(self) -> Array:
        """Half axes and centre of the box around it as the columns of a matrix, homogeneous, shape (4, 4)."""
        columns = np.eye(4)
        columns[:3, :3], columns[:3, 3] = self.half_axes.T, self.center
        return read_only(columns)


def load_solid(part: Part, name: str | None = None) -> Solid:
    """Make the solid of a part, with the part's name or another one; meshes are read once per file and scale.

    Raises InputError for a mesh that cannot be read, is empty or reaches too far. Files have passed `check_mesh`.
    """
    try:
        geometry, shape_vertices, triangles = _load_shape(part.shape)
    except InputError as error:
        raise InputError(
            *(
                replace(problem, message=f"{problem.message}; it is the mesh of `{part.name}`")
                for problem in error.problems
            )
        ) from error
    vertices = transform(part.X_PG, shape_vertices)
    low, high = shape_vertices.min(axis=0), shape_vertices.max(axis=0)
    corners = transform(part.X_PG, (low + high) / 2 + BOX_SIGNS * (high - low) / 2)
    center = corners.mean(axis=0)
    return Solid(
        part=part,
        name=part.name if name is None else name,
        geometry=geometry,
        vertices=read_only(vertices),
        triangles=triangles,
        center=read_only(center),
        radius=float(np.linalg.norm(vertices - center, axis=1).max()),
        corners=read_only(corners),
        half_axes=read_only((corners[[4, 2, 1]] - corners[0]) / 2),
    )


def load_solids(parts: Sequence[Part]) -> tuple[Solid, ...]:
    """The solids of several parts, in order."""
    return tuple(load_solid(part) for part in parts)


@cache
def _load_shape(shape: Shape) -> tuple[Any, Array, NDArray[np.int64]]:
    """Geometry of coal, vertices and triangles of a shape in its own frame."""
    match shape:
        case Box(size):
            return coal.Box(*size), 0.5 * np.asarray(size) * BOX_SIGNS, BOX_TRIANGLES
        case Sphere(radius):
            return coal.Sphere(radius), *_surface_of_revolution(radius, np.linspace(0, np.pi, SIDES // 2 + 1), 0.0)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length), *_prism(radius, length)
        case Capsule(radius, length):
            angles = np.linspace(0, np.pi, SIDES // 2 + 2)
            return coal.Capsule(radius, length), *_surface_of_revolution(radius, angles, length)
        case Mesh(path, scale):
            return _load_mesh(path, scale)


def _load_mesh(path: Path, scale: tuple[float, float, float]) -> tuple[Any, Array, NDArray[np.int64]]:
    try:
        # As bytes, since not every name of a file is text.
        geometry = coal.MeshLoader(coal.BV_OBBRSS).load(os.fsencode(path), np.array(scale))
    except (RuntimeError, ValueError) as error:
        message = f"this mesh cannot be loaded: {_because(str(error))}"
        raise InputError(Problem("mesh-unreadable", message, Place(path))) from error
    count = geometry.num_tris
    if count == 0:
        raise InputError(Problem("mesh-empty", "this mesh has no triangles", Place(path)))
    vertices = np.array(geometry.vertices())
    if not (np.abs(vertices) <= LARGEST_LENGTH).all():
        message = f"this mesh reaches further than {LARGEST_LENGTH:g} m from its origin, or has vertices without place"
        raise InputError(Problem("mesh-too-large", message, Place(path), mend="check its `scale`"))
    triangles = np.array([[t[0], t[1], t[2]] for t in map(geometry.tri_indices, range(count))], dtype=np.int64)
    return geometry, vertices, triangles


def _because(said: str) -> str:
    """What coal says without its places in code, hints, and the path again."""
    said = said.partition("Could not load resource")[2].partition("\nHint")[0].partition("\n")[2] or said
    return "no triangle of it has an area" if said.startswith("No meshes remaining") else " ".join(said.split())


def _prism(radius: float, length: float) -> tuple[Array, NDArray[np.int64]]:
    """A prism around a cylinder about z."""
    rim, up = _rim(radius / np.cos(np.pi / SIDES)), np.array([0.0, 0.0, length / 2])
    vertices = np.concatenate([rim - up, rim + up, [-up, up]])
    low = np.arange(SIDES)
    following = (low + 1) % SIDES
    high, bottom, top = low + SIDES, np.full(SIDES, 2 * SIDES), np.full(SIDES, 2 * SIDES + 1)
    walls = [np.column_stack([low, following, high]), np.column_stack([following, following + SIDES, high])]
    caps = [np.column_stack([bottom, following, low]), np.column_stack([top, high, following + SIDES])]
    return vertices, np.concatenate(walls + caps)


def _surface_of_revolution(radius: float, angles: Array, straight: float) -> tuple[Array, NDArray[np.int64]]:
    """A sphere around z, cut at its equator and pulled apart by `straight`, as rings at polar angles from the top."""
    outer = radius / np.cos(np.pi / SIDES)
    heights = outer * np.cos(angles) + np.copysign(straight / 2, np.cos(angles))
    rings = [_rim(outer * np.sin(angle), height) for angle, height in zip(angles, heights, strict=True)]
    first = np.arange(SIDES)
    following = (first + 1) % SIDES
    triangles = []
    for ring in range(len(rings) - 1):
        upper, lower = ring * SIDES, (ring + 1) * SIDES
        triangles.append(np.column_stack([upper + first, lower + first, lower + following]))
        triangles.append(np.column_stack([upper + first, lower + following, upper + following]))
    return np.concatenate(rings), np.concatenate(triangles)


def _rim(radius: float, height: float = 0.0) -> Array:
    """The corners of a regular polygon of `SIDES` sides about z, shape (SIDES, 3)."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(SIDES, height)])
