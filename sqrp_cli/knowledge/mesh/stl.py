"""Checks of STL files: whole, with finite numbers, of triangles that can be counted."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain, cycle
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.mesh.limits import NUMBERS, are_numbers, check_pieces, check_triangles, damaged

_HEADER = 84
"""Bytes before the triangles of a binary STL; the last four are the number of triangles."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of a binary STL."""

_VERTEX = ("vertex", NUMBERS, NUMBERS, NUMBERS)
_WORDS = ("facet", "normal", *_VERTEX[1:], "outer", "loop", *_VERTEX * 3, "endloop", "endfacet")
"""The words of a triangle in a text STL."""

_PATTERN = rb"\s+".join(rb"(\S+)" if word == NUMBERS else word.encode() for word in _WORDS)
_TRIANGLE = re.compile(_PATTERN + rb"(?:\s+|\Z)")
_SOLID, _END = re.compile(rb"\s*solid\b[^\r\n]*\s*"), re.compile(rb"endsolid\b[^\r\n]*\s*")


def check_stl(path: Path) -> int:
    """The number of triangles. Raises InputError for a damaged file."""
    size = path.stat().st_size
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
        raise damaged(f"triangle {facet + 1:,} (byte {at:,}) has the corners {found}, expected {NUMBERS}", path)


def _count_text(path: Path, content: bytes) -> int:
    """Number of triangles of a text STL: `solid`, triangles, `endsolid`, possibly repeated."""
    at = count = pieces = 0
    while at < len(content):
        start = _SOLID.match(content, at)
        if start is None:
            raise _unexpected(path, content, at, iter(("solid",)))
        pieces, at = pieces + 1, start.end()
        while triangle := _TRIANGLE.match(content, at):
            if not are_numbers(triangle.groups()[3:]):
                break
            count, at = count + 1, triangle.end()
        end = _END.match(content, at)
        if end is None:
            raise _unexpected(path, content, at, chain(cycle(_WORDS)))
        at = end.end()
    check_pieces(path, pieces, "solids")
    return count


def _unexpected(path: Path, content: bytes, at: int, expected: Iterator[str]) -> Exception:
    """The error for the first unexpected word from a byte on."""
    normal = 0
    for found in re.finditer(rb"\S+", content[at : at + 10_000]):
        word, wanted = found[0], next(expected)
        normal = 3 if wanted == "normal" else normal - (wanted == NUMBERS)
        if not (are_numbers((word,)) or normal >= 0 if wanted == NUMBERS else word == wanted.encode()):
            line = content.count(b"\n", 0, at + found.start()) + 1
            text = word[:60].decode("utf-8", errors="replace")
            wanted = wanted if wanted == NUMBERS else f"`{wanted}`"
            return damaged(f"found `{text}`, expected {wanted}", path, line)
    message = "the file ends within a triangle or before `endsolid`: it is cut off"
    return damaged(message, path, content.count(b"\n") + 1)
