"""What the readers of a workspace's parts have in common: the files that entries name, and all problems in one list."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.knowledge.mesh import read_mesh
from sqrp_cli.knowledge.robot.robot_source import RobotSource
from sqrp_cli.knowledge.text import packages
from sqrp_cli.knowledge.text.entries import XacroEntry
from sqrp_cli.knowledge.text.input_file import ContentDigest
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument
from sqrp_cli.shapes import Mesh


class RobotDescription(NamedTuple):
    """The file of a URDF or SRDF, and what else it is made of."""

    file: Path
    source: RobotSource


@dataclass(kw_only=True)
class EntryReader:
    """Reads entries of a workspace file, adds the files that they name to the digest, and collects all problems.

    roots: folders for `package://`.
    """

    document: SourceDocument
    digest: ContentDigest
    roots: tuple[Path, ...] = ()
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)

    @contextmanager
    def _collecting(self) -> Iterator[None]:
        """Adds the problems of an InputError to those that were found; what could not be read is left out."""
        try:
            yield
        except InputError as error:
            self.problems.extend(error.problems)

    def _report(self, code: str, path: KeyPath, message: str, mend: str | None = None) -> None:
        self.problems.append(self.document.problem(code, path, message, mend))

    def _place_of_file(self, path: KeyPath) -> Place:
        """Where the entry at `path` names its file: under the key `file`, if it is more than that."""
        named = (*path, "file")
        return self.document.value_place(named if named in self.document.keys else path)

    def _resolve(self, reference: str, place: Place) -> Path:
        """The file that is named at a place. Raises InputError where there is none."""
        return packages.resolve(reference, self.document.folder, self.roots, place)

    def _described(self, entry: XacroEntry | str, path: KeyPath) -> RobotDescription:
        """The file of a URDF or SRDF that the entry at `path` names, and what else it is made of."""
        if isinstance(entry, str):
            entry = XacroEntry(xacro=entry)
        else:
            path = (*path, "xacro")
        file = self._resolve(entry.xacro, self.document.value_place(path))
        return RobotDescription(file, RobotSource((*self.roots, self.document.folder), entry.args))

    def _add_mesh(self, role: str, mesh: Mesh, place: Place) -> None:
        """Add a mesh file to the digest; place: where it is named.

        Raises as `read_mesh`.
        """
        try:
            self.digest.add_file(role, mesh.path)  # first checks that this is a regular file
            read_mesh(mesh.path, mesh.scale)
        except InputError as error:
            problems = (
                replace(problem, message=f"{problem.message}; {place} names this file") for problem in error.problems
            )
            raise InputError(*problems) from error
        except OSError as error:
            raise bad_input("unreadable-file", f"{mesh.path}: {error.strerror}", place) from error
