"""A user's robot description: how a workspace refers to it, and the files near it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import field, replace
from difflib import SequenceMatcher
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files.input_file import missing_file
from sqrp_cli.files.packages import (
    package_and_path,
    package_around,
    package_folder,
    package_name,
    package_roots,
    resolve,
)
from sqrp_cli.files.xml_file import read_xml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.moveit_limits import MoveitLimits, read_moveit_limits, with_position_limits
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot_xml import RobotSource
from sqrp_cli.robot.srdf import SrdfModel, read_srdf
from sqrp_cli.robot.urdf import MeshReference, UrdfModel
from sqrp_cli.starter.moveit_config import MoveitConfig, arm_tip, find_moveit, moveit_beside

_SRDF_FOLDERS = (".", "srdf", "config", "../srdf", "../config")
"""Where the SRDF of a URDF is looked for, relative to its folder."""

PACKAGE = "package://"


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
    """A file as a workspace names it: relative to the workspace, or `package://...`; with the arguments of a xacro."""

    path: str
    arguments: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Description:
    """A robot description.

    semantics: the content of the SRDF. limits: those of MoveIt; limits_file: their file, as a workspace names it.
    tip: the link to which a tool is fixed, as MoveIt says; None to guess.
    package_roots: folders that it needs besides the known ones, as a workspace names them.
    warnings: about files that were found but cannot be used.
    """

    urdf: UrdfModel
    reference: NamedFile
    srdf: NamedFile | None
    semantics: SrdfModel | None
    limits: MoveitLimits | None
    limits_file: str | None
    tip: str | None
    package_roots: tuple[str, ...]
    warnings: tuple[Problem, ...]


def describe_robot(robot: OwnRobot, folder: Path) -> Description:
    """Read a robot description for a workspace in `folder`. Raises InputError for one that cannot be used."""
    config = None if robot.moveit is None else find_moveit(robot.moveit)
    path, given = _find(robot, config)
    around = _around(path) + (() if config is None else _around(config.folder / "package.xml"))
    source = RobotSource((*package_roots(robot.package_roots), path.parent), given, around)
    try:
        urdf = read_urdf(path, source)
    except InputError as error:  # placed at the file as it was named
        given_as = Path(os.path.expanduser(robot.urdf or path))  # noqa: PTH111
        placed = [
            replace(one, place=replace(one.place, file=given_as)) if one.place and one.place.file == path else one
            for one in error.problems
        ]
        raise InputError(*placed) from error
    warnings: list[Problem] = []
    if config is None:
        config = moveit_beside(urdf, around, warnings)
    limits_file = None if config is None else config.joint_limits
    limits = None if limits_file is None else read_moveit_limits(limits_file)
    named = None if config is None or config.srdf is None else config.srdf.resolve()
    found = _srdf_beside(urdf, warnings) if named is None else _configured_srdf(named, urdf, source)
    srdf, semantics = found or (None, None)
    return Description(
        urdf=urdf if limits is None else with_position_limits(urdf, limits),
        reference=NamedFile(_named(path, folder), given),
        srdf=None if srdf is None else replace(srdf, path=_named(Path(srdf.path), folder)),
        semantics=semantics,
        limits=limits,
        limits_file=None if limits_file is None else _named(limits_file, folder),
        tip=None if config is None else arm_tip(config, semantics, urdf),
        package_roots=tuple(
            os.path.relpath(root, folder.resolve()) for root in _missing_roots(urdf, robot.package_roots, around)
        ),
        warnings=tuple(warnings),
    )


def _find(robot: OwnRobot, config: MoveitConfig | None) -> tuple[Path, Mapping[str, str]]:
    """The URDF's file, and the arguments that it is read with."""
    roots = package_roots(robot.package_roots)
    arguments = {} if config is None else config.arguments
    if robot.urdf is not None:
        # `Path` would raise errors of its own for unknown users and for impossible names.
        named = os.path.expanduser(robot.urdf)  # noqa: PTH111
        if "://" not in robot.urdf and not os.path.isfile(named):  # noqa: PTH113
            raise InputError(missing_file(Path(named)))
        path = resolve(robot.urdf, Path.cwd(), roots, None).resolve()
        same = config is not None and config.urdf is not None and config.urdf.endswith(f"/{path.name}")
        return path, {**(arguments if same else {}), **robot.arguments}
    assert config is not None  # noqa: S101 - a user names one of the two
    if config.urdf is None:
        message = "this configuration does not say which URDF it was made of (`.setup_assistant`)"
        raise bad_input("missing-key", message, Place(config.folder), mend="name it by `--urdf FILE`")
    roots = (*roots, *_around(config.folder.resolve() / "package.xml"))
    # Packages are configured from a URDF that is not kept: then the xacro beside it is meant.
    for name in (config.urdf, f"{config.urdf}.xacro", config.urdf.removesuffix(".urdf") + ".xacro"):
        with suppress(InputError):
            return resolve(name, config.folder, roots, Place(config.folder)).resolve(), {**arguments, **robot.arguments}
    try:
        return resolve(config.urdf, config.folder, roots, Place(config.folder)), {}
    except InputError as error:
        mend = "name the folder that contains this package by `--package-root DIR`, or the file by `--urdf FILE`"
        raise InputError(*(replace(problem, mend=mend) for problem in error.problems)) from error


