"""Triangles of mesh files, by trimesh (DAE through pycollada)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.mesh.mesh_file import check_mesh
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.shapes import Mesh


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle mesh: vertices [m], shape (V, 3), and indices into them, shape (F, 3)."""

    vertices: Array
    faces: NDArray[np.int64]


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
        raise InputError(Problem("mesh-unreadable", message, Place(mesh.path))) from error
    if len(faces) == 0:
        raise InputError(Problem("mesh-empty", "this mesh has no triangles", Place(mesh.path)))
    if np.prod(mesh.scale) < 0.0:
        faces = faces[:, ::-1]
    return Triangles(vertices * mesh.scale, faces)


def _check(path: Path) -> None:
    """What a robot is drawn with is looked at here first: a workspace is read without it."""
    try:
        check_mesh(path)
    except OSError as error:
        raise InputError(Problem("unreadable-file", f"cannot be read: {error.strerror}", Place(path))) from error
