"""Opening input files safely: only regular files of a limited size, and nothing that can block.

All input files are opened here. Pipes and devices may never end, nor may files that the system generates while they are
read, such as those in /proc, which claim to be empty. A digest identifies the content that was read.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from io import BufferedReader
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem, bad_input, misspelt
from sqrp_cli.records import dataclass

LARGEST = 200_000_000  # most bytes of any input file, meshes included
NOT_THERE = "no such file or folder"  # what messages say of a path at which there is nothing
YAML_ENDINGS = (".yaml", ".yml")
_TOO_LARGE = "the file has {:,} bytes, the limit is {:,}"
_noted: ContextVar[set[Path] | None] = ContextVar("noted", default=None)


@contextmanager
def noted_files() -> Iterator[set[Path]]:
    """The files that are opened meanwhile, or are missing."""
    found: set[Path] = set()
    before = _noted.set(found)
    try:
        yield found
    finally:
        _noted.reset(before)


@contextmanager
def open_input(path: Path, limit: int = LARGEST) -> Iterator[BufferedReader]:
    """A file of at most `limit` bytes, open for reading.

    Raises InputError if it is missing (naming the file nearest in spelling), is not a regular file on a disk, is
    larger, or cannot be opened or read.
    """
    if (noted := _noted.get()) is not None:
        noted.add(path)
    if not os.path.isfile(path):  # noqa: PTH113 # `Path` raises for a name that is too long
        raise InputError(missing_file(path))
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):  # replaced since the check before
                raise InputError(missing_file(path))
            if status.st_size > limit:
                raise bad_input("file-too-large", _TOO_LARGE.format(status.st_size, limit), Place(path))
            if status.st_size == 0 and file.read(1) != b"":
                message = "the system makes up the content of this file as it is read, expected a file on a disk"
                raise bad_input("no-regular-file", message, Place(path))
            yield file
    except OSError as error:
        raise bad_input("unreadable-file", f"cannot be read: {error.strerror}", Place(path)) from error


def read_input(path: Path, limit: int) -> bytes:
    """The content of a file of at most `limit` bytes. Raises as `open_input`."""
    with open_input(path, limit) as file:
        content = file.read(limit + 1)
    if len(content) > limit:  # it has grown since
        raise bad_input("file-too-large", _TOO_LARGE.format(len(content), limit), Place(path))
    return content


def read_text(path: Path, limit: int) -> str:
    """The text of a UTF-8 file of at most `limit` bytes. Raises as `open_input` and `decoded`."""
    return decoded(path, read_input(path, limit))


def decoded(path: Path, content: bytes) -> str:
    """UTF-8 text, without a byte order mark. Raises InputError, with the line, if it is not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = f"byte 0x{content[error.start]:02x} is not UTF-8 text"
        raise bad_input("not-utf-8", message, Place(path, line), mend="save the file as UTF-8") from error


def missing_file(path: Path) -> Problem:
    """The problem of a file that does not exist, with the nearest name."""
    if os.path.isdir(path):  # noqa: PTH112
        return Problem("missing-file", "found a folder, expected a file", Place(path))
    if os.path.lexists(path):
        return Problem("missing-file", "found a pipe, a device or a broken link, expected a file", Place(path))
    folder = path.parent
    if not os.path.isdir(folder):  # noqa: PTH112
        return Problem("missing-file", f"{NOT_THERE}; there is no folder {folder}", Place(path))
    # A file of the same ending, by default YAML, or of any if the names agree.
    ending = path.suffix.lower() or YAML_ENDINGS[0]
    endings = YAML_ENDINGS if ending in YAML_ENDINGS else (ending,)
    close = nearest_entry(path, lambda e: (e.suffix.lower() in endings or e.stem == path.stem) and e.is_file())
    return Problem("missing-file", NOT_THERE + (f"; did you mean `{close}`?" if close else ""), Place(path))


def nearest_entry(path: Path, could_be_meant: Callable[[Path], bool]) -> str | None:
    """The name in the folder of a missing path that is nearest in spelling, if `could_be_meant` accepts it.

    Endings do not count: two files are not nearer because they share one.
    """
    try:
        names = {entry.stem: entry.name for entry in sorted(path.parent.iterdir()) if could_be_meant(entry)}
    except OSError:
        return None
    close = misspelt(path.stem, names)
    return names[close] if close is not None else None


@dataclass(frozen=True)
class SourceFile:
    """A file that a workspace was read from, as it plays a role in it, such as `cameras.cam1.calibration`."""

    path: Path
    digest: str  # SHA-256 of its content


def source_file(path: Path, content: bytes | None = None) -> SourceFile:
    """A file with its content, or with what is in it; raises as `open_input` then."""
    if content is not None:
        return SourceFile(path.absolute(), hashlib.sha256(content).hexdigest())
    with open_input(path) as file:
        return SourceFile(path, hashlib.file_digest(file, "sha256").hexdigest())
