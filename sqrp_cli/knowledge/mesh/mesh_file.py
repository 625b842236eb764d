"""Checks of mesh files before they are loaded: complete, consistent, not too large; their unit, and how far they reach.

The loaders of collision geometry and pictures read damaged files as smaller meshes, do not stop at large ones, and
allocate whatever a number in a file demands. Files that pass here load correctly and fast.

The loaders ignore the unit of a COLLADA file (DAE), so it becomes part of the mesh's scale. They also ignore
`<up_axis>`: a mesh has the axes of its link or part. RViz treats both in the same way.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.mesh.collada import check_dae
from sqrp_cli.knowledge.mesh.limits import MAX_BYTES, MAX_TEXT_BYTES, check_bytes, check_triangles
from sqrp_cli.knowledge.mesh.obj import check_obj
from sqrp_cli.knowledge.mesh.stl import check_stl
from sqrp_cli.knowledge.text.input_file import open_input
from sqrp_cli.knowledge.text.units import LARGEST, SMALLEST_SIZE
from sqrp_cli.shapes import Mesh, Part, Shape

_CHECKS = {".stl": check_stl, ".obj": check_obj, ".dae": check_dae}
"""What counts the triangles of a file, by its ending, and raises InputError for a damaged one."""

_EXACT = frozenset({".step", ".stp", ".iges", ".igs", ".brep"})
"""Endings of files of CAD programs, whose surfaces are exact and not triangles."""

_CONVERSIONS = (
    "make triangles of it, such as by `gmsh part.step -2 -o part.stl` (pip install gmsh) or in FreeCAD; such files are"
    " usually in mm, so state `scale: 0.001`"
)

_CHUNK = 65_536
"""Bytes of a COLLADA file to read at once until its unit is known."""


def check_mesh(path: Path) -> None:
    """Raises InputError, with line or byte, for a mesh file that is not STL, OBJ or DAE, too large, empty or damaged.

    Raises OSError if the file cannot be read.
    """
    stat = path.stat()
    _check(path, stat.st_size, stat.st_mtime_ns)


def mesh_of(path: Path, scale: tuple[float, float, float]) -> Mesh:
    """The mesh in a file, in metres: a COLLADA file's unit is in its scale. Raises InputError for a wrong unit."""
    unit, (x, y, z) = mesh_unit(path), scale
    return Mesh(path, (unit * x, unit * y, unit * z))


def mesh_unit(path: Path) -> float:
    """Length of the unit of a mesh file [m]: that of a COLLADA file, otherwise 1.

    Also 1 for a file that cannot be read or is not XML; loading it will fail. Raises InputError, with the line, for a
    unit that is not a length.
    """
    if path.suffix.lower() != ".dae":
        return 1.0
    reader = _UnitReader()
    try:
        with open_input(path) as file:
            while not reader.done and (chunk := file.read(_CHUNK)):
                reader.parser.Parse(chunk)
    except (InputError, expat.ExpatError):
        return 1.0
    try:
        unit = float(reader.meter)
    except ValueError:
        unit = 0.0
    if not 1 / LARGEST <= unit <= LARGEST:
        message = f'found `<unit meter="{reader.meter[:60]}">`, expected the length of the unit in metres'
        raise bad_input("wrong-value", message, Place(path, reader.line), mend="export it again")
    return unit


@lru_cache(maxsize=4096)
def _check(path: Path, size: int, _time: int) -> None:
    """As `check_mesh`; an unchanged file is not checked again."""
    suffix = path.suffix.lower()
    check_bytes(path, size, MAX_BYTES if suffix == ".stl" else MAX_TEXT_BYTES)
    if suffix not in _CHECKS:
        message = f"found a mesh with the ending `{path.suffix}`, expected .stl, .obj or .dae"
        mend = _CONVERSIONS if suffix in _EXACT else "export it as one of these"
        raise bad_input("unknown-mesh", message, Place(path), mend=mend)
    check_triangles(path, _CHECKS[suffix](path))


class _UnitReader:
    """Reads a COLLADA file up to the end of its own `<asset>`, the first one; parts of the file have further ones."""

    def __init__(self) -> None:
        self.meter, self.line, self.done = "1", 1, False
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler, self.parser.EndElementHandler = self._start, self._end

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag.split(":")[-1] == "unit" and not self.done:
            self.meter, self.line = attributes.get("meter", "1"), self.parser.CurrentLineNumber

    def _end(self, tag: str) -> None:
        self.done = self.done or tag.split(":")[-1] == "asset"


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
        raise bad_input("mesh-unreadable", "this mesh cannot be loaded", Place(mesh.path)) from error
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        raise bad_input("mesh-unreadable", "this mesh has vertices without place", Place(mesh.path))
    return vertices
