"""Finding files: relative paths, and `package://NAME/...` of ROS, without ROS."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

from sqrp_cli.errors import InputError, Place, Problem, nearest
from sqrp_cli.knowledge.text.input_file import missing_file

_PIP_PACKAGES = {"example-robot-data": "example-robot-data"}
"""Packages of robot descriptions that pip installs, with the command line's name for them."""

LONGEST_PATH = 1000
"""Most characters of a path in a message."""


def package_roots(stated: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Folders in which `package://NAME/` is looked up, in order; only those that exist.

    First the stated ones, then ROS_PACKAGE_PATH, then `share` of every AMENT_PREFIX_PATH, then where installed Python
    packages put robot descriptions (`cmeel.prefix/share` and the top of every folder of `sys.path`, the environment's
    `share`).
    """
    python = [Path(entry) for entry in sys.path if entry]
    candidates = [
        *stated,
        *_environment_paths("ROS_PACKAGE_PATH"),
        *(prefix / "share" for prefix in _environment_paths("AMENT_PREFIX_PATH")),
        *(entry / "cmeel.prefix" / "share" for entry in python),
        Path(sys.prefix) / "share",
        *(entry for entry in python if entry.name in ("site-packages", "dist-packages")),
    ]
    return tuple(dict.fromkeys(root.resolve() for root in candidates if root.is_dir()))


def resolve(reference: str, folder: Path, roots: Sequence[Path], place: Place | None) -> Path:
    """The existing file that `reference` names.

    reference: a path (relative to `folder`), a `file://` URL, or `package://NAME/PATH`, which is looked up in `roots`:
    a root matches if it contains a folder NAME or is itself named NAME. place: of the reference; None for the command
    line.

    Raises InputError if there is no such file, with the roots tried and the command that installs the package.
    """
    if reference.startswith("package://"):
        return _resolve_package(reference, roots, place)
    path = Path(unquote(reference.removeprefix("file://")) if reference.startswith("file://") else reference)
    # Not by `Path`, which raises its own errors for unknown users and impossible file names.
    path = Path(os.path.normpath(folder / os.path.expanduser(path)))  # noqa: PTH111
    if not os.path.isfile(path):  # noqa: PTH113
        problem = missing_file(path)
        where = f" ({path})" if len(str(path)) < LONGEST_PATH else ""
        raise InputError(Problem("missing-file", f"`{reference}`: {problem.message}{where}", place))
    return path


def resolve_mesh(roots: Sequence[Path], reference: str, urdf: Path) -> Path:
    """The mesh file that a URDF names, in folders such as `Robot.package_roots`. Raises as `resolve`."""
    return resolve(reference, urdf.parent, roots, Place(urdf))


def _environment_paths(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _resolve_package(reference: str, roots: Sequence[Path], place: Place | None) -> Path:
    name, _, rest = reference.removeprefix("package://").partition("/")
    folders = [root if root.name == name else root / name for root in roots]
    folders = [folder for folder in folders if name and folder.is_dir()]
    for folder in folders:
        path = Path(os.path.normpath(folder / rest))
        if path.is_file():
            return path
    if folders:
        raise InputError(Problem("missing-file", f"`{reference}`: {_deepest(folders[0], rest)}", place))
    tried = "".join(f"\n  {root}" for root in roots) or " none"
    close = nearest(name, (entry.name for root in roots for entry in root.iterdir() if entry.is_dir()))
    hint = f"; did you mean `{close}`?" if close else ""
    mend = (
        f"pip install {_PIP_PACKAGES[name]}"
        if name in _PIP_PACKAGES
        else f"add the folder that contains `{name}` to `robot.package_roots` or to ROS_PACKAGE_PATH"
    )
    message = f"`{reference}`: package `{name}` not found{hint}; roots tried:{tried}"
    raise InputError(Problem("missing-package", message, place, mend=mend))


def _deepest(folder: Path, rest: str) -> str:
    """The first missing part of the path `rest` below `folder`, and the nearest name there."""
    for part in Path(rest).parts:
        if not (folder / part).exists():
            close = nearest(part, (entry.name for entry in folder.iterdir())) if folder.is_dir() else None
            return f"{folder} has no `{part}`" + (f"; did you mean `{close}`?" if close else "")
        folder = folder / part
    return f"{folder} is a folder, expected a file"
