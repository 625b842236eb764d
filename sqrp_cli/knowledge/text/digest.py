"""A fingerprint of everything that a workspace was read from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sqrp_cli.knowledge.text.input_file import open_input


@dataclass(frozen=True)
class SourceFile:
    """A file that a workspace was read from; digest: SHA-256 of its content."""

    path: Path
    digest: str


class ContentDigest:
    """Collects the files that a workspace is read from under the roles they play, and makes one SHA-256 of them.

    It depends on roles and contents only, not on where the files are or in which order they were read.
    """

    def __init__(self) -> None:
        self.files: dict[str, SourceFile] = {}

    def add(self, role: str, path: Path, content: bytes) -> None:
        """Add the file that plays `role`, such as `cameras.cam1.calibration`, with its content."""
        self.files[role] = SourceFile(path, hashlib.sha256(content).hexdigest())

    def add_file(self, role: str, path: Path) -> None:
        """Add a file that is read elsewhere, such as a mesh. Raises as `open_input`."""
        with open_input(path) as file:
            self.files[role] = SourceFile(path, hashlib.file_digest(file, "sha256").hexdigest())

    def hexdigest(self) -> str:
        """The digest of everything that was added."""
        return digest_of((role, file.digest) for role, file in self.files.items())


def digest_of(parts: Iterable[tuple[str, str]]) -> str:
    """One SHA-256 of named digests, whatever their order."""
    return hashlib.sha256("".join(f"{role}\0{digest}\n" for role, digest in sorted(parts)).encode()).hexdigest()
