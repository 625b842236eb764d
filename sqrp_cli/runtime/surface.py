"""The surface of a solid part: what its silhouette in an image is drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere

_SIDES = 24
"""Corners of the polygons that stand for circles in outlines."""

_MANY, _DETAIL = 20_000, 64
"""Triangles above which a mesh is coarsened, and cells along its longest side in which vertices then become one."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a solid part of a link or an object.

    vertices: in the frame of its parent, the link or object [m], shape (V, 3). triangles: indices into them, shape
    (F, 3); None for a convex part, whose outline is the hull of its vertices.
    """

    parent: str
    vertices: Array
    triangles: NDArray[np.int64] | None

    @classmethod
    def of(cls, part: Part) -> Surface:
        """The surface of a part. Raises InputError for a mesh file that cannot be used."""
        vertices, triangles = _mesh(part.shape)
        return cls(part.parent, transform(part.X_PG, vertices), triangles)

    def coarsened(self) -> Surface:
        """The same with at most some ten thousand triangles, so that its silhouette is quickly drawn in every image.

        Vertices of a finer mesh that are close to each other become one: it moves by up to 1 / `_DETAIL` of its size.
        """
        if self.triangles is None or len(self.triangles) <= _MANY:
            return self
        cell = np.ptp(self.vertices, axis=0).max() / _DETAIL
        cells = np.floor(self.vertices / cell).astype(np.int64)
        _, first, merged = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        a, b, c = np.unique(np.sort(merged.reshape(-1)[self.triangles], axis=1), axis=0).T
        whole, count = (a != b) & (b != c), len(first)
        sides = [one[whole] * count + other[whole] for one, other in ((a, b), (b, c), (a, c))]
        # What has become a line is part of a triangle, except on a wire that is thinner than a cell.
        line = ~whole & (a != c) & ~np.isin(a * count + c, np.concatenate(sides))
        triangles = np.column_stack([a, b, c])[whole | line]
        return Surface(self.parent, self.vertices[first], triangles)


def _mesh(shape: Shape) -> tuple[Array, NDArray[np.int64] | None]:
    match shape:
        case Mesh():
            from sqrp_cli.runtime.meshes import load_triangles

            mesh = load_triangles(shape)
            return mesh.vertices, mesh.faces
        case Box(size):
            return box_corners(size), None
        case Cylinder(radius, length):
            return np.concatenate([_rim(radius, -length / 2), _rim(radius, length / 2)]), None
        case Sphere(radius):
            return _ball(radius, 0.0), None
        case Capsule(radius, length):
            return _ball(radius, length), None


def _rim(radius: float, height: float) -> Array:
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(_SIDES, height)])


def _ball(radius: float, straight: float) -> Array:
    angles = np.linspace(0.0, np.pi, _SIDES // 2 + 1)
    heights = radius * np.cos(angles) + np.copysign(straight / 2, np.cos(angles))
    return np.concatenate([_rim(radius * np.sin(a), h) for a, h in zip(angles, heights, strict=True)])