def _around(path: Path) -> tuple[Path, ...]:
    """Folders in which the packages beside a file's own one are: a checkout of repositories of one or more packages."""
    own = package_around(path) or path.parent
    return tuple(folder for folder in list(own.resolve().parents)[:2] if folder not in (folder.parent, Path.home()))


def _configured_srdf(file: Path, urdf: UrdfModel, source: RobotSource) -> tuple[NamedFile, SrdfModel]:
    """The SRDF of a configuration, with those of the URDF's arguments that it takes, too."""
    arguments = dict(source.arguments)
    while True:
        try:
            srdf = read_srdf(file, urdf, replace(source, arguments=arguments))
            return NamedFile(str(file), arguments), srdf
        except InputError as error:
            strange = next((name for name in arguments if f"no argument `{name}`" in str(error)), None)
            if error.problems[0].code != "xacro-argument" or not arguments:
                raise
            arguments = {} if strange is None else {k: v for k, v in arguments.items() if k != strange}


def _srdf_beside(urdf: UrdfModel, warnings: list[Problem]) -> tuple[NamedFile, SrdfModel] | None:
    """The SRDF near a URDF with its file name or robot name; warnings: gets why no such file fits.

    Of several, as of one arm with several grippers, the one named as the URDF or its robot, else most like the URDF.
    """
    path = urdf.path
    unfit = []

    def unlike(file: Path) -> tuple[bool, bool, float, Path]:
        same = SequenceMatcher(None, file.stem, path.stem).ratio()
        return file.stem != path.stem, file.stem != urdf.name, -same, file

    for folder in dict.fromkeys((path.parent / name).resolve() for name in _SRDF_FOLDERS):
        for file in sorted(folder.glob("*.srdf"), key=unlike) if folder.is_dir() else ():
            try:
                if file.stem == path.stem or read_xml(file, "robot").attributes.get("name") == urdf.name:
                    return NamedFile(str(file)), read_srdf(file, urdf)
            except InputError as error:
                why = error.problems[0]
                message = f"{why.message}; so this SRDF was left out"
                unfit.append(Problem(why.code, message, why.place, severity="warning"))
    warnings += unfit
    return None


def _named(path: Path, folder: Path) -> str:
    """How a workspace in `folder` names a file: `package://` where a known package holds it, else a relative path."""
    roots = package_roots()
    for root in roots:
        if root in path.parents:
            package, *rest = path.relative_to(root).parts
            reference = f"package://{package}/{'/'.join(rest)}"
            with suppress(InputError):
                if rest and resolve(reference, Path.cwd(), roots, Place(Path.cwd())).resolve() == path:
                    return reference
    return os.path.relpath(path, folder.resolve())


def _missing_roots(urdf: UrdfModel, stated: tuple[Path, ...], around: tuple[Path, ...]) -> list[Path]:
    """Folders with packages of the URDF, its xacro and its meshes that a workspace would find nowhere else."""
    pieces = [piece for link in urdf.links.values() for piece in (*link.collision, *link.visual)]
    references = [piece.shape.reference for piece in pieces if isinstance(piece.shape, MeshReference)]
    named = [package_and_path(name)[0] for name in references if name.startswith("package://")]
    own = package_around(urdf.path)
    known = ((own,) if own else ()) + package_roots()
    found: dict[Path, None] = {}
    for package in dict.fromkeys((*urdf.packages, *named)):
        if _folder(package, known) is not None:
            continue
        for root in (*stated, *urdf.path.parents[:8], *around):
            inside = _folder(package, (root,))
            if inside is None and not (root / package).is_dir():
                continue
            if root in stated:
                found[root.resolve()] = None
            else:  # the folder around it if that has the package's name, else the package itself
                inside = inside or package_folder(package, (root,), None)
                around_it = inside.name == package or package_name(inside) is None
                found[inside.parent if around_it else inside] = None
            break
    return [*found]


def _folder(package: str, roots: tuple[Path, ...]) -> Path | None:
    with suppress(InputError):
        return package_folder(package, roots, None)
    return None
