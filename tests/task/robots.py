"""Robots for tests: real ones from example-robot-data, and small ones written here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.files.packages import package_roots, resolve_mesh
from sqrp_cli.geometry import Array
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot import JointLimits, Robot, Tool
from tests.cells import read_cases

SUCTION_CUP = Path(__file__).parents[2] / "workspaces" / "robots" / "suction_cup.urdf"

_DATA = next(root for root in package_roots() if (root / "example-robot-data").is_dir())
ROBOTS = _DATA / "example-robot-data" / "robots"

REAL_ARMS = {
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_eef"),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
}
"""URDF and tool frame."""


def mounted(urdf: Path, link: str, X_LT: Array) -> Tool:
    """A tool of a URDF on a link, its root at X_LT there."""
    return Tool(read_urdf(urdf), link, X_LT, urdf)


def robot(
    urdf: Path,
    tool_frame: str,
    tool: Tool | None = None,
    X_WB: Array | None = None,
    home: Mapping[str, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    angle_tolerance: float = 0.0,
) -> Robot:
    """A robot with the position limits of its URDFs unless `limits` has others."""
    models = [read_urdf(urdf), *([tool.urdf] if tool else [])]
    joints = [joint for model in models for joint in model.movable_joints]
    positions = {joint.name: (joint.lower, joint.upper) for joint in joints} | dict(limits or {})
    parts = [part for model in models for part in model.parts("collision", partial(resolve_mesh, package_roots()))]
    return Robot(
        urdf=models[0],
        srdf=None,
        package_roots=package_roots(),
        X_WB=np.eye(4) if X_WB is None else X_WB,
        tool=tool,
        tool_frame=tool_frame,
        home=home or {},
        limits={
            name: JointLimits(*ends, velocity=1.0, acceleration=2.0, jerk=10.0) for name, ends in positions.items()
        },
        stop_limits={},
        angle_tolerance=angle_tolerance,
        geometry="collision",
        parts=tuple(parts),
        disabled_pairs=frozenset(),
        fingers=None,
        markers={},
    )


@cache
def real_arm(name: str) -> RobotModel:
    """One of `REAL_ARMS`, without a tool, its base at the world's origin."""
    urdf, tool_frame = REAL_ARMS[name]
    return RobotModel.load(robot(ROBOTS / urdf, tool_frame))


def joint(name: str, parent: str, child: str, kind: str, xyz: str, axis: str, extra: str = "") -> str:
    """A joint of a small URDF, with limits of -3 and 3 [rad or m] unless `extra` has others."""
    limit = (
        ""
        if kind in ("fixed", "continuous") or "<limit" in extra
        else '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    )
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/>{limit}{extra}</joint>'
    )


def written_urdf(path: Path, *joints: str) -> Path:
    """A URDF of these joints with a link for every name in them."""
    import re

    links = dict.fromkeys(re.findall(r'link="(\w+)"', "".join(joints)))
    path.write_text(
        "<robot name='small'>" + "".join(f'<link name="{link}"/>' for link in links) + "".join(joints) + "</robot>"
    )
    return path


def small_arm(folder: Path, tool_frame: str, *joints: tuple[str, ...], **named: Any) -> RobotModel:
    """The model of an arm of such joints; named: as of `robot`."""
    return RobotModel.load(
        robot(written_urdf(folder / "small.urdf", *(joint(*one) for one in joints)), tool_frame, **named)
    )


def spherical_wrist_arm(folder: Path, upper: float, fore: float) -> Path:
    """An arm with a shoulder and a wrist whose axes meet in one point each, joined by an elbow: reach in closed form.

    The shoulder is at (0, 0, 0.5), the upper arm and the forearm have these lengths [m], the tool frame is `tip`, 0.1 m
    from the wrist along its own z axis.
    """
    limit = '<limit lower="-3.1415926535" upper="3.1415926535" velocity="1" effort="1"/>'
    return written_urdf(
        folder / "spherical.urdf",
        joint("j1", "base", "l1", "revolute", "0 0 0.5", "0 0 1", limit),
        joint("j2", "l1", "l2", "revolute", "0 0 0", "0 1 0", limit),
        joint("j3", "l2", "l3", "revolute", f"0 0 {upper}", "0 1 0", limit),
        joint("j4", "l3", "l4", "revolute", f"0 0 {fore}", "0 0 1", limit),
        joint("j5", "l4", "l5", "revolute", "0 0 0", "0 1 0", limit),
        joint("j6", "l5", "l6", "revolute", "0 0 0", "0 0 1", limit),
        joint("j7", "l6", "tip", "fixed", "0 0 0.1", "0 0 1"),
    )


