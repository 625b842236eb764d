"""Size limits of mesh files, and the errors for files beyond them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.knowledge.text.units import as_number

MAX_BYTES = 200_000_000
"""Largest STL file that is read."""

MAX_TEXT_BYTES = 64_000_000
"""Largest OBJ and DAE file: the loaders keep several copies of their text."""

MAX_TRIANGLES = 500_000
"""Largest mesh that is accepted; the loader needs half a gigabyte and about five seconds for it."""

MAX_NUMBER = 3.4e38
"""Largest coordinate: the loaders hold them in single precision."""

NUMBERS = f"finite numbers up to {MAX_NUMBER:g}"
"""What messages expect where `are_numbers` is false."""

MAX_CORNERS = 1000
"""Most corners of a polygon; the time to cut one into triangles grows with their number squared."""

MAX_PIECES = 10_000
"""Most pieces (objects, groups, materials, nodes, placed geometries) of a mesh; the loader needs kilobytes for each."""


def damaged(message: str, path: Path, line: int | None = None) -> InputError:
    """A mesh file that contradicts itself or its format."""
    return bad_input("mesh-damaged", message, Place(path, line), mend="export it again")


def are_numbers(words: Sequence[bytes]) -> bool:
    """Whether all words are finite numbers of single precision."""
    return all(abs(as_number(word)) <= MAX_NUMBER for word in words)


def check_bytes(path: Path, size: int, limit: int) -> None:
    """Raises InputError for a file of more than `limit` bytes."""
    if size > limit:
        message = f"this mesh has {size:,} bytes, the limit is {limit:,}"
        raise bad_input("file-too-large", message, Place(path), mend="simplify the mesh")


def check_triangles(path: Path, count: int) -> None:
    """Raises InputError for a mesh without triangles, and for one with more than `MAX_TRIANGLES`."""
    if count == 0:
        raise bad_input("mesh-empty", "this mesh has no triangles", Place(path))
    if count > MAX_TRIANGLES:
        message = f"this mesh has {count:,} triangles, the limit is {MAX_TRIANGLES:,}"
        raise bad_input("mesh-too-large", message, Place(path), mend="simplify the mesh")


def check_pieces(path: Path, count: int, what: str) -> None:
    """Raises InputError for a mesh of more than `MAX_PIECES` pieces; what: their name in the message."""
    if count > MAX_PIECES:
        message = f"this mesh has {count:,} {what}, the limit is {MAX_PIECES:,}"
        raise bad_input("mesh-too-large", message, Place(path), mend="join its pieces")


def check_corners(path: Path, count: int, line: int) -> None:
    """Raises InputError for a polygon with fewer than three or more than `MAX_CORNERS` corners."""
    if not 3 <= count <= MAX_CORNERS:
        message = f"found a polygon with {count:,} corners, expected 3 to {MAX_CORNERS}"
        raise bad_input("mesh-damaged", message, Place(path, line), mend="triangulate the mesh when exporting it")
