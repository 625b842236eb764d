"""Configurations of MoveIt: which files they have, and what these say about the arm.

A configuration is a package as MoveIt's setup assistant writes it: `.setup_assistant` names URDF and SRDF, `config/`
(or `srdf/`) holds the SRDF, `joint_limits.yaml` and `kinematics.yaml`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, nearest
from sqrp_cli.knowledge.robot.srdf import SrdfModel
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.knowledge.text.xml_file import read_xml
from sqrp_cli.knowledge.text.yaml_file import read_yaml

ASSISTANT = ".setup_assistant"
"""The file in which MoveIt's setup assistant notes what it made the configuration of."""

_FOLDERS = ("config", "srdf", "config/srdf", ".")
"""Where the files of a configuration are, in its folder."""

_WHAT_TO_NAME = "name the package that MoveIt's setup assistant wrote, such as my_arm_moveit_config"

_TIP_KEYS = ("tip_link", "tip_name", "tip_frame", "kinematics_solver_tip", "kinematics_solver_ik_link")
"""Keys by which solvers of `kinematics.yaml` name the link that they place."""


@dataclass(frozen=True, eq=False)
class MoveitConfig:
    """The files of a configuration."""

    folder: Path
    srdf: Path | None
    joint_limits: Path | None
    kinematics: Path | None
    urdf: str | None
    """The URDF that it was made of, `package://...`, or the xacro in the configuration; None if it does not say."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Arguments of that URDF, if it is a xacro."""


def find_moveit(folder: Path) -> MoveitConfig:
    """The configuration in a folder, or in the one above its `config`. Raises InputError if it is none."""
    if not folder.is_dir():
        close = (
            nearest(folder.name, [entry.name for entry in folder.parent.glob("*/")]) if folder.parent.is_dir() else None
        )
        message = "no such folder" + (f"; did you mean `{close}`?" if close else "")
        raise bad_input("missing-folder", message, Place(folder), mend=_WHAT_TO_NAME)
    if folder.name in _FOLDERS and not (folder / ASSISTANT).is_file():
        folder = folder.parent
    noted = _noted(folder)
    config = MoveitConfig(
        folder=folder,
        srdf=_srdf(folder, noted),
        joint_limits=_file(folder, "joint_limits.yaml"),
        kinematics=_file(folder, "kinematics.yaml"),
        urdf=_urdf(folder, noted),
        arguments=_arguments(noted),
    )
    if config.srdf is None and config.joint_limits is None:
        inside = sorted(entry.name for entry in folder.iterdir())[:8]
        message = "this is no configuration of MoveIt: it has neither an SRDF nor joint_limits.yaml"
        message += f"; it has {', '.join(inside) or 'nothing'}"
        raise bad_input("missing-file", message, Place(folder), mend=_WHAT_TO_NAME)
    return config


def moveit_beside(urdf: UrdfModel, around: tuple[Path, ...], warnings: list[Problem]) -> MoveitConfig | None:
    """The configuration of a robot in the folders around its URDF; warnings: gets one where several fit as well."""
    fitting = [config for folder in around for config in _configs_in(folder) if _is_of(config, urdf)]
    named = [config for config in fitting if config.urdf is not None and config.urdf.endswith(f"/{urdf.path.name}")]
    best = named or fitting
    if len({config.folder for config in best}) < 2:
        return best[0] if best else None
    names = ", ".join(str(config.folder) for config in best[:5])
    message = f"several configurations of MoveIt are of this robot: {names}"
    mend = f"choose one, such as `--moveit {best[0].folder}`"
    warnings.append(Problem("several-configs", message, Place(urdf.path), severity="warning", mend=mend))
    return None


def arm_tip(config: MoveitConfig, srdf: SrdfModel | None, urdf: UrdfModel) -> str | None:
    """The link to which a tool is fixed: as solver, end effector or chain of the longest arm say."""
    groups = _arm_groups(config, srdf, urdf)
    tips = _solver_tips(config)
    for group in groups:
        ends = [end.parent_link for end in (srdf.end_effectors if srdf else ()) if end.parent_group == group]
        found = [tips.get(group), *ends, srdf.tips.get(group) if srdf else None]
        link = next((name for name in found if name in urdf.links), None)
        if link is not None:
            return link
    return None


