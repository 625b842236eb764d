"""Surfaces of solid parts, from which silhouettes in images are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.mesh import read_mesh
from sqrp_cli.shapes import Mesh, Part

_SIDES = 24
"""Corners of the polygons that stand for circles in outlines.

They are inscribed, and half as many as those that sight is computed with: outlines are drawn anew for every image, and
that of a part 4 cm wide and 0.5 m away is within a quarter of a pixel for a focal length of 600 pixels.
"""

_MANY, _DETAIL = 20_000, 64
"""Triangles above which a mesh is coarsened, and cells along its longest side in which vertices then become one."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a solid part of a link or an object."""

    parent: str
    """The link or object."""
    vertices: Array
    """In the frame of the parent [m], shape (V, 3)."""
    triangles: NDArray[np.int64] | None
    """Indices into the vertices, shape (F, 3); None for a convex part, whose outline is the hull of its vertices."""

    @classmethod
    def of(cls, part: Part) -> Surface:
        """The surface of a part. Raises InputError for a mesh file that cannot be used."""
        if isinstance(part.shape, Mesh):
            mesh = read_mesh(part.shape.path, part.shape.scale)
            return cls(part.parent, transform(part.X_PG, mesh.vertices), mesh.faces)
        corners = part.shape.triangles(_SIDES, enclosing=False).vertices
        return cls(part.parent, transform(part.X_PG, corners), None)

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
