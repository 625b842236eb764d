"""A fingerprint of everything that a workspace was read from."""

from __future__ import annotations

import hashlib
from pathlib import Path


class ContentDigest:
    """Collects the content of files under the roles they play, and makes one SHA-256 of it.

    It depends on roles and contents only, not on where the files are or in which order they were read.
    """

    def __init__(self) -> None:
        self._hashes: dict[str, str] = {}

    def add(self, role: str, content: bytes) -> None:
        """Add the content of the file that plays `role`, such as `cameras.cam1.calibration`."""
        self._hashes[role] = hashlib.sha256(content).hexdigest()

    def add_file(self, role: str, path: Path) -> None:
        """Add a file that is read elsewhere, such as a mesh. Raises OSError if it cannot be read."""
        with path.open("rb") as file:
            self._hashes[role] = hashlib.file_digest(file, "sha256").hexdigest()

    def hexdigest(self) -> str:
        """The digest of everything that was added."""
        lines = "".join(f"{role}\0{content}\n" for role, content in sorted(self._hashes.items()))
        return hashlib.sha256(lines.encode()).hexdigest()