def torso_arm(folder: Path, joints: int = 8) -> Path:
    """An arm with more joints than a pose needs: a torso that lifts by 0 to 0.35 m, and seven joints or more that turn.

    Further ones are at the shoulder. The tool frame is `tip`, 0.12 m beyond the last axis, along it.
    """
    torso = '<limit lower="0" upper="0.35" velocity="0.5" effort="1"/>'
    bend = '<limit lower="-2.1" upper="2.1" velocity="1" effort="1"/>'
    names = ["base", *(f"l{k}" for k in range(joints - 1)), "hand"]
    shoulder = [("0 0 0.03", "1 0 0", bend) for _ in range(joints - 8)]
    axes = [
        ("0 0 0.3", "0 0 1", torso), ("0 0 0.1", "0 0 1", ""), *shoulder, ("0 0 0.05", "0 1 0", bend),
        ("0 0 0.15", "0 0 1", ""), ("0 0 0.2", "0 1 0", bend), ("0 0 0.15", "0 0 1", ""), ("0 0 0.2", "0 1 0", bend),
        ("0 0 0.05", "0 0 1", ""),
    ]  # fmt: skip
    chain = [
        joint(f"j{k}", names[k], names[k + 1], "revolute" if k else "prismatic", *axis) for k, axis in enumerate(axes)
    ]
    return written_urdf(
        folder / f"torso{joints}.urdf", *chain, joint("end", "hand", "tip", "fixed", "0 0 0.12", "0 0 1")
    )


def turning(name: str, parent: str, child: str, xyz: str, axis: str, mimics: str = "", multiplier: float = -1) -> str:
    """A joint that turns by 1.5 rad either way, or follows another one."""
    limit = '<limit lower="-1.5" upper="1.5" velocity="1" effort="100"/>'
    follow = f'<mimic joint="{mimics}" multiplier="{multiplier:g}"/>' if mimics else ""
    return joint(name, parent, child, "revolute", xyz, axis, limit + follow)


def _stated(row: Sequence[Any]) -> str:
    """A joint of tests/cases/small_arms.yaml."""
    name, parent, child, xyz, axis, how = *row[:5], dict(row[5]) if len(row) > 5 else {}
    if "kind" not in how and "limits" not in how:
        return turning(name, parent, child, xyz, axis, how.get("mimics", ""))
    limits = '<limit lower="{}" upper="{}" velocity="1"/>'.format(*how["limits"]) if "limits" in how else ""
    return joint(name, parent, child, how.get("kind", "revolute"), xyz, axis, limits)


_SMALL = read_cases("small_arms.yaml")
SIX_AXES = tuple(map(_stated, _SMALL["six axes"]))
FEW_AXES, LINKAGES, LIFTS = (
    {name: tuple(map(_stated, rows)) for name, rows in _SMALL[of].items()} for of in ("few axes", "linkages", "lifts")
)


def rounded(joints: Sequence[str], by: float) -> tuple[str, ...]:
    """The joints with frames turned by a small angle each, as right angles that are rounded [rad]."""
    return tuple(
        one.replace("<origin ", f'<origin rpy="{by:g} {-by:g} {by * (-1) ** k:g}" ', 1) for k, one in enumerate(joints)
    )


def jacobian(model: RobotModel, q: Array) -> Array:
    """Velocity of the tool frame's origin over its angular velocity, per joint velocity, at positions (n,); (6, n)."""
    J: Array = model.tool_poses_and_jacobians(q[None])[1][0]
    return J
