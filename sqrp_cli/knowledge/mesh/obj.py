"""Check of OBJ files."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sqrp_cli.errors import Place, bad_input, expected_names
from sqrp_cli.knowledge.mesh.limits import (
    MAX_TRIANGLES,
    NUMBERS,
    are_numbers,
    check_corners,
    check_pieces,
    check_triangles,
    damaged,
)

MAX_LINES = 10 * MAX_TRIANGLES
"""Most lines of a file."""

MAX_MATERIAL_BYTES = 1_000_000
"""Largest file of materials that the loader may find beside a mesh."""

_KINDS = ("v", "vt", "vn")
"""Keywords of vertices, texture coordinates and normals, in the order in which corners refer to them."""

_MEANING = {"v": "vertex", "vt": "texture coordinate", "vn": "normal"}

_NUMBERS = {"v": (3, 4, 6, 7), "vt": (1, 2, 3), "vn": (3,)}
"""Allowed numbers of values for each; vertices may have a weight, a colour or both."""

_PIECES = ("g", "o", "usemtl")
_IGNORED = ("s", "mg", "vp", "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj", "usemap", "maplib")
_KEYWORDS = frozenset((*_KINDS, "f", "l", "p", "mtllib", *_PIECES, *_IGNORED))

_FACE = re.compile(rb"^f\s", re.MULTILINE)
_CORNER = re.compile(rb"(-?\d{1,9})(?:/(-?\d{1,9})?(?:/(-?\d{1,9})?)?)?")


@dataclass
class _Mesh:
    """The state of reading a file.

    counts: number of vertices, texture coordinates and normals. largest: the largest index of each, and its line.
    """

    path: Path
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_KINDS, 0))
    largest: dict[str, tuple[int, int]] = field(default_factory=lambda: dict.fromkeys(_KINDS, (0, 0)))
    triangles: int = 0
    pieces: int = 0

    def read(self, line: int, words: Sequence[bytes]) -> None:
        """Read a line that is not empty."""
        keyword = words[0].decode("ascii", errors="replace")
        if keyword == "f":
            check_corners(self.path, len(words) - 1, line)
            self.triangles += len(words) - 3
        if keyword in _NUMBERS:
            self._check_numbers(line, keyword, words[1:])
            self.counts[keyword] += 1
        elif keyword in ("f", "l", "p"):
            self._check_corners(line, words[1:])
        elif keyword == "mtllib":
            self._check_materials(line, b" ".join(words[1:]))
        elif keyword not in _KEYWORDS:
            expected = expected_names(keyword, ("v", "vn", "vt", "f", *_PIECES, "mtllib", "s"))
            raise damaged(f"found `{keyword[:60]}`, which is no keyword of an OBJ file; {expected}", self.path, line)
        self.pieces += keyword in _PIECES

    def check_indices(self) -> None:
        """Raises InputError for an index beyond the counts; call it after the last line."""
        for kind, (index, line) in self.largest.items():
            if index > self.counts[kind]:
                raise damaged(self._not_there(kind, index), self.path, line)

    def _not_there(self, kind: str, index: int) -> str:
        return f"found the {_MEANING[kind]} {index:,}, of {self.counts[kind]:,} that there are"

    def _check_numbers(self, line: int, keyword: str, words: Sequence[bytes]) -> None:
        if len(words) not in _NUMBERS[keyword] or not are_numbers(words):
            text = b" ".join(words)[:60].decode("utf-8", errors="replace")
            count = " or ".join(map(str, _NUMBERS[keyword]))
            raise damaged(f"found the {_MEANING[keyword]} `{text}`, expected {count} {NUMBERS}", self.path, line)

    def _check_corners(self, line: int, words: Sequence[bytes]) -> None:
        for word in words:
            match = _CORNER.fullmatch(word)
            if match is None:
                text = word[:60].decode("utf-8", errors="replace")
                raise damaged(f"found the corner `{text}`, expected such as `7`, `7/1` or `7//3`", self.path, line)
            for kind, digits in zip(_KINDS, match.groups(), strict=True):
                if digits is not None:
                    self._check_index(line, kind, int(digits))

    def _check_index(self, line: int, kind: str, index: int) -> None:
        if index == 0:
            raise damaged(f"found the {_MEANING[kind]} 0, expected one from 1 on", self.path, line)
        if -index > self.counts[kind]:
            raise damaged(self._not_there(kind, index), self.path, line)
        if index > self.largest[kind][0]:
            self.largest[kind] = (index, line)

    def _check_materials(self, line: int, name: bytes) -> None:
        """The loader opens the file of materials if it exists, so that must be a regular file."""
        try:
            path = self.path.parent / name.decode("utf-8", errors="surrogateescape")
            good = not path.exists() or (path.is_file() and path.stat().st_size <= MAX_MATERIAL_BYTES)
        except (OSError, ValueError):
            good = True  # no file can have such a name
        if not good:
            message = f"the materials `{path}` are no file of at most {MAX_MATERIAL_BYTES:,} bytes"
            raise bad_input("mesh-damaged", message, Place(self.path, line), mend="remove this line")


def check_obj(path: Path) -> int:
    """The number of triangles. Raises InputError for a damaged file."""
    content = path.read_bytes()
    lines = content.count(b"\n") + content.count(b"\r")
    if lines > MAX_LINES:
        message = f"this mesh has {lines:,} lines, the limit is {MAX_LINES:,}"
        raise bad_input("mesh-too-large", message, Place(path), mend="simplify the mesh")
    polygons = len(_FACE.findall(content))
    if polygons > MAX_TRIANGLES:
        check_triangles(path, polygons)
    mesh = _Mesh(path)
    for line, words in _lines(content):
        mesh.read(line, words)
        if mesh.triangles > MAX_TRIANGLES:
            check_triangles(path, mesh.triangles)
    mesh.check_indices()
    check_pieces(path, mesh.pieces, "objects, groups and materials")
    return mesh.triangles


def _lines(content: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """The lines that are not empty, with their numbers, as words; a backslash continues a line."""
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    begun: list[bytes] = []
    for number, line in enumerate(io.BytesIO(content), 1):
        words = line.split()
        if b"#" in line:
            words = line[: line.index(b"#")].split()
        begun += words  # in place, because a line may be continued a hundred thousand times
        if begun and begun[-1].endswith(b"\\"):
            begun[-1] = begun[-1][:-1]
            if not begun[-1]:
                begun.pop()
        elif begun:
            yield number, begun
            begun = []
    if begun:
        yield number, begun
