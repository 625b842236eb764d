"""Surfaces of solid parts: what the simulation draws of mesh files, and what silhouettes in images are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.mesh.mesh_file import check_mesh
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.shapes import Mesh, Part, Triangles

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
            mesh = load_triangles(part.shape)
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


@cache
def load_triangles(mesh: Mesh) -> Triangles:
    """The triangles of a mesh file, scaled. Raises InputError if it cannot be read or has none.

    It is handed on as an open file, from which no other file can be reached: textures and materials are of no use here.
    """
    _check(mesh.path)
    with interrupts_later():
        import trimesh

    try:
        with mesh.path.open("rb") as file:
            kind = mesh.path.suffix.lower().removeprefix(".")
            options = {"skip_materials": True} if kind == "obj" else {}
            loaded = trimesh.load_mesh(file, file_type=kind, **options)
        triangles = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
        vertices, faces = np.asarray(triangles.vertices, dtype=float), np.asarray(triangles.faces, dtype=np.int64)
    except Exception as error:  # each format's reader fails in ways of its own
        message = f"this mesh cannot be read: {error or type(error).__name__}"
        raise bad_input("mesh-unreadable", message, Place(mesh.path)) from error
    if len(faces) == 0:
        raise bad_input("mesh-empty", "this mesh has no triangles", Place(mesh.path))
    if np.prod(mesh.scale) < 0.0:
        faces = faces[:, ::-1]
    return Triangles(vertices * mesh.scale, faces)


def _check(path: Path) -> None:
    """What a robot is drawn with is looked at here first: a workspace is read without it."""
    try:
        check_mesh(path)
    except OSError as error:
        raise bad_input("unreadable-file", f"cannot be read: {error.strerror}", Place(path)) from error
