"""Finding files: relative paths, and `package://NAME/...` of ROS, without ROS."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from urllib.parse import unquote

from sqrp_cli.errors import InputError, Place, Problem, bad_input, misspelt, nearest, no_such
from sqrp_cli.files.input_file import missing_file

_PIP_PACKAGES = {"example-robot-data": "example-robot-data"}
"""Packages of robot descriptions that pip installs, with the command line's name for them."""
LONGEST_PATH = 1000  # most characters of a path in a message
MANIFEST = "package.xml"  # the file that makes a folder a ROS package, and names it
DEEPEST_PACKAGE = 4  # folders between a root and a package in it, as in `src/universal_robot/ur_description`
MOST_FOLDERS = 3000  # most folders of a root that are looked into for packages
_NEEDS = re.compile(r"<(?:exec_|run_|build_)?depend>\s*([^<>\s]+)\s*</|<!--.*?-->", re.DOTALL)
_NAME = re.compile(r"<name>\s*([^<>\s]+)\s*</name>")
_NO_PACKAGES = frozenset({"build", "log", "node_modules", "__pycache__", "site-packages", "meshes", "doc", "docs"})
"""Folders that are not looked into."""


def package_name(folder: Path) -> str | None:
    """The name in a folder's `package.xml`; None if it has none."""
    try:
        with (folder / MANIFEST).open(encoding="utf-8", errors="replace") as file:
            found = _NAME.search(file.read(100_000))
    except OSError:
        return None
    return found[1] if found else None


def needed_packages(package: Path, roots: Sequence[Path]) -> list[Path]:
    """The folders of the packages that one needs, by its `package.xml`; those that `roots` have."""
    file = package / MANIFEST
    text = file.read_text(encoding="utf-8", errors="replace")[:100_000] if file.is_file() else ""
    names = dict.fromkeys(match[1] for match in _NEEDS.finditer(text) if match[1])
    return [folder for name in names if (folder := next(_folders_called(name, roots), None)) is not None]


def package_around(path: Path) -> Path | None:
    """The folder of the package that a file is in; None if it is in none."""
    return next((folder for folder in path.parents if (folder / MANIFEST).is_file()), None)


def package_and_path(reference: str) -> tuple[str, str]:
    """The package and its file that `package://NAME/PATH` names; with a third slash, it means the same."""
    name, _, path = reference.removeprefix("package://").lstrip("/").partition("/")
    return name, path


def package_folder(name: str, roots: Sequence[Path], place: Place | None) -> Path:
    """The folder of a package. What counts is the name in `package.xml`, for a folder without one its own name.

    It may be a root itself, or up to `DEEPEST_PACKAGE` folders below one. Raises InputError, with the roots tried.
    """
    folder = next(_folders_called(name, roots), None)
    if folder is None:
        raise InputError(_no_package(f"package `{name}`", name, roots, place))
    return folder


