"""A user's robot description: how a workspace refers to it, and the files near it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import TypeVar

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.knowledge.robot.moveit_limits import MoveitLimits, read_moveit_limits, with_position_limits
from sqrp_cli.knowledge.robot.read_urdf import read_urdf
from sqrp_cli.knowledge.robot.robot_source import RobotSource
from sqrp_cli.knowledge.robot.srdf import SrdfModel, read_srdf
from sqrp_cli.knowledge.robot.urdf import MeshReference, UrdfModel
from sqrp_cli.knowledge.text.input_file import missing_file
from sqrp_cli.knowledge.text.packages import (
    package_and_path,
    package_around,
    package_folder,
    package_name,
    package_roots,
    resolve,
)
from sqrp_cli.knowledge.text.xml_file import read_xml
from sqrp_cli.starter.moveit_config import MoveitConfig, arm_tip, find_moveit, moveit_beside

_SRDF_FOLDERS = (".", "srdf", "config", "../srdf", "../config")
"""Where the SRDF of a URDF is looked for, relative to its folder."""

PACKAGE = "package://"

_Content = TypeVar("_Content")


@dataclass(frozen=True)
class OwnRobot:
    """What a user names of an arm."""

    urdf: str | None = None
    """A path or `package://...`, also of a xacro; None for the one of which the configuration of MoveIt was made."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Values of the xacro's arguments."""
    package_roots: tuple[Path, ...] = ()
    """Folders in which packages are looked up first."""
    moveit: Path | None = None
    """The folder of a configuration of MoveIt; None for one that is found beside the URDF."""


@dataclass(frozen=True)
class NamedFile:
    """A file as a workspace names it."""

    path: str
    """Relative to the workspace, or `package://...`."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Of a xacro."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Description:
    """A robot description."""

    urdf: UrdfModel
    reference: NamedFile
    srdf: NamedFile | None
    semantics: SrdfModel | None
    """The content of the SRDF."""
    limits: MoveitLimits | None
    """Those of MoveIt."""
    limits_file: str | None
    """Their file, as a workspace names it."""
    tip: str | None
    """The link to which a tool is fixed, as MoveIt says; None to guess."""
    package_roots: tuple[str, ...]
    """Folders that it needs besides the known ones, as a workspace names them."""
    warnings: tuple[Problem, ...]
    """About files that were found but cannot be used."""


def describe_robot(robot: OwnRobot, folder: Path) -> Description:
    """Read a robot description for a workspace in `folder`. Raises InputError for one that cannot be used."""
    config = None if robot.moveit is None else find_moveit(robot.moveit)
    path, given = _find(robot, config)
    around = _around(path) + (() if config is None else _around(config.folder / "package.xml"))
    roots = package_roots(robot.package_roots)
    source = RobotSource((*roots, path.parent), given, around)
    urdf = _read(path, source, named=robot.urdf)
    warnings: list[Problem] = []
    if config is None:
        config = moveit_beside(urdf, around, warnings)
    limits = None if config is None or config.joint_limits is None else read_moveit_limits(config.joint_limits)
    srdf, semantics = _semantics(config, urdf, source, warnings)
    return Description(
        urdf=urdf if limits is None else with_position_limits(urdf, limits),
        reference=NamedFile(_named(path, folder), given),
        srdf=None if srdf is None else replace(srdf, path=_named(Path(srdf.path), folder)),
        semantics=semantics,
        limits=limits,
        limits_file=None if config is None or config.joint_limits is None else _named(config.joint_limits, folder),
        tip=None if config is None else arm_tip(config, semantics, urdf),
        package_roots=tuple(
            os.path.relpath(root, folder.resolve()) for root in _missing_roots(urdf, robot.package_roots, around)
        ),
        warnings=tuple(warnings),
    )


def _read(path: Path, source: RobotSource, named: str | None) -> UrdfModel:
    """The URDF; problems are placed as it was named."""
    try:
        return read_urdf(path, source)
    except InputError as error:
        given = Path(os.path.expanduser(named or path))  # noqa: PTH111
        raise InputError(*(_placed_at(given, path, problem) for problem in error.problems)) from error


def _find(robot: OwnRobot, config: MoveitConfig | None) -> tuple[Path, Mapping[str, str]]:
    """The URDF's file, and the arguments that it is read with."""
    roots = package_roots(robot.package_roots)
    if robot.urdf is None:
        assert config is not None  # noqa: S101 - a user names one of the two
        if config.urdf is None:
            message = "this configuration does not say which URDF it was made of (`.setup_assistant`)"
            raise bad_input("missing-key", message, Place(config.folder), mend="name it by `--urdf FILE`")
        around = _around(config.folder.resolve() / "package.xml")
        try:
            path = _or_its_xacro(config.urdf, config.folder, (*roots, *around))
        except InputError as error:
            mend = "name the folder that contains this package by `--package-root DIR`, or the file by `--urdf FILE`"
            raise InputError(*(replace(problem, mend=mend) for problem in error.problems)) from error
        return path.resolve(), {**config.arguments, **robot.arguments}
    # `Path` would raise errors of its own for unknown users and for impossible names.
    named = os.path.expanduser(robot.urdf)  # noqa: PTH111
    if "://" not in robot.urdf and not os.path.isfile(named):  # noqa: PTH113
        raise InputError(missing_file(Path(named)))
    path = resolve(robot.urdf, Path.cwd(), roots, None).resolve()
    same = config is not None and config.urdf is not None and config.urdf.endswith(f"/{path.name}")
    return path, {**(config.arguments if config is not None and same else {}), **robot.arguments}


