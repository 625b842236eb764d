"""Which joints of a URDF form its arm, where a tool goes, and which way it points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.urdf import UrdfJoint, UrdfModel

_GRIPPER_JOINT = re.compile(r"finger|grip|jaw|claw|knuckle|thumb", re.IGNORECASE)
"""Words in the names of gripper joints."""

_TOOL_WORDS = ({"tcp"}, {"tool0", "tool"}, {"ee", "eef", "effector"}, {"flange"}, {"hand", "tip"})
"""Words in usual names of tool frames, the most specific first."""

LONGEST_FINGER = 2
"""Most joints of a finger in a row; a branch with more is an arm."""


@dataclass(frozen=True, eq=False)
class ArmGuess:
    """The arm in a URDF."""

    joints: tuple[UrdfJoint, ...]
    """Its movable joints, from the root outwards."""
    tip: str
    """The link at its end, to which a tool is fixed."""
    carried: tuple[str, ...]
    """Every link after the last joint, fingers included."""
    out: Array
    """Unit vector in the frame of `tip` that points out of the arm, along the axis of the last joint, shape (3,)."""


def guess_arm(urdf: UrdfModel) -> ArmGuess:
    """The longest chain of movable joints, without gripper joints. Raises InputError if no joint moves."""
    leads = {joint.mimic.joint for joint in urdf.joints.values() if joint.mimic}
    arm: list[UrdfJoint] = []
    for joint in urdf.movable_joints:
        chain = [carrier for carrier in urdf.chain(joint.child) if carrier.movable]
        if len(chain) > len(arm) and not any(_moves_gripper(carrier, urdf, leads) for carrier in chain):
            arm = chain
    if not arm:
        message = f"`{urdf.name}` has no joint that moves an arm"
        raise InputError(Problem("no-arm", message, urdf.links[urdf.root].place))
    last = arm[-1]
    rigid = urdf.rigid_with(last.child)
    tip = min(rigid, key=lambda link: (_tip_rank(link), rigid.index(link)))
    if _tip_rank(tip) == len(_TOOL_WORDS):
        tip = rigid[-1]
    return ArmGuess(tuple(arm), tip, tuple(urdf.beyond(last.child)), _outward(urdf, arm, tip, rigid))


def _tip_rank(link: str) -> int:
    """Rank of a link's name as that of a tool frame; lower is better."""
    words = set(re.split(r"[^a-z0-9]+", link.lower()))
    return next((rank for rank, tool_words in enumerate(_TOOL_WORDS) if words & tool_words), len(_TOOL_WORDS))


def _moves_gripper(joint: UrdfJoint, urdf: UrdfModel, leads: set[str]) -> bool:
    """Whether a joint belongs to a gripper: by its name, because others mimic it, or as one of several fingers.

    If the mimicked joint carries other independent joints, the mimicking joint is a rod of a parallel linkage.
    """
    leads_fingers = joint.name in leads and not _carries_independent(joint, urdf)
    if _GRIPPER_JOINT.search(joint.name) or joint.mimic is not None or leads_fingers:
        return True
    siblings = _movable_on(joint.parent, urdf)
    return len(siblings) > 1 and all(_depth_beyond(other, urdf) <= LONGEST_FINGER for other in siblings)


def _outward(urdf: UrdfModel, arm: Sequence[UrdfJoint], tip: str, rigid: Sequence[str]) -> Array:
    """The direction out of the arm in the frame of `tip`: along the last axis, away from the joints before it."""
    last = arm[-1]
    X_JT = urdf.pose_in(last.child, tip)
    away = X_JT[:3, 3] + sum((urdf.pose_in(last.child, link)[:3, 3] for link in rigid), np.zeros(3))
    if abs(away @ last.axis) < 1e-3:
        # The tool frame lies in the joint's origin: continue the direction that led to it.
        away = last.X_PJ[:3, :3].T @ last.X_PJ[:3, 3]
    out: Array = X_JT[:3, :3].T @ (last.axis if away @ last.axis >= 0 else -last.axis)
    return out


def _movable_on(link: str, urdf: UrdfModel) -> list[UrdfJoint]:
    """The movable joints on the rigid body of a link."""
    body = urdf.rigid_with(link)
    return [joint for joint in urdf.movable_joints if joint.parent in body]


def _depth_beyond(joint: UrdfJoint, urdf: UrdfModel) -> int:
    """The length of the longest chain of movable joints from a joint outwards, itself included."""
    return 1 + max((_depth_beyond(other, urdf) for other in _movable_on(joint.child, urdf)), default=0)


def _carries_independent(joint: UrdfJoint, urdf: UrdfModel) -> bool:
    """Whether a joint after this one moves independently."""
    beyond = {*urdf.beyond(joint.child)}
    return any(other.mimic is None for other in urdf.movable_joints if other.parent in beyond)
