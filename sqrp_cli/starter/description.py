"""A user's robot description: how a workspace refers to it, and the files near it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.robot.read_urdf import read_urdf
from sqrp_cli.knowledge.robot.srdf import read_srdf
from sqrp_cli.knowledge.robot.urdf import MeshReference, UrdfModel
from sqrp_cli.knowledge.text.input_file import missing_file
from sqrp_cli.knowledge.text.packages import package_roots, resolve
from sqrp_cli.knowledge.text.xml_file import read_xml

_SRDF_FOLDERS = (".", "srdf", "config", "../srdf", "../config")
"""Where the SRDF of a URDF is looked for, relative to its folder."""

PACKAGE = "package://"


@dataclass(frozen=True, eq=False)
class Description:
    """A robot description.

    urdf: parsed. reference, srdf: as a workspace file names them. package_roots: folders that its meshes need besides
    the known ones, as the file names them. warnings: about files that were found but cannot be used.
    """

    urdf: UrdfModel
    reference: str
    srdf: str | None
    package_roots: tuple[str, ...]
    warnings: tuple[Problem, ...]


def describe_robot(reference: str, folder: Path) -> Description:
    """Read a URDF, named by a path or `package://...`, for a workspace in `folder`.

    Raises InputError for a URDF that cannot be used.
    """
    # `Path` would raise errors of its own for unknown users and for impossible names.
    named = os.path.expanduser(reference)  # noqa: PTH111
    if "://" not in reference and not os.path.isfile(named):  # noqa: PTH113
        raise InputError(missing_file(Path(named)))
    path = resolve(reference, Path.cwd(), package_roots(), None).resolve()
    try:
        urdf = read_urdf(path)
    except InputError as error:
        raise InputError(*(_placed_at(Path(named), path, problem) for problem in error.problems)) from error
    srdf, warnings = _srdf_beside(path, urdf)
    return Description(
        urdf=urdf,
        reference=_named(path, folder),
        srdf=None if srdf is None else _named(srdf, folder),
        package_roots=tuple(os.path.relpath(root, folder.resolve()) for root in _missing_roots(urdf)),
        warnings=tuple(warnings),
    )


def _placed_at(given: Path, path: Path, problem: Problem) -> Problem:
    """A problem of the file at a path, placed at that path as it was given."""
    if problem.place is None or problem.place.file != path:
        return problem
    return replace(problem, place=replace(problem.place, file=given))


def _named(path: Path, folder: Path) -> str:
    """How a workspace in `folder` names a file: `package://` where a known package holds it, else a relative path."""
    for root in package_roots():
        if root in path.parents:
            package, *rest = path.relative_to(root).parts
            if rest and resolve_or_none(f"{PACKAGE}{package}/{'/'.join(rest)}") == path:
                return f"{PACKAGE}{package}/{'/'.join(rest)}"
    return os.path.relpath(path, folder.resolve())


def resolve_or_none(reference: str) -> Path | None:
    """The file of a `package://` reference in the known folders."""
    try:
        return resolve(reference, Path.cwd(), package_roots(), Place(Path.cwd())).resolve()
    except InputError:
        return None


def _missing_roots(urdf: UrdfModel) -> Iterator[Path]:
    """Folders around the URDF with packages of its meshes that are found nowhere else."""
    pieces = [piece for link in urdf.links.values() for piece in (*link.collision, *link.visual)]
    references = [piece.shape.reference for piece in pieces if isinstance(piece.shape, MeshReference)]
    needed = dict.fromkeys(name.removeprefix(PACKAGE).split("/")[0] for name in references if name.startswith(PACKAGE))
    known = package_roots()
    found: set[Path] = set()
    for package in needed:
        if any((root / package).is_dir() or root.name == package for root in known):
            continue
        root = next((folder for folder in urdf.path.parents if (folder / package).is_dir()), None)
        if root is not None and root not in found:
            found.add(root)
            yield root


def _srdf_beside(path: Path, urdf: UrdfModel) -> tuple[Path | None, list[Problem]]:
    """The SRDF near a URDF with its file name or robot name, and why other such files do not fit."""
    warnings: list[Problem] = []
    for folder in dict.fromkeys((path.parent / name).resolve() for name in _SRDF_FOLDERS):
        for file in sorted(folder.glob("*.srdf")) if folder.is_dir() else ():
            try:
                if file.stem == path.stem or read_xml(file, "robot").attributes.get("name") == urdf.name:
                    read_srdf(file, urdf)
                    return file, []
            except InputError as error:
                why = error.problems[0]
                message = f"{why.message}; so this SRDF was left out"
                warnings.append(Problem(why.code, message, why.place, severity="warning"))
    return None, warnings
