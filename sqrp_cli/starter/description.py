"""A user's robot description: how a workspace refers to it, the files near it, and what MoveIt says of it.

A configuration of MoveIt is a package as its setup assistant writes it: `.setup_assistant` names URDF and SRDF,
`config/` (or `srdf/`) holds the SRDF, `joint_limits.yaml` and `kinematics.yaml`.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import field, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, nearest
from sqrp_cli.files.input_file import missing_file
from sqrp_cli.files.packages import (
    package_and_path,
    package_around,
    package_folder,
    package_name,
    package_roots,
    resolve,
)
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.xml_file import read_xml
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.moveit import MoveitLimits, SrdfModel, read_moveit_limits, read_srdf, with_position_limits
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot_xml import RobotSource
from sqrp_cli.robot.urdf import UrdfModel
from sqrp_cli.starter.by_name import is_known
from sqrp_cli.starter.layout import PREFIX, file_text

_SRDF_FOLDERS = (".", "srdf", "config", "../srdf", "../config")
"""Where the SRDF of a URDF is looked for, relative to its folder."""

ASSISTANT = ".setup_assistant"  # the file in which MoveIt's setup assistant notes what it made the configuration of
_FOLDERS = ("config", "srdf", "config/srdf", ".")  # where the files of a configuration are, in its folder

_WHAT_TO_NAME = "name the package that MoveIt's setup assistant wrote, such as my_arm_moveit_config"

_TIP_KEYS = ("tip_link", "tip_name", "tip_frame", "kinematics_solver_tip", "kinematics_solver_ik_link")
"""Keys by which solvers of `kinematics.yaml` name the link that they place."""


@dataclass(frozen=True)
class OwnRobot:
    """What a user names of an arm."""

    urdf: str | None = None
    """A path or `package://...`, also of a xacro; None for the one of which the configuration of MoveIt was made."""
    arguments: Mapping[str, str] = field(default_factory=dict)  # values of the xacro's arguments
    package_roots: tuple[Path, ...] = ()  # folders in which packages are looked up first
    moveit: Path | None = None  # the folder of a configuration of MoveIt; None for one that is found beside the URDF
    gripper: str | None = None  # the URDF of a gripper at its end; None for the hand that the arm has, or a suction cup


@dataclass(frozen=True, eq=False, kw_only=True)
class Description:
    """A robot description. Texts are as a workspace file has them."""

    urdf: UrdfModel
    urdf_text: str  # its file, with the arguments of a xacro
    srdf: SrdfModel | None
    srdf_text: str | None
    limits: MoveitLimits | None
    limits_file: str | None
    tip: str | None  # the link to which a tool is fixed, as MoveIt says; None to guess
    package_roots: tuple[str, ...]  # folders that it needs besides the known ones
    gripper: UrdfModel | None  # with `PREFIX` before the names of its links and joints
    gripper_text: str | None
    warnings: tuple[Problem, ...]  # about files that were found but cannot be used


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
        config = _moveit_beside(urdf, around, warnings)
    limits_file = None if config is None else config.joint_limits
    limits = None if limits_file is None else read_moveit_limits(limits_file)
    srdf, srdf_text = None, None
    if config is not None and config.srdf is not None:
        file, arguments = config.srdf.resolve(), dict(given)
        while srdf is None:  # with those of the URDF's arguments that it takes, too
            try:
                srdf = read_srdf(file, urdf, replace(source, arguments=arguments))
            except InputError as error:
                if error.problems[0].code != "xacro-argument" or not arguments:
                    raise
                strange = next((name for name in arguments if f"no argument `{name}`" in str(error)), None)
                arguments = {} if strange is None else {k: v for k, v in arguments.items() if k != strange}
        srdf_text = file_text(_named(file, folder), arguments)
    elif (beside := _srdf_beside(urdf, warnings)) is not None:
        srdf, srdf_text = beside[1], file_text(_named(beside[0], folder))
    roots, gripper, gripper_text = _missing_roots(urdf, robot.package_roots, around), None, None
    if robot.gripper is not None:
        file, given = _find(OwnRobot(robot.gripper, package_roots=robot.package_roots), None)
        gripper = read_urdf(file, replace(source, arguments=given)).prefixed(PREFIX)
        gripper_text = file_text(_named(file, folder), given)
    return Description(
        urdf=urdf if limits is None else with_position_limits(urdf, limits),
        urdf_text=file_text(_named(path, folder), given),
        srdf=srdf,
        srdf_text=srdf_text,
        limits=limits,
        limits_file=None if limits_file is None else _named(limits_file, folder),
        tip=None if config is None or srdf is None else _arm_tip(config, srdf, urdf),
        package_roots=tuple(os.path.relpath(root, folder.resolve()) for root in roots),
        gripper=gripper,
        gripper_text=gripper_text,
        warnings=tuple(warnings),
    )


def _find(robot: OwnRobot, config: MoveitConfig | None) -> tuple[Path, Mapping[str, str]]:
    """The URDF's file, and the arguments that it is read with."""
    roots = package_roots(robot.package_roots)
    if robot.urdf is not None:
        # `Path` would raise errors of its own for unknown users and for impossible names.
        named = os.path.expanduser(robot.urdf)  # noqa: PTH111
        if "://" not in robot.urdf and not os.path.isfile(named):  # noqa: PTH113
            problem = missing_file(Path(named))
            by_name = f"name the robot, not a file: `--robot {robot.urdf}`"
            raise InputError(replace(problem, mend=by_name) if is_known(robot.urdf) else problem)
        path = resolve(robot.urdf, Path.cwd(), roots, None).resolve()
        return path, {**(config.arguments if config is not None and config.names(path) else {}), **robot.arguments}
    assert config is not None  # noqa: S101 - a user names one of the two
    if config.urdf is None:
        message = "this configuration does not say which URDF it was made of (`.setup_assistant`)"
        raise bad_input("missing-key", message, Place(config.folder), mend="name it by `--urdf FILE`")
    roots = (*roots, *_around(config.folder.resolve() / "package.xml"))
    # Packages are configured from a URDF that is not kept: then the xacro beside it is meant.
    for name in (config.urdf, f"{config.urdf}.xacro", config.urdf.removesuffix(".urdf") + ".xacro"):
        with suppress(InputError):
            path = resolve(name, config.folder, roots, Place(config.folder)).resolve()
            return path, {**config.arguments, **robot.arguments}
    try:
        return resolve(config.urdf, config.folder, roots, Place(config.folder)), {}
    except InputError as error:
        mend = "name the folder that contains this package by `--package-root DIR`, or the file by `--urdf FILE`"
        raise InputError(*(replace(problem, mend=mend) for problem in error.problems)) from error