def _or_its_xacro(reference: str, folder: Path, roots: tuple[Path, ...]) -> Path:
    """The file of a reference, or the xacro beside it: packages are configured from a URDF that is not kept."""
    for other in (f"{reference}.xacro", reference.removesuffix(".urdf") + ".xacro"):
        try:
            return resolve(reference, folder, roots, Place(folder))
        except InputError:
            with suppress(InputError):
                return resolve(other, folder, roots, Place(folder))
    return resolve(reference, folder, roots, Place(folder))


def _around(path: Path) -> tuple[Path, ...]:
    """Folders in which the packages beside a file's own one are: a checkout of repositories of one or more packages."""
    own = package_around(path) or path.parent
    return tuple(folder for folder in list(own.resolve().parents)[:2] if folder not in (folder.parent, Path.home()))


def _semantics(
    config: MoveitConfig | None, urdf: UrdfModel, source: RobotSource, warnings: list[Problem]
) -> tuple[NamedFile | None, SrdfModel | None]:
    """The SRDF of the configuration, else the one beside the URDF; warnings: gets why one does not fit."""
    if config is not None and config.srdf is not None:
        file = config.srdf.resolve()
        srdf, arguments = _with_accepted(source, lambda accepted: read_srdf(file, urdf, accepted))
        return NamedFile(str(file), arguments), srdf
    beside, found = _srdf_beside(urdf.path, urdf)
    warnings += found
    return (None, None) if beside is None else (NamedFile(str(beside)), read_srdf(beside, urdf))


def _with_accepted(source: RobotSource, read: Callable[[RobotSource], _Content]) -> tuple[_Content, Mapping[str, str]]:
    """What is read with those of the URDF's arguments that this file takes, too; and these arguments."""
    arguments = dict(source.arguments)
    while True:
        try:
            return read(replace(source, arguments=arguments)), arguments
        except InputError as error:
            strange = next((name for name in arguments if f"no argument `{name}`" in str(error)), None)
            if error.problems[0].code != "xacro-argument" or not arguments:
                raise
            arguments = {} if strange is None else {k: v for k, v in arguments.items() if k != strange}


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


def _missing_roots(urdf: UrdfModel, stated: tuple[Path, ...], around: tuple[Path, ...]) -> Iterator[Path]:
    """Folders with packages of the URDF, its xacro and its meshes that a workspace would find nowhere else."""
    pieces = [piece for link in urdf.links.values() for piece in (*link.collision, *link.visual)]
    references = [piece.shape.reference for piece in pieces if isinstance(piece.shape, MeshReference)]
    named = [package_and_path(name)[0] for name in references if name.startswith(PACKAGE)]
    own = package_around(urdf.path)
    known = ((own,) if own else ()) + package_roots()
    found: dict[Path, None] = {}
    for package in dict.fromkeys((*urdf.packages, *named)):
        if _has(package, known):
            continue
        for root in (*stated, *urdf.path.parents[:8], *around):
            if (root / package).is_dir() or _has(package, (root,)):
                found[root.resolve() if root in stated else _root_of(package, root)] = None
                break
    yield from found


def _has(package: str, roots: tuple[Path, ...]) -> bool:
    try:
        package_folder(package, roots, None)
    except InputError:
        return False
    return True


def _root_of(package: str, root: Path) -> Path:
    """The folder that names a package: the one around it if that has the package's name, else the package itself."""
    folder = package_folder(package, (root,), None)
    return folder.parent if folder.name == package or package_name(folder) is None else folder


def _srdf_beside(path: Path, urdf: UrdfModel) -> tuple[Path | None, list[Problem]]:
    """The SRDF near a URDF with its file name or robot name, and why other such files do not fit.

    Of several, as of one arm with several grippers, the one named as the URDF or its robot, else most like the URDF.
    """
    warnings: list[Problem] = []

    def unlike(file: Path) -> tuple[bool, bool, float, Path]:
        alike = SequenceMatcher(None, file.stem, path.stem).ratio()
        return file.stem != path.stem, file.stem != urdf.name, -alike, file

    for folder in dict.fromkeys((path.parent / name).resolve() for name in _SRDF_FOLDERS):
        for file in sorted(folder.glob("*.srdf"), key=unlike) if folder.is_dir() else ():
            try:
                if file.stem == path.stem or read_xml(file, "robot").attributes.get("name") == urdf.name:
                    read_srdf(file, urdf)
                    return file, []
            except InputError as error:
                why = error.problems[0]
                message = f"{why.message}; so this SRDF was left out"
                warnings.append(Problem(why.code, message, why.place, severity="warning"))
    return None, warnings
