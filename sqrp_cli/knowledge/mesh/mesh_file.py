"""Checks of mesh files before they are loaded: complete, consistent, not too large; their unit, and how far they reach.

The loaders of collision geometry and pictures read damaged files as smaller meshes, do not stop at large ones, and
allocate whatever a number in a file demands. Files that pass here load correctly and fast.

The loaders ignore the unit of a COLLADA file (DAE), so it becomes part of the mesh's scale. They also ignore
`<up_axis>`: a mesh has the axes of its link or part. RViz treats both in the same way.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain, cycle
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.geometry import Array, transform
from sqrp_cli.knowledge.mesh.collada import check_dae
from sqrp_cli.knowledge.mesh.limits import (
    MAX_BYTES,
    MAX_NUMBER,
    MAX_TEXT_BYTES,
    check_bytes,
    check_pieces,
    check_triangles,
    damaged,
)
from sqrp_cli.knowledge.mesh.obj import check_obj
from sqrp_cli.knowledge.text.input_file import open_input
from sqrp_cli.knowledge.text.units import LARGEST, SMALLEST_SIZE
from sqrp_cli.shapes import Mesh, Part, Shape

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
        raise InputError(Problem("wrong-value", message, Place(path, reader.line), mend="export it again"))
    return unit


@lru_cache(maxsize=4096)
def _check(path: Path, size: int, _time: int) -> None:
    """As `check_mesh`; an unchanged file is not checked again."""
    suffix = path.suffix.lower()
    check_bytes(path, size, MAX_BYTES if suffix == ".stl" else MAX_TEXT_BYTES)
    match suffix:
        case ".stl":
            count = check_stl(path, size)
        case ".obj":
            count = check_obj(path)
        case ".dae":
            count = check_dae(path)
        case _:
            message = f"found a mesh with the ending `{path.suffix}`, expected .stl, .obj or .dae"
            mend = _CONVERSIONS if suffix in _EXACT else "export it as one of these"
            raise InputError(Problem("unknown-mesh", message, Place(path), mend=mend))
    check_triangles(path, count)


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
        raise InputError(Problem("mesh-unreadable", "this mesh cannot be loaded", Place(mesh.path))) from error
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        raise InputError(Problem("mesh-unreadable", "this mesh has vertices without place", Place(mesh.path)))
    return vertices


_HEADER = 84
"""Bytes before the triangles of a binary STL; the last four are the number of triangles."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of a binary STL."""

_NUMBER = "a number"
_VERTEX = ("vertex", _NUMBER, _NUMBER, _NUMBER)
_WORDS = ("facet", "normal", *_VERTEX[1:], "outer", "loop", *_VERTEX * 3, "endloop", "endfacet")
"""The words of a triangle in a text STL."""

_PATTERN = rb"\s+".join(rb"(\S+)" if word == _NUMBER else word.encode() for word in _WORDS)
_TRIANGLE = re.compile(_PATTERN + rb"(?:\s+|\Z)")
_SOLID, _END = re.compile(rb"\s*solid\b[^\r\n]*\s*"), re.compile(rb"endsolid\b[^\r\n]*\s*")


def check_stl(path: Path, size: int) -> int:
    """The number of triangles. Raises InputError for a damaged file."""
    with path.open("rb") as file:
        header = file.read(_HEADER)
    stated = int.from_bytes(header[-4:], "little") if len(header) == _HEADER else 0
    if len(header) == _HEADER and size == _HEADER + _FACET.itemsize * stated:
        check_triangles(path, stated)
        _check_binary(path)
        return stated
    if not header.lstrip().startswith(b"solid"):
        message = f"this STL file has {size:,} bytes"
        message += (
            f", but its header promises {stated:,} triangles (bytes 80 to 83), which are "
            f"{_HEADER + _FACET.itemsize * stated:,} bytes"
            if len(header) == _HEADER
            else f", fewer than the {_HEADER} of a header"
        )
        raise damaged(f"{message}: it is damaged", path)
    content = path.read_bytes()
    check_triangles(path, content.count(b"endfacet"))
    return _count_text(path, content)


def _check_binary(path: Path) -> None:
    corners = np.fromfile(path, dtype=_FACET, offset=_HEADER)["corners"]
    finite = np.isfinite(corners).all(axis=(1, 2))
    if not finite.all():
        facet = int(finite.argmin())
        at = _HEADER + _FACET.itemsize * facet
        found = " ".join(f"{number:g}" for number in corners[facet].ravel())
        raise damaged(f"triangle {facet + 1:,} (byte {at:,}) has the corners {found}, expected finite numbers", path)


def _count_text(path: Path, content: bytes) -> int:
    """Number of triangles of a text STL: `solid`, triangles, `endsolid`, possibly repeated."""
    at = count = pieces = 0
    while at < len(content):
        start = _SOLID.match(content, at)
        if start is None:
            raise _unexpected(path, content, at, iter(("solid",)))
        pieces, at = pieces + 1, start.end()
        while triangle := _TRIANGLE.match(content, at):
            if not _are_finite(triangle.groups()[3:]):
                break
            count, at = count + 1, triangle.end()
        end = _END.match(content, at)
        if end is None:
            raise _unexpected(path, content, at, chain(cycle(_WORDS)))
        at = end.end()
    check_pieces(path, pieces, "solids")
    return count


def _are_finite(words: tuple[bytes, ...]) -> bool:
    try:
        return all(abs(float(word)) <= MAX_NUMBER for word in words)
    except ValueError:
        return False


def _unexpected(path: Path, content: bytes, at: int, expected: Iterator[str]) -> Exception:
    """The error for the first unexpected word from a byte on."""
    normal = 0
    for found in re.finditer(rb"\S+", content[at : at + 10_000]):
        word, wanted = found[0], next(expected)
        normal = 3 if wanted == "normal" else normal - (wanted == _NUMBER)
        if not (_are_finite((word,)) or normal >= 0 if wanted == _NUMBER else word == wanted.encode()):
            line = content.count(b"\n", 0, at + found.start()) + 1
            text = word[:60].decode("utf-8", errors="replace")
            wanted = wanted if wanted == _NUMBER else f"`{wanted}`"
            return damaged(f"found `{text}`, expected {wanted}", path, line)
    message = "the file ends within a triangle or before `endsolid`: it is cut off"
    return damaged(message, path, content.count(b"\n") + 1)
