"""A user's robot description: how a workspace refers to it, the files near it, and what MoveIt says of it.

A configuration of MoveIt is a package as its setup assistant writes it: `.setup_assistant` names URDF and SRDF,
`config/` (or `srdf/`) holds the SRDF, `joint_limits.yaml` and `kinematics.yaml`.
"""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from difflib import SequenceMatcher
from itertools import product
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem, bad_input, first_names, misspelt
from sqrp_cli.files import packages
from sqrp_cli.files.input_file import missing_file, read_input
from sqrp_cli.files.source import SourceDocument, describe
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.moveit import MoveitLimits, SrdfModel, read_moveit_limits, read_srdf, with_position_limits
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot_xml import RobotSource, named_robot
from sqrp_cli.robot.urdf import UrdfModel
from sqrp_cli.starter.by_name import ROBOTS, ROS_ROBOTS

_SRDF_FOLDERS = (".", "srdf", "config", "../srdf", "../config")
"""Where the SRDF of a URDF is looked for, relative to its folder."""
ASSISTANT = ".setup_assistant"  # the file in which MoveIt's setup assistant notes what it made the configuration of
_ENDS = (".urdf", ".urdf.xacro", ".xacro")  # of URDFs
_FOLDERS = ("config", "srdf", "config/srdf", ".")  # where the files of a configuration are, in its folder
_WHAT_TO_NAME = "name the package that MoveIt's setup assistant wrote, such as my_arm_moveit_config"
_TIP_KEYS = ("tip_link", "tip_name", "tip_frame", "kinematics_solver_tip", "kinematics_solver_ik_link")
"""Keys by which solvers of `kinematics.yaml` name the link that they place."""
PREFIX = "gripper_"  # before the names of a gripper's links and joints, which are often those of the robot


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
    source = RobotSource((*packages.package_roots(robot.package_roots), path.parent), given, around)
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
    files = () if config is None else config.srdfs
    found = _srdf_of(urdf, files, source, warnings)
    srdf_file, srdf, given_too = found or (None, None, {})
    # Limits of another robot are not taken either: mostly its joints have the same names.
    limits_file = config.file("joint_limits.yaml", urdf.name, srdf_file) if config and (srdf or not files) else None
    limits = None if limits_file is None else read_moveit_limits(limits_file)
    roots, gripper, gripper_text = _missing_roots(urdf, robot.package_roots, around), None, None
    if robot.gripper is not None:
        file, given = _find(OwnRobot(robot.gripper, package_roots=robot.package_roots), None)
        gripper = read_urdf(file, replace(source, arguments=given)).prefixed(PREFIX)
        gripper_text = file_text(_named(file, folder), given)
    return Description(
        urdf=urdf if limits is None else with_position_limits(urdf, limits),
        urdf_text=file_text(_named(path, folder), given),
        srdf=srdf,
        srdf_text=None if srdf_file is None else file_text(_named(srdf_file.resolve(), folder), given_too),
        limits=limits,
        limits_file=None if limits_file is None else _named(limits_file, folder),
        tip=_arm_tip(config.file("kinematics.yaml", urdf.name, srdf_file), srdf, urdf) if config and srdf else None,
        package_roots=tuple(os.path.relpath(root, folder.resolve()) for root in roots),
        gripper=gripper,
        gripper_text=gripper_text,
        warnings=tuple(warnings),
    )


def _find(robot: OwnRobot, config: MoveitConfig | None) -> tuple[Path, Mapping[str, str]]:
    """The URDF's file, and the arguments that it is read with."""
    roots = packages.package_roots(robot.package_roots)
    if robot.urdf is not None:
        # `Path` would raise errors of its own for unknown users and for impossible names.
        named = os.path.expanduser(robot.urdf)  # noqa: PTH111
        if "://" not in robot.urdf and not os.path.isfile(named):  # noqa: PTH113
            problem = missing_file(Path(named))
            by_name = f"name the robot, not a file: `--robot {robot.urdf}`"
            known = robot.urdf.lower() in {*ROBOTS, *ROS_ROBOTS}
            raise InputError(replace(problem, mend=by_name) if known else problem)
        path = packages.resolve(robot.urdf, Path.cwd(), roots, None).resolve()
        return path, {**(config.arguments if config is not None and config.names(path) else {}), **robot.arguments}
    assert config is not None  # noqa: S101 - a user names one of the two
    place, roots = Place(config.folder), (*roots, *_around(config.folder.resolve() / packages.MANIFEST))
    if config.own:  # as MoveIt 2 does
        return config.own[0], robot.arguments
    problems, stated = list[Problem](), config.urdf or ""
    # Packages are configured from a URDF that is not kept: then the xacro beside it is meant.
    for name in (stated, f"{stated}.xacro", stated.removesuffix(".urdf") + ".xacro") if stated else ():
        try:
            path = packages.resolve(name, config.folder, roots, place).resolve()
            return path, {**config.arguments, **robot.arguments}
        except InputError as error:
            problems += error.problems
    fitting = _descriptions(config, roots, robot.arguments)
    names = [*dict.fromkeys(name for name, _, _ in fitting)]
    if len(names) == 1:
        return fitting[0][1:]
    mend = "name it by `--urdf FILE`, or the folder with its package by `--package-root DIR`"
    if names:
        message = f"this configuration is of several robots: {first_names(names)}"
        problems, mend = [], f"name the one by `--urdf FILE`, such as {fitting[0][1]}"
    else:
        message = "this configuration does not say which URDF it was made of (`.setup_assistant`), and none of its "
        message += "robot is in its package, in those that its package.xml needs, or in those beside it"
    raise InputError(replace([*problems, Problem("missing-key", message, place)][0], mend=mend))


