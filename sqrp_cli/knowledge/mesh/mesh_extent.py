"""How far meshes and other shapes reach, for objects whose size nobody states."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.text.bounds import SMALLEST_SIZE
from sqrp_cli.shapes import Mesh, Part, Shape


class ExtentOfParts(NamedTuple):
    """The lowest and highest coordinates of something along three axes [m], shape (3,) each."""

    low: Array
    high: Array


def bounds_of(parts: Iterable[Part]) -> ExtentOfParts:
    """The lowest and highest coordinates of parts along the axes of what carries them.

    Files of meshes have passed `check_mesh`. Raises InputError for a mesh that cannot be loaded.
    """
    ends = np.array([_ends(part.shape, part.X_PG) for part in parts])
    low, high = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    thin = np.maximum(SMALLEST_SIZE - (high - low), 0.0)
    return ExtentOfParts(low - thin / 2, high + thin / 2)


def _ends(shape: Shape, X_PG: Array) -> tuple[Array, Array]:
    if isinstance(shape, Mesh):
        corners = transform(X_PG, _vertices(shape))
        return corners.min(axis=0), corners.max(axis=0)
    half = shape.half_extents(X_PG[:3, :3])
    return X_PG[:3, 3] - half, X_PG[:3, 3] + half


def _vertices(mesh: Mesh) -> Array:
    """The corners of its triangles, shape (V, 3) [m]."""
    import coal

    try:
        loaded = coal.MeshLoader(coal.BV_AABB).load(os.fsencode(mesh.path), np.array(mesh.scale))
        vertices: Array = np.array(loaded.vertices()).reshape(-1, 3)
    except (RuntimeError, ValueError) as error:
        raise InputError(Problem("mesh-unreadable", "this mesh cannot be loaded", Place(mesh.path))) from error
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        raise InputError(Problem("mesh-unreadable", "this mesh has vertices without place", Place(mesh.path)))
    return vertices
