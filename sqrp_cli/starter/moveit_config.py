"""Configurations of MoveIt: which files they have, and what these say about the arm.

A configuration is a package as MoveIt's setup assistant writes it: `.setup_assistant` names URDF and SRDF, `config/`
(or `srdf/`) holds the SRDF, `joint_limits.yaml` and `kinematics.yaml`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, nearest
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.xml_file import read_xml
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.srdf import SrdfModel
from sqrp_cli.robot.urdf import UrdfModel

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

    def names(self, urdf: UrdfModel) -> bool:
        """Whether it was made of a file of this name."""
        return self.urdf is not None and self.urdf.endswith(f"/{urdf.path.name}")


def find_moveit(folder: Path) -> MoveitConfig:
    """The configuration in a folder, or in the one above its `config`. Raises InputError if it is none."""
    if not folder.is_dir():
        others = [entry.name for entry in folder.parent.glob("*/")] if folder.parent.is_dir() else []
        close = nearest(folder.name, others)
        message = "no such folder" + (f"; did you mean `{close}`?" if close else "")
        raise bad_input("missing-folder", message, Place(folder), mend=_WHAT_TO_NAME)
    if folder.name in _FOLDERS and not (folder / ASSISTANT).is_file():
        folder = folder.parent
    srdf, urdf, arguments = _noted(folder)
    if srdf is None:
        found = [sorted((folder / place).glob(end)) for end in ("*.srdf", "*.srdf.xacro") for place in _FOLDERS]
        files = next((files for files in found if files), [])
        srdf = next((file for file in files if "macro" not in file.name), files[0] if files else None)
    if urdf is None:
        own = [file for pattern in ("*.urdf", "*.urdf.xacro") for file in sorted((folder / "config").glob(pattern))]
        urdf = str(own[0]) if own else None
    limits, kinematics = (
        next((folder / place / name for place in _FOLDERS if (folder / place / name).is_file()), None)
        for name in ("joint_limits.yaml", "kinematics.yaml")
    )
    if srdf is None and limits is None:
        inside = ", ".join(sorted(entry.name for entry in folder.iterdir())[:8])
        message = "this is no configuration of MoveIt: it has neither an SRDF nor joint_limits.yaml"
        raise bad_input("missing-file", f"{message}; it has {inside or 'nothing'}", Place(folder), mend=_WHAT_TO_NAME)
    return MoveitConfig(folder, srdf, limits, kinematics, urdf, arguments)


def _noted(folder: Path) -> tuple[Path | None, str | None, Mapping[str, str]]:
    """SRDF, URDF and its arguments as `.setup_assistant` says; nothing if it is missing or damaged.

    Raises InputError, with the line, for a file that says something else.
    """
    key = "moveit_setup_assistant_config"
    document = _read_hint(folder / ASSISTANT)
    data: Any = (document.data.get(key) if document is not None else None) or {}
    if document is not None and not isinstance(data, dict):
        raise document.error("not-a-mapping", (key,), f"found `{str(data)[:60]}`, expected URDF, SRDF and CONFIG")
    noted = {key.lower(): value for key, value in data.items() if isinstance(value, dict)}
    relative, urdf = noted.get("srdf", {}).get("relative_path"), noted.get("urdf", {})
    srdf = folder / str(relative) if relative and (folder / str(relative)).is_file() else None
    named = None
    if urdf.get("package") and urdf.get("relative_path"):
        named = f"package://{urdf['package']}/{str(urdf['relative_path']).lstrip('/')}"
    text = str(urdf.get("xacro_args") or "")  # such as `--inorder robot_type:=xarm dof:=6`
    try:
        words = shlex.split(text)
    except ValueError:
        words = text.split()
    pairs = (re.fullmatch(r"(\w+):=(.*)", word) for word in words)
    return srdf, named, {pair[1]: pair[2] for pair in pairs if pair}


def _read_hint(path: Path) -> SourceDocument | None:
    """A file that is only a hint: None if it is damaged. Raises InputError for one that says something else."""
    try:
        return read_yaml(path)
    except InputError as error:
        if error.problems[0].code == "not-a-mapping":
            raise
        return None


def moveit_beside(urdf: UrdfModel, around: tuple[Path, ...], warnings: list[Problem]) -> MoveitConfig | None:
    """The configuration of a robot in the folders around its URDF; warnings: gets one where several fit as well.

    It names the URDF, or its SRDF a robot of the same name; where one names the URDF, those that do not are left out.
    """
    fitting = []
    for entry in (entry for folder in around if folder.is_dir() for entry in sorted(folder.iterdir())):
        if entry.is_dir() and ("moveit" in entry.name or (entry / ASSISTANT).is_file()):
            try:
                config = find_moveit(entry)
                srdf = config.srdf
                if config.names(urdf) or (srdf and read_xml(srdf, "robot").attributes.get("name") == urdf.name):
                    fitting.append(config)
            except InputError:
                continue
    best = [config for config in fitting if config.names(urdf)] or fitting
    if len({config.folder for config in best}) < 2:
        return best[0] if best else None
    message = f"several configurations of MoveIt are of this robot: {', '.join(str(one.folder) for one in best[:5])}"
    mend = f"choose one, such as `--moveit {best[0].folder}`"
    warnings.append(Problem("several-configs", message, Place(urdf.path), severity="warning", mend=mend))
    return None


def arm_tip(config: MoveitConfig, srdf: SrdfModel | None, urdf: UrdfModel) -> str | None:
    """The link to which a tool is fixed: as solver, end effector or chain of the longest arm say.

    Arms are groups of one chain, those with a solver first, then by number of joints; no grippers and pairs of arms.
    """
    document = None if config.kinematics is None else _read_hint(config.kinematics)
    if srdf is None:
        return None
    solvers: Any = {} if document is None else document.data
    for key in ("/**", "ros__parameters", "robot_description_kinematics"):
        solvers = solvers[key] if isinstance(solvers.get(key), dict) else solvers
    solvers = {group: entry for group, entry in solvers.items() if isinstance(entry, dict)}
    grippers = {end.group for end in srdf.end_effectors}
    arms = [
        group
        for group, joints in srdf.groups.items()
        if joints
        and group not in grippers
        and {*joints} <= {joint.name for joint in urdf.chain(urdf.joints[joints[-1]].child)}
    ]
    for group in sorted(arms, key=lambda group: (group not in solvers, -len(srdf.groups[group]))):
        tips = [str(solvers[group][key]) for key in _TIP_KEYS if group in solvers and solvers[group].get(key)]
        ends = [end.parent_link for end in srdf.end_effectors if end.parent_group == group]
        link = next((name for name in (*tips[-1:], *ends, srdf.tips.get(group)) if name in urdf.links), None)
        if link is not None:
            return link
    return None