def _arm_groups(config: MoveitConfig, srdf: SrdfModel | None, urdf: UrdfModel) -> list[str]:
    """The groups of one chain, those with a solver first, then by number of joints; no grippers and pairs of arms."""
    if srdf is None:
        return []
    solved = _solvers(config)
    grippers = {end.group for end in srdf.end_effectors}
    chains = [
        name
        for name, joints in srdf.groups.items()
        if joints
        and name not in grippers
        and set(joints) <= {joint.name for joint in urdf.chain(urdf.joints[joints[-1]].child)}
    ]
    return sorted(chains, key=lambda name: (name not in solved, -len(srdf.groups[name])))


def _solvers(config: MoveitConfig) -> Mapping[str, Any]:
    """What `kinematics.yaml` says of each group; nothing if it is only damaged: it is a hint.

    Raises InputError for a file that says something else.
    """
    if config.kinematics is None:
        return {}
    try:
        data: Any = read_yaml(config.kinematics).data
    except InputError as error:
        if error.problems[0].code == "not-a-mapping":
            raise
        return {}
    for key in ("/**", "ros__parameters", "robot_description_kinematics"):
        data = data[key] if isinstance(data.get(key), dict) else data
    return {group: entry for group, entry in data.items() if isinstance(entry, dict)}


def _solver_tips(config: MoveitConfig) -> dict[str, str]:
    return {
        group: str(entry[key]) for group, entry in _solvers(config).items() for key in _TIP_KEYS if entry.get(key)
    }  # fmt: skip


def _configs_in(folder: Path) -> Iterator[MoveitConfig]:
    for entry in sorted(folder.iterdir()) if folder.is_dir() else ():
        if entry.is_dir() and ("moveit" in entry.name or (entry / ASSISTANT).is_file()):
            try:
                yield find_moveit(entry)
            except InputError:
                continue


def _is_of(config: MoveitConfig, urdf: UrdfModel) -> bool:
    """Whether the configuration names this URDF, or its SRDF a robot of this name."""
    if config.urdf is not None and config.urdf.endswith(f"/{urdf.path.name}"):
        return True
    if config.srdf is None:
        return False
    try:
        return read_xml(config.srdf, "robot").attributes.get("name") == urdf.name
    except InputError:
        return False


def _noted(folder: Path) -> Mapping[str, Any]:
    """What `.setup_assistant` says, with keys in lower case; nothing if it is missing or damaged.

    Raises InputError, with the line, for a file that says something else.
    """
    key = "moveit_setup_assistant_config"
    try:
        document = read_yaml(folder / ASSISTANT)
    except InputError as error:
        if error.problems[0].code == "not-a-mapping":
            raise
        return {}
    data: Any = document.data.get(key) or {}
    if not isinstance(data, dict):
        raise document.error("not-a-mapping", (key,), f"found `{str(data)[:60]}`, expected URDF, SRDF and CONFIG")
    return {key.lower(): value for key, value in data.items() if isinstance(value, dict)}


def _srdf(folder: Path, noted: Mapping[str, Any]) -> Path | None:
    relative = noted.get("srdf", {}).get("relative_path")
    if relative and (folder / str(relative)).is_file():
        return folder / str(relative)
    for pattern in ("*.srdf", "*.srdf.xacro"):
        for place in _FOLDERS:
            found = sorted((folder / place).glob(pattern))
            found = [file for file in found if "macro" not in file.name] or found
            if found:
                return found[0]
    return None


def _file(folder: Path, name: str) -> Path | None:
    return next((folder / place / name for place in _FOLDERS if (folder / place / name).is_file()), None)


def _urdf(folder: Path, noted: Mapping[str, Any]) -> str | None:
    entry = noted.get("urdf", {})
    if entry.get("package") and entry.get("relative_path"):
        return f"package://{entry['package']}/{str(entry['relative_path']).lstrip('/')}"
    own = [file for pattern in ("*.urdf", "*.urdf.xacro") for file in sorted((folder / "config").glob(pattern))]
    return str(own[0]) if own else None


def _arguments(noted: Mapping[str, Any]) -> dict[str, str]:
    """`xacro_args`, such as `--inorder robot_type:=xarm dof:=6`."""
    text = str(noted.get("urdf", {}).get("xacro_args") or "")
    try:
        words = shlex.split(text)
    except ValueError:
        words = text.split()
    pairs = (re.fullmatch(r"(\w+):=(.*)", word) for word in words)
    return {pair[1]: pair[2] for pair in pairs if pair}