def _around(path: Path) -> tuple[Path, ...]:
    """Folders in which the packages beside a file's own one are: a checkout of repositories of one or more packages."""
    own = packages.package_around(path) or path.parent
    return tuple(folder for folder in list(own.resolve().parents)[:2] if folder not in (folder.parent, Path.home()))


def _descriptions(
    config: MoveitConfig, roots: Sequence[Path], arguments: Mapping[str, str]
) -> Sequence[tuple[str, Path, Mapping[str, str]]]:
    """URDFs of the robots that a configuration is of, with their names before and arguments after them; the best named.

    They are looked for in its package and those that it needs, then in those beside it. Named best is as the URDF that
    the configuration states, then as the SRDF, then as the robot.
    """
    package = packages.package_around(config.folder.resolve() / packages.MANIFEST) or config.folder.resolve()
    beside = package.parent if package.parent not in (Path.home(), Path("/")) else package
    for folders in ((package, *packages.needed_packages(package, roots)), packages.packages_below(beside).values()):
        found = []
        for file in (file for folder in folders for file in sorted(folder.rglob("*"))):
            kind = next((kind for kind, end in enumerate(_ENDS) if file.name.endswith(end)), None)
            if kind is None or ".srdf" in file.name or file.parent.name == "srdf":
                continue
            with suppress(InputError):  # a piece of a description, or a damaged one
                name, given = named_robot(file, arguments)
                fits = [one for one in config.srdfs if named_robot(one, arguments, name)[0] == name != ""]
                stem, stems = file.name.removesuffix(_ENDS[kind]), [one.name.split(".srdf")[0] for one in fits]
                named = file.name == Path(config.urdf or "").name, stem in stems, stem == name
                found += [(named, -kind, name, file, given)] if fits else []
        if found:
            found.sort(key=lambda one: one[:2], reverse=True)
            return [best[2:] for best in found if best[0] == found[0][0]]
    return []


def _srdf_of(
    urdf: UrdfModel, stated: Sequence[Path], source: RobotSource, warnings: list[Problem]
) -> tuple[Path, SrdfModel, Mapping[str, str]] | None:
    """The first SRDF whose robot has the URDF's name, and its arguments: those of the URDF's that it takes, too.

    stated: by a configuration of MoveIt; without any, those near the URDF: then others are usual, and what cannot be
    read is left out. Else that is refused, unless one fits. warnings: gets a sentence where it is none.
    """
    path, files = urdf.path, [*stated]
    # In each folder those named as the URDF or its robot first, else most like the URDF.
    for folder in dict.fromkeys((path.parent / name).resolve() for name in _SRDF_FOLDERS) if not stated else ():
        alike = {file: SequenceMatcher(None, file.stem, path.stem).ratio() for file in folder.glob("*.srdf")}
        files += sorted(alike, key=lambda one: (one.stem != path.stem, one.stem != urdf.name, -alike[one], one))
    others, unfit = dict[str, Path](), list[InputError]()
    for file in files:
        try:
            name, arguments = named_robot(file, source.arguments, urdf.name)
            if name == urdf.name:
                takes = re.findall(r"\$\(arg (\w+)|xacro:arg [^>]*?name=.(\w+)", file.read_text("utf-8", "replace"))
                arguments = {key: value for key, value in arguments.items() if any(key in names for names in takes)}
                return file, read_srdf(file, urdf, replace(source, arguments=arguments)), arguments
            if name and (stated or file.stem == path.stem):
                others.setdefault(name, file)
        except InputError as error:
            unfit.append(error)
    if unfit and stated:
        raise unfit[0]
    for why in (error.problems[0] for error in unfit):
        message = f"{why.message}; so this SRDF was left out"
        warnings.append(Problem(why.code, message, why.place, severity="warning"))
    if others:
        message = f"the URDF is of robot `{urdf.name}`, and the SRDF of {first_names([*others])}; so no SRDF is taken"
        mend = "name the URDF or SRDF of this robot; if it is this one, write the same name in both `<robot name>`"
        place = Place(next(iter(others.values())))
        warnings.append(Problem("srdf-of-another-robot", message, place, severity="warning", mend=mend))
    return None


