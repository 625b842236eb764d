"""Rays through the pixels of a camera, lens distortion included, and what they hit first.

The only module that knows Embree, which needs neither a display nor a graphics card.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.projection import ImagePoints, Projection
from sqrp_cli.shapes import Triangles

_LIFT = 1e-4
"""How far above a surface a ray to the light starts [m], so that the surface does not shade itself."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What n rays hit first: index of the mesh, -1 for none, (n,); distance [m], (n,); unit normal, (n, 3)."""

    mesh: NDArray[np.int64]
    distance: Array
    normal: Array


class RayScene:
    """Triangle meshes that rays are cast at."""

    def __init__(self, meshes: Sequence[Triangles]) -> None:
        """Raises InputError where Embree is missing."""
        embree = check_rays()
        self._scene = embree.rtcore_scene.EmbreeScene()
        for mesh in meshes:
            vertices, faces = mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)
            embree.mesh_construction.TriangleMesh(self._scene, vertices, faces)

    def first_hits(self, origin: Array, directions: Array) -> Hits:
        """What rays from `origin`, (3,), along unit vectors, (n, 3), hit first; normals look towards the origin."""
        origins = np.broadcast_to(origin, directions.shape).astype(np.float32)
        found = self._scene.run(origins, directions.astype(np.float32), output=True)
        normal = found["Ng"].astype(float)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        away = np.einsum("ni,ni->n", normal, directions) > 0
        normal[away] *= -1
        return Hits(found["geomID"].astype(np.int64), found["tfar"].astype(float), normal)

    def blocked(self, points: Array, normals: Array, direction: Array) -> NDArray[np.bool_]:
        """Whether anything lies beyond points, (n, 3), along one unit vector, (3,): (n,)."""
        origins = (points + _LIFT * normals).astype(np.float32)
        directions = np.broadcast_to(direction, points.shape).astype(np.float32)
        blocked: NDArray[np.bool_] = self._scene.run(origins, directions, query="OCCLUDED") >= 0
        return blocked


class Embree(NamedTuple):
    """The modules of Embree."""

    mesh_construction: ModuleType
    rtcore_scene: ModuleType


def check_rays() -> Embree:
    """Embree's modules. Raises InputError, with the command that installs it, where it is missing."""
    try:
        from embreex import mesh_construction, rtcore_scene
    except ImportError as error:
        message = "pictures need the Python package `embreex`, which is not installed"
        raise InputError(Problem("missing-extra", message, mend="pip install embreex")) from error
    return Embree(mesh_construction, rtcore_scene)


CLOSE = 1e-2
"""Greatest distance of a projected direction from its pixel [pixels]."""

_ITERATIONS = 25
_STEP = 1e-5


class SeenDirections(NamedTuple):
    """Where pixels look."""

    rays: Array
    """Unit vectors in the optical frame, shape (n, 3)."""
    shown: NDArray[np.bool_]
    """Whether the lens shows any direction there, shape (n,)."""


def directions(projection: Projection, pixels: Array) -> SeenDirections:
    """The directions that are seen at pixels of shape (n, 2).

    Found by Newton's method from the point without distortion.
    """
    K = projection.camera.matrix
    plane = (pixels - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T
    if projection.camera.distortion_model == "none":
        return SeenDirections(_unit(plane), np.ones(len(plane), dtype=bool))
    length = np.linalg.norm(plane, axis=1, keepdims=True)
    plane = plane * np.minimum(1.0, 0.98 * projection.radius / np.maximum(length, 1e-12))
    for _ in range(_ITERATIONS):
        error = _seen_at(projection, plane)[0] - pixels
        slopes = [(_seen_at(projection, plane + step)[0] - pixels - error) / _STEP for step in np.eye(2) * _STEP]
        (a, c), (b, d) = (slope.T for slope in slopes)
        determinant = a * d - b * c
        safe = np.where(np.abs(determinant) > 1e-9, determinant, np.inf)
        change = np.column_stack([d * error[:, 0] - b * error[:, 1], a * error[:, 1] - c * error[:, 0]]) / safe[:, None]
        plane = plane - change
        length = np.linalg.norm(plane, axis=1, keepdims=True)
        plane = plane * np.minimum(1.0, 0.9999 * projection.radius / np.maximum(length, 1e-12))
        if float(np.abs(change).max(initial=0.0)) < _STEP:
            break
    found, inside = _seen_at(projection, plane)
    return SeenDirections(_unit(plane), inside & (np.abs(found - pixels).max(axis=1, initial=0.0) < CLOSE))


def _seen_at(projection: Projection, plane: Array) -> ImagePoints:
    return projection.pixels(np.column_stack([plane, np.ones(len(plane))]))


def _unit(plane: Array) -> Array:
    points = np.column_stack([plane, np.ones(len(plane))])
    unit: Array = points / np.linalg.norm(points, axis=1, keepdims=True)
    return unit
