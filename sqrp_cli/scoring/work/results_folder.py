"""Where outcomes are kept: in memory, and in a folder from which an interrupted run goes on."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.text.input_file import read_text
from sqrp_cli.platform.files import make_folder, write_atomically

LOCK = ".lock"

MAX_BYTES = 10_000_000
"""Largest outcome that is read again; one of an hour's motion has less than a megabyte."""


@contextmanager
def results_in(folder: Path | None) -> Iterator[Results]:
    """Results in a folder, or in memory only; other runs may use the folder afterwards. Raises as `Results`."""
    results = Results(folder)
    try:
        yield results
    finally:
        results.close()


class Results:
    """Outcomes by the key of what was computed; see `identity.candidate_key`.

    With a folder each is a file of its own there, named by its key and written whole or not at all, so that whatever
    happens to a run, the next one finds what is finished.
    """

    def __init__(self, folder: Path | None) -> None:
        """Open or make the folder. Raises InputError where it cannot be written or another run is using it."""
        self._texts: dict[str, str] = {}
        self.folder = folder
        self._lock: IO[str] | None = None
        if folder is not None:
            make_folder(folder)
            try:
                self._lock = _locked(folder)
            except OSError as error:
                message = f"results cannot be kept in this folder: {error.strerror or error}"
                raise InputError(Problem("cannot-write", message, Place(folder))) from error
            for leftover in folder.glob("*/.*.json.*"):  # of a run that was killed as it wrote
                leftover.unlink()

    def get(self, key: str) -> str | None:
        """What is kept under a key, if anything."""
        if key not in self._texts and self.folder is not None:
            path = self._path(self.folder, key)
            if path.is_file():
                # What is damaged is for whoever reads it to find out.
                with suppress(InputError):
                    self._texts[key] = read_text(path, MAX_BYTES)
        return self._texts.get(key)

    def keep(self, key: str, text: str) -> None:
        """Keep an outcome. Raises InputError where it cannot be written."""
        self._texts[key] = text
        if self.folder is not None:
            path = self._path(self.folder, key)
            try:
                path.parent.mkdir(exist_ok=True)
                _make_way(path)
            except OSError as error:
                message = f"results cannot be kept in this folder: {error.strerror or error}"
                raise InputError(Problem("cannot-write", message, Place(self.folder))) from error
            try:
                write_atomically(path, text)
            except InputError as error:
                mend = "make room; the same command then goes on from what is finished, which is kept"
                raise InputError(*(replace(problem, mend=mend) for problem in error.problems)) from error

    def close(self) -> None:
        """Let other runs use the folder."""
        if self._lock is not None:
            self._lock.close()

    @staticmethod
    def _path(folder: Path, key: str) -> Path:
        return folder / key[:2] / f"{key}.json"


def _make_way(path: Path) -> None:
    """Remove what is in the place of a result and is no file: a link that leads nowhere, a pipe, an empty folder.

    Raises OSError where that is not possible.
    """
    if path.is_dir():
        path.rmdir()
    elif os.path.lexists(path) and not path.is_file():
        path.unlink()


def _locked(folder: Path) -> IO[str]:
    """A file that is open as long as this run uses the folder. Raises OSError, and InputError where it is in use."""
    file = (folder / LOCK).open("w")
    try:
        import fcntl

        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:  # no such locks here: whoever starts two runs at a time computes some things twice
        pass
    except OSError as error:
        file.close()
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        message = "another `sqrp score` is writing to this folder"
        mend = "wait for it, or name another folder"
        raise InputError(Problem("folder-in-use", message, Place(folder), mend=mend)) from error
    return file