def file_text(path: str, arguments: Mapping[str, str] | None = None) -> str:
    """A file, with the arguments of a xacro, as YAML."""
    if not arguments:
        return text_in_yaml(path)
    pairs = ", ".join(f"{text_in_yaml(name)}: {json.dumps(value)}" for name, value in arguments.items())
    return f"{{xacro: {text_in_yaml(path)}, args: {{{pairs}}}}}"


def text_in_yaml(value: str) -> str:
    """Text as YAML, in quotes where it would be ambiguous."""
    plain = value[:1].isalpha() or value.startswith(("../", "./", "/"))
    harmless = all(character.isalnum() or character in "/._-:" for character in value) and not value.endswith(":")
    words = {"true", "false", "null"}
    return value if plain and harmless and value.lower() not in words else json.dumps(value, ensure_ascii=False)


def _named(path: Path, folder: Path) -> str:
    """How a workspace in `folder` names a file: `package://` where a known package holds it, else a relative path."""
    roots = packages.package_roots()
    for root in roots:
        if root in path.parents:
            package, *rest = path.relative_to(root).parts
            reference = f"package://{package}/{'/'.join(rest)}"
            with suppress(InputError):
                if rest and packages.resolve(reference, Path.cwd(), roots, Place(Path.cwd())).resolve() == path:
                    return reference
    return os.path.relpath(path, folder.resolve())


def _missing_roots(urdf: UrdfModel, stated: tuple[Path, ...], around: tuple[Path, ...]) -> list[Path]:
    """Folders with packages of the URDF, its xacro and its meshes that a workspace would find nowhere else."""
    pieces = [piece for link in urdf.links.values() for piece in (*link.collision, *link.visual)]
    references = [piece.shape[0] for piece in pieces if isinstance(piece.shape, tuple)]
    named = [packages.package_and_path(name)[0] for name in references if name.startswith("package://")]
    own = packages.package_around(urdf.path)
    known = ((own,) if own else ()) + packages.package_roots()

    def folder_of(package: str, *roots: Path) -> Path | None:
        with suppress(InputError):
            return packages.package_folder(package, roots, None)
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
                inside = inside or packages.package_folder(package, (root,), None)
                around_it = inside.name == package or packages.package_name(inside) is None
                found[inside.parent if around_it else inside] = None
            break
    return [*found]


@dataclass(frozen=True, eq=False)
class MoveitConfig:
    """The files of a configuration."""

    folder: Path
    srdfs: Sequence[Path]  # the one that it states first
    urdf: str | None  # the URDF that it was made of, `package://...`; None if it does not say
    arguments: Mapping[str, str]  # of that URDF, if it is a xacro
    own: Sequence[Path]  # the xacros of URDFs in it, the one named as an SRDF first

    def names(self, urdf: Path) -> bool:
        """Whether it was made of a file of this name."""
        return self.urdf is not None and self.urdf.endswith(f"/{urdf.name}")

    def file(self, name: str, robot: str = "", srdf: Path | None = None) -> Path | None:
        """One of its files: that of a robot, beside its SRDF or in `config/ROBOT`, else where it usually is."""
        folders = [self.folder / place for place in (f"config/{robot}", *_FOLDERS)]
        return next((one / name for one in ([srdf.parent] if srdf else []) + folders if (one / name).is_file()), None)


def _read_hint(path: Path | None) -> SourceDocument | None:
    """A YAML file of a configuration, None if there is none. Raises InputError for a damaged one."""
    return parse_yaml(path, read_input(path, MAX_BYTES), repeats=True) if path and path.is_file() else None


def _noted(document: SourceDocument | None, *keys: str) -> str:
    """A text in a file, under keys that may have capitals; "" if it has none. Raises InputError for other values."""
    at, value = tuple[str, ...](), None if document is None else document.data
    for key in keys:
        if document is not None and not isinstance(value, dict | None):
            raise document.error("not-a-mapping", at, f"found {describe(value)}, expected a mapping")
        at = (*at, next((one for one in value or () if one.lower() == key), key))
        value = (value or {}).get(at[-1])
    if document is not None and not isinstance(value, str | None):
        raise document.error("wrong-type", at, f"found {describe(value)}, expected text")
    return str(value or "")