def _around(path: Path) -> tuple[Path, ...]:
    """Folders in which the packages beside a file's own one are: a checkout of repositories of one or more packages."""
    own = package_around(path) or path.parent
    return tuple(folder for folder in list(own.resolve().parents)[:2] if folder not in (folder.parent, Path.home()))


def _srdf_beside(urdf: UrdfModel, warnings: list[Problem]) -> tuple[Path, SrdfModel] | None:
    """The SRDF near a URDF with its file name or robot name; warnings: gets why no such file fits.

    Of several, as of one arm with several grippers, the one named as the URDF or its robot, else most like the URDF.
    """
    path, unfit = urdf.path, []
    for folder in dict.fromkeys((path.parent / name).resolve() for name in _SRDF_FOLDERS):
        alike = {file: SequenceMatcher(None, file.stem, path.stem).ratio() for file in folder.glob("*.srdf")}
        for file in sorted(alike, key=lambda one: (one.stem != path.stem, one.stem != urdf.name, -alike[one], one)):
            try:
                if file.stem == path.stem or read_xml(file, "robot").attributes.get("name") == urdf.name:
                    return file, read_srdf(file, urdf)
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
    references = [piece.shape[0] for piece in pieces if isinstance(piece.shape, tuple)]
    named = [package_and_path(name)[0] for name in references if name.startswith("package://")]
    own = package_around(urdf.path)
    known = ((own,) if own else ()) + package_roots()

    def folder_of(package: str, *roots: Path) -> Path | None:
        with suppress(InputError):
            return package_folder(package, roots, None)
        return None

    found: dict[Path, None] = {}
    for package in dict.fromkeys((*urdf.packages, *named)):
        if folder_of(package, *known) is not None:
            continue
        for root in (*stated, *urdf.path.parents[:8], *around):
            inside = folder_of(package, root)
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


@dataclass(frozen=True, eq=False)
class MoveitConfig:
    """The files of a configuration."""

    folder: Path
    srdf: Path | None
    joint_limits: Path | None
    kinematics: Path | None
    urdf: str | None
    """The URDF that it was made of, `package://...`, or the xacro in the configuration; None if it does not say."""
    arguments: Mapping[str, str]  # of that URDF, if it is a xacro

    def names(self, urdf: Path) -> bool:
        """Whether it was made of a file of this name."""
        return self.urdf is not None and self.urdf.endswith(f"/{urdf.name}")


def _read_hint(path: Path) -> SourceDocument | None:
    """A file that is only a hint: None if it is damaged. Raises InputError for one that says something else."""
    try:
        return read_yaml(path)
    except InputError as error:
        if error.problems[0].code == "not-a-mapping":
            raise
        return None


