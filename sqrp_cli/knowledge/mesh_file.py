"""A look at mesh files before they are loaded: whether they are whole, and how many triangles they have.

The loader behind the collision geometry takes damaged files for smaller meshes and does not stop at large ones.
"""

from __future__ import annotations

import re
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem

MAX_BYTES = 200_000_000
"""Largest mesh file that is read."""

MAX_TRIANGLES = 2_000_000
"""Largest mesh that is accepted; above it a whole-cell computation would take minutes."""

_STL_HEADER, _STL_TRIANGLE = 84, 50
"""Bytes before the triangles of a binary STL, the last four of them their number; bytes of each."""

_VERTEX = re.compile(rb"^[ \t]*vertex\b[ \t]*([^\r\n]*)", re.MULTILINE)
_FACET, _END = re.compile(rb"\bfacet\s+normal\b"), re.compile(rb"\bendfacet\b")
_FACE = re.compile(rb"^f\s", re.MULTILINE)
_COLLADA = re.compile(rb"<(?:triangles|polylist|polygons)\b[^>]*\bcount\s*=\s*[\"']\s*(\d+)")


def check_mesh(path: Path) -> None:
    """Raises InputError for a file that is too large, an STL that is damaged, and a mesh with too many triangles.

    Raises OSError if the file cannot be read.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        message = f"this mesh has {size:,} bytes, the limit is {MAX_BYTES:,}"
        raise InputError(Problem("file-too-large", message, Place(path), mend="simplify the mesh"))
    count = _count(path, size)
    if count > MAX_TRIANGLES:
        message = f"this mesh has {count:,} triangles, the limit is {MAX_TRIANGLES:,}"
        raise InputError(Problem("mesh-too-large", message, Place(path), mend="simplify the mesh"))


def _count(path: Path, size: int) -> int:
    """Triangles or polygons of a mesh file; 0 for formats that are not looked into."""
    suffix = path.suffix.lower()
    if suffix == ".stl":
        with path.open("rb") as file:
            header = file.read(_STL_HEADER)
        stated = int.from_bytes(header[-4:], "little") if len(header) == _STL_HEADER else 0
        if size == _STL_HEADER + _STL_TRIANGLE * stated:
            return stated
        if not header.lstrip().startswith(b"solid"):
            message = f"this STL file has {size:,} bytes"
            message += f", but its header promises {stated:,} triangles" if stated else ", fewer than a header"
            raise InputError(Problem("mesh-damaged", f"{message}: it is damaged", Place(path), mend="export it again"))
        return _count_in_text(path, path.read_bytes())
    if suffix == ".obj":
        return len(_FACE.findall(path.read_bytes()))
    if suffix == ".dae":
        return sum(map(int, _COLLADA.findall(path.read_bytes())))
    return 0


def _count_in_text(path: Path, content: bytes) -> int:
    """Triangles of an STL written as text, every one with three vertices of three numbers."""
    vertices = list(_VERTEX.finditer(content))
    for vertex in vertices:
        if not _are_numbers(vertex[1].split()):
            text = vertex[1].decode("utf-8", errors="replace").strip()
            message = f"found the vertex `{text[:60]}`, expected three numbers"
            line = content.count(b"\n", 0, vertex.start()) + 1
            raise InputError(Problem("mesh-damaged", message, Place(path, line), mend="export it again"))
    count, ends = len(_FACET.findall(content)), len(_END.findall(content))
    if len(vertices) != 3 * count or ends != count:
        message = (
            f"this STL file has {count:,} times `facet normal`, {len(vertices):,} times `vertex` and {ends:,} times "
            "`endfacet`, expected three vertices for each facet: it is damaged"
        )
        raise InputError(Problem("mesh-damaged", message, Place(path), mend="export it again"))
    return count


def _are_numbers(words: list[bytes]) -> bool:
    try:
        return len(words) == 3 and all(abs(float(word)) < float("inf") for word in words)
    except ValueError:
        return False