def find_moveit(folder: Path) -> MoveitConfig:
    """The configuration in a folder, or in the one above its `config`. Raises InputError if it is none."""
    if not folder.is_dir():
        others = [entry.name for entry in folder.parent.glob("*/")] if folder.parent.is_dir() else []
        close = misspelt(folder.name, others)
        message = "no such folder" + (f"; did you mean `{close}`?" if close else "")
        raise bad_input("missing-folder", message, Place(folder), mend=_WHAT_TO_NAME)
    if folder.name in _FOLDERS and not (folder / ASSISTANT).is_file():
        folder = folder.parent
    # What `.setup_assistant` says: SRDF, URDF and its arguments, such as `--inorder robot_type:=xarm dof:=6`.
    document, top = _read_hint(folder / ASSISTANT), "moveit_setup_assistant_config"
    package, path, text = (_noted(document, top, "urdf", key) for key in ("package", "relative_path", "xacro_args"))
    words, path = text.split(), path.lstrip("/")
    with suppress(ValueError):
        words = shlex.split(text)
    arguments = {pair[1]: pair[2] for word in words if (pair := re.fullmatch(r"(\w+):=(.*)", word))}
    stated = folder / _noted(document, top, "srdf", "relative_path")
    found = {stated: None} if stated.is_file() else {}
    for end, place in product(("*.srdf", "*.srdf.xacro"), (*_FOLDERS, "config/*", "srdf/*")):
        found |= dict.fromkeys(sorted(folder.glob(f"{place}/{end}")))
    stems = [file.name.split(".srdf")[0] for file in found]
    own = sorted((folder / "config").glob("*.urdf.xacro"), key=lambda one: one.name.split(".urdf")[0] not in stems)
    config = MoveitConfig(folder, [*found], f"package://{package}/{path}" if package and path else None, arguments, own)
    if not found and config.file("joint_limits.yaml") is None:
        inside = ", ".join(sorted(entry.name for entry in folder.iterdir())[:8])
        message = "this is no configuration of MoveIt: it has neither an SRDF nor joint_limits.yaml"
        raise bad_input("missing-file", f"{message}; it has {inside or 'nothing'}", Place(folder), mend=_WHAT_TO_NAME)
    return config


def _moveit_beside(urdf: UrdfModel, around: tuple[Path, ...], warnings: list[Problem]) -> MoveitConfig | None:
    """The configuration in folders around a URDF that names it or its robot; warnings: gets one where several do."""
    fitting = []
    for entry in (entry for folder in around if folder.is_dir() for entry in sorted(folder.iterdir())):
        if entry.is_dir() and ("moveit" in entry.name or (entry / ASSISTANT).is_file()):
            with suppress(InputError):
                config = find_moveit(entry)
                if config.names(urdf.path) or urdf.name in (named_robot(one, {})[0] for one in config.srdfs):
                    fitting.append(config)
    best = [config for config in fitting if config.names(urdf.path)] or fitting
    if len({config.folder for config in best}) < 2:
        return best[0] if best else None
    message = f"several configurations of MoveIt are of this robot: {', '.join(str(one.folder) for one in best[:5])}"
    mend = f"choose one, such as `--moveit {best[0].folder}`"
    warnings.append(Problem("several-configs", message, Place(urdf.path), severity="warning", mend=mend))
    return None


def _arm_tip(kinematics: Path | None, srdf: SrdfModel, urdf: UrdfModel) -> str | None:
    """The link to which a tool is fixed: as solver, end effector or chain of the longest arm say."""
    document, at, tips = _read_hint(kinematics), tuple[str, ...](), dict[str, list[str]]()
    if document is not None:
        for key in ("/**", "ros__parameters", "robot_description_kinematics"):
            at = (*at, key) if isinstance(document.at((*at, key)), dict) else at
        tips = {group: [_noted(document, *at, group, key) for key in _TIP_KEYS] for group in document.at(at)}
    arms = [
        group
        for group, joints in srdf.groups.items()
        if joints
        and group not in srdf.grippers
        and {*joints} <= {joint.name for joint in urdf.chain(urdf.joints[joints[-1]].child)}
    ]
    for group in sorted(arms, key=lambda group: (group not in tips, -len(srdf.groups[group]))):
        named = (*reversed(tips.get(group, [])), srdf.tool_links.get(group), srdf.tips.get(group))
        link = next((name for name in named if name in urdf.links), None)
        if link is not None:
            return link
    return None