def find_moveit(folder: Path) -> MoveitConfig:
    """The configuration in a folder, or in the one above its `config`. Raises InputError if it is none."""
    if not folder.is_dir():
        others = [entry.name for entry in folder.parent.glob("*/")] if folder.parent.is_dir() else []
        close = nearest(folder.name, others)
        message = "no such folder" + (f"; did you mean `{close}`?" if close else "")
        raise bad_input("missing-folder", message, Place(folder), mend=_WHAT_TO_NAME)
    if folder.name in _FOLDERS and not (folder / ASSISTANT).is_file():
        folder = folder.parent
    # What `.setup_assistant` says: SRDF, URDF and its arguments, such as `--inorder robot_type:=xarm dof:=6`.
    document, key = _read_hint(folder / ASSISTANT), "moveit_setup_assistant_config"
    data: Any = (document.data.get(key) if document is not None else None) or {}
    if document is not None and not isinstance(data, dict):
        raise document.error("not-a-mapping", (key,), f"found `{str(data)[:60]}`, expected URDF, SRDF and CONFIG")
    noted = {key.lower(): value for key, value in data.items() if isinstance(value, dict)}
    described, stated = noted.get("urdf", {}), folder / str(noted.get("srdf", {}).get("relative_path") or "")
    package, path = described.get("package"), str(described.get("relative_path") or "").lstrip("/")
    text = str(described.get("xacro_args") or "")
    words = text.split()
    with suppress(ValueError):
        words = shlex.split(text)
    arguments = {pair[1]: pair[2] for word in words if (pair := re.fullmatch(r"(\w+):=(.*)", word))}
    files = [sorted((folder / place).glob(end)) for end in ("*.srdf", "*.srdf.xacro") for place in _FOLDERS]
    first = next(filter(None, files), [None])
    srdf = stated if stated.is_file() else next((file for file in first if file and "macro" not in file.name), first[0])
    own = [file for pattern in ("*.urdf", "*.urdf.xacro") for file in sorted((folder / "config").glob(pattern))]
    urdf = f"package://{package}/{path}" if package and path else str(own[0]) if own else None
    limits, kinematics = (
        next((folder / place / name for place in _FOLDERS if (folder / place / name).is_file()), None)
        for name in ("joint_limits.yaml", "kinematics.yaml")
    )
    if srdf is None and limits is None:
        inside = ", ".join(sorted(entry.name for entry in folder.iterdir())[:8])
        message = "this is no configuration of MoveIt: it has neither an SRDF nor joint_limits.yaml"
        raise bad_input("missing-file", f"{message}; it has {inside or 'nothing'}", Place(folder), mend=_WHAT_TO_NAME)
    return MoveitConfig(folder, srdf, limits, kinematics, urdf, arguments)


def _moveit_beside(urdf: UrdfModel, around: tuple[Path, ...], warnings: list[Problem]) -> MoveitConfig | None:
    """The configuration of a robot in the folders around its URDF; warnings: gets one where several fit as well.

    It names the URDF, or its SRDF a robot of the same name; where one names the URDF, those that do not are left out.
    """
    fitting = []
    for entry in (entry for folder in around if folder.is_dir() for entry in sorted(folder.iterdir())):
        if entry.is_dir() and ("moveit" in entry.name or (entry / ASSISTANT).is_file()):
            with suppress(InputError):
                config = find_moveit(entry)
                srdf = config.srdf
                if config.names(urdf.path) or (srdf and read_xml(srdf, "robot").attributes.get("name") == urdf.name):
                    fitting.append(config)
    best = [config for config in fitting if config.names(urdf.path)] or fitting
    if len({config.folder for config in best}) < 2:
        return best[0] if best else None
    message = f"several configurations of MoveIt are of this robot: {', '.join(str(one.folder) for one in best[:5])}"
    mend = f"choose one, such as `--moveit {best[0].folder}`"
    warnings.append(Problem("several-configs", message, Place(urdf.path), severity="warning", mend=mend))
    return None


def _arm_tip(config: MoveitConfig, srdf: SrdfModel, urdf: UrdfModel) -> str | None:
    """The link to which a tool is fixed: as solver, end effector or chain of the longest arm say.

    Arms are groups of one chain, those with a solver first, then by number of joints; no grippers and pairs of arms.
    """
    document = None if config.kinematics is None else _read_hint(config.kinematics)
    solvers: Any = {} if document is None else document.data
    for key in ("/**", "ros__parameters", "robot_description_kinematics"):
        solvers = solvers[key] if isinstance(solvers.get(key), dict) else solvers
    solvers = {group: entry for group, entry in solvers.items() if isinstance(entry, dict)}
    arms = [
        group
        for group, joints in srdf.groups.items()
        if joints
        and group not in srdf.grippers
        and {*joints} <= {joint.name for joint in urdf.chain(urdf.joints[joints[-1]].child)}
    ]
    for group in sorted(arms, key=lambda group: (group not in solvers, -len(srdf.groups[group]))):
        tips = [str(solvers[group][key]) for key in _TIP_KEYS if group in solvers and solvers[group].get(key)]
        named = (*tips[-1:], srdf.tool_links.get(group), srdf.tips.get(group))
        link = next((name for name in named if name in urdf.links), None)
        if link is not None:
            return link
    return None