def package_roots(stated: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Folders in which `package://NAME/` is looked up, in order; only those that exist.

    First the stated ones, then ROS_PACKAGE_PATH, then `share` of every AMENT_PREFIX_PATH, then where installed Python
    packages put robot descriptions (`cmeel.prefix/share` and the top of every folder of `sys.path`, the environment's
    `share`).
    """
    python = [Path(entry) for entry in sys.path if entry]
    ros, prefixes = (os.environ.get(name, "").split(os.pathsep) for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    candidates = [
        *stated,
        *(Path(entry) for entry in ros if entry),
        *(Path(entry, "share") for entry in prefixes if entry),
        *(entry / "cmeel.prefix" / "share" for entry in python),
        Path(sys.prefix) / "share",
        *(entry for entry in python if entry.name in ("site-packages", "dist-packages")),
    ]
    return tuple(dict.fromkeys(root.resolve() for root in candidates if root.is_dir()))


def resolve(reference: str, folder: Path, roots: Sequence[Path], place: Place | None) -> Path:
    """The existing file that `reference` names.

    reference: a path (relative to `folder`), a `file://` URL, or `package://NAME/PATH`, which is looked up in `roots`
    as `package_folder` does. place: of the reference; None for the command line.

    Raises InputError if there is no such file, with the roots tried and the command that installs the package.
    """
    if reference.startswith("package://"):
        name, rest = package_and_path(reference)
        first: Path | None = None
        for folder in _folders_called(name, roots):
            path = Path(os.path.normpath(folder / rest))
            if path.is_file():
                return path
            first = first or folder
        if first is not None:
            why = f"{first / rest} is a folder, expected a file"
            for part in Path(rest).parts:  # the first missing part of the path, and the nearest name there
                if not (first / part).exists():
                    close = nearest(part, (entry.name for entry in first.iterdir())) if first.is_dir() else None
                    why = f"{first} has no `{part}`" + (f"; did you mean `{close}`?" if close else "")
                    break
                first = first / part
            raise bad_input("missing-file", f"`{reference}`: {why}", place)
        raise InputError(_no_package(f"`{reference}`: package `{name}`", name, roots, place))
    path = Path(unquote(reference.removeprefix("file://")) if reference.startswith("file://") else reference)
    # Not by `Path`, which raises its own errors for unknown users and impossible file names.
    path = from_folder(folder, os.path.expanduser(path))  # noqa: PTH111
    if not os.path.isfile(path):  # noqa: PTH113
        problem = missing_file(path)
        scheme, is_url, _ = reference.partition("://")
        if is_url and not reference.startswith("file://"):
            raise bad_input("missing-file", no_such(f"{scheme}://", "way to a file", ("package://", "file://")), place)
        where = f" ({path})" if len(str(path)) < LONGEST_PATH else ""
        raise bad_input("missing-file", f"`{reference}`: {problem.message}{where}", place)
    return path


def from_folder(folder: Path, name: str | Path) -> Path:
    """The path that a file in a folder means by a name, as short as it can be: links before a `..` are followed."""
    there = folder / name
    short = Path(os.path.normpath(there))
    if ".." not in there.parts or "\0" in str(there) or os.path.realpath(short) == os.path.realpath(there):
        return short
    return Path(os.path.realpath(there))


def resolve_mesh(roots: Sequence[Path], reference: str, urdf: Path) -> Path:
    """The mesh file that a URDF names, in folders such as `Robot.package_roots` or in the URDF's own package.

    `model://NAME/PATH` of Gazebo is looked up in the folders around the URDF and in GAZEBO_MODEL_PATH, then as
    `package://`. Raises as `resolve`.
    """
    if reference.startswith("model://"):
        stated = (os.environ.get(name, "") for name in ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH"))
        folders = [*urdf.parents[:4], *(Path(entry) for text in stated for entry in text.split(os.pathsep) if entry)]
        for there in (folder / unquote(reference.removeprefix("model://")) for folder in folders):
            if there.is_file():
                return there
        reference = reference.replace("model", "package", 1)
    own = package_around(urdf) if reference.startswith("package://") else None
    return resolve(reference, urdf.parent, (*([own] if own else ()), *roots), Place(urdf))


def _no_package(what: str, name: str, roots: Sequence[Path], place: Place | None) -> Problem:
    tried = ", ".join(str(root) for root in dict.fromkeys(roots)) or "none"
    known = {entry.name: entry for root in roots for entry in root.iterdir() if entry.is_dir()}
    known |= {found: folder for root in roots for found, folder in packages_below(root).items()}
    close = misspelt(name, known)
    if close is not None and known[close].parent.name in ("site-packages", "dist-packages"):  # most have no robots
        found = (path for pattern in ("*.urdf", "*.xacro") for path in known[close].rglob(pattern))
        close = close if next(found, None) else None
    hint = f"; did you mean `{close}`?" if close else ""
    mend = (
        f"pip install {_PIP_PACKAGES[name]}"
        if name in _PIP_PACKAGES
        else f"add the folder with `{name}` to `robot.package_roots` (`init --package-root`) or ROS_PACKAGE_PATH"
    )
    return Problem("missing-package", f"{what} not found{hint}; roots tried: {tried}", place, mend=mend)


def _folders_called(name: str, roots: Sequence[Path]) -> Iterator[Path]:
    """The folders of a package, first hit first; those that only have the name, and another in `package.xml`, last."""
    if not name or "/" in name or name in (".", ".."):
        return
    misnamed: list[Path] = []
    for root in roots:
        for folder in (root, root / name):
            if folder.name == name and folder.is_dir():
                if package_name(folder) in (None, name):
                    yield folder
                else:
                    misnamed.append(folder)
        found = packages_below(root).get(name)
        if found is not None and package_name(found) != name:  # moved since
            packages_below.cache_clear()
            found = packages_below(root).get(name)
        if found is not None:
            yield found
    yield from misnamed


@lru_cache(maxsize=256)
def packages_below(root: Path) -> Mapping[str, Path]:
    """The packages in a folder by the names in their `package.xml`, the nearest to the root first.

    Folders of Python packages and of the system are not looked through.
    """
    found: dict[str, Path] = {}
    level, looked = [root], 0
    python = root.name in ("site-packages", "dist-packages") or root.is_relative_to(sys.prefix)
    for _ in range(1 if python or root.parent == root else DEEPEST_PACKAGE + 1):
        below: list[Path] = []
        for folder in level:
            name = package_name(folder)
            if name is not None:
                found.setdefault(name, folder)
            elif looked < MOST_FOLDERS:
                names: list[str] = []
                with suppress(OSError), os.scandir(folder) as entries:
                    names = sorted(entry.name for entry in entries if entry.name[0] != "." and entry.is_dir())
                inside = [folder / name for name in names if name not in _NO_PACKAGES]
                looked += len(inside)
                below += inside
        level = below
    return MappingProxyType(found)
