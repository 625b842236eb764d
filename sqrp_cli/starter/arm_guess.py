"""Which joints of a URDF form its arm, where a tool goes, and which way it points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.errors import bad_input, expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.joint_tree import driving_joints
from sqrp_cli.knowledge.robot.robot import AXES_OF_A_POSE
from sqrp_cli.knowledge.robot.urdf import UrdfJoint, UrdfModel

_GRIPPER_JOINT = re.compile(r"finger|grip|jaw|claw|knuckle|thumb|hand_(index|middle|ring|little|pinky)", re.IGNORECASE)
"""Words in the names of gripper joints."""

_TOOL_WORDS = ({"tcp"}, {"tool0", "tool"}, {"ee", "eef", "effector"}, {"flange"}, {"hand", "tip"})
"""Words in usual names of tool frames, the most specific first."""

MOST_SHARED = 4
"""Joints that an arm has to itself, beside those that it shares with another one, such as a torso."""

LEAST_SWING = 0.02
"""Least distance of a tool from an axis that swings it [m]."""

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
    swinging: Array | None = None
    """Axis of the last joint in the frame of `tip`, (3,), if it may swing the tool and only shapes tell, else None."""
    others: tuple[str, ...] = ()
    """Where a tool would be on other arms of the robot, as on one with two."""


def guess_arm(urdf: UrdfModel, tip: str | None = None) -> ArmGuess:
    """The longest chain of movable joints without those of grippers, or the one that carries a given link.

    Of arms of one length the first. Raises InputError if no joint moves, or there is no such link.
    """
    if tip is not None:
        return _guess(urdf, _chain_to(urdf, tip), tip)
    chains = _arms(urdf)
    if not chains:
        message = f"`{urdf.name}` has no joint that moves an arm: {_what_it_has(urdf)}"
        mend = "name the URDF of the arm; where its joints are named as those of a gripper, its last link: `--tip LINK`"
        raise bad_input("no-arm", message, urdf.links[urdf.root].place, mend=mend)
    arm = max(chains, key=len)  # the first of equals
    others = [_tip(urdf, chain) for chain in chains if chain is not arm and _is_another(chain, arm)]
    return replace(_guess(urdf, arm, _tip(urdf, arm)), others=tuple(others))


def _guess(urdf: UrdfModel, chain: Sequence[UrdfJoint], tip: str) -> ArmGuess:
    driving = driving_joints(chain, urdf.movable_joints)
    last = chain[-1]
    carried = tuple(urdf.beyond(last.child))
    out = _outward(urdf, chain, tip, urdf.rigid_with(last.child))
    may_swing = len(chain) < AXES_OF_A_POSE and last.type != "prismatic" and urdf.rigid_with(last.child) == [tip]
    return ArmGuess(tuple(driving), tip, carried, out, last.axis if may_swing else None)


def _chain_to(urdf: UrdfModel, tip: str) -> list[UrdfJoint]:
    """The movable joints that carry a link. Raises InputError if there is none, or no such link."""
    mend = "name the link that carries the tool: `--tip LINK`, or leave `--tip` out to have it guessed"
    if tip not in urdf.links:
        message = f"found `{tip}`, which is no link of `{urdf.name}`; {expected_names(tip, urdf.links)}"
        raise bad_input("unknown-link", message, urdf.links[urdf.root].place, mend=mend)
    chain = [joint for joint in urdf.chain(tip) if joint.movable]
    if not chain:
        message = f"no joint moves `{tip}`; expected a link at the end of an arm"
        raise bad_input("no-arm", message, urdf.links[tip].place, mend=mend)
    return chain


def _what_it_has(urdf: UrdfModel) -> str:
    """What joints there are, in a few words."""
    moving = [f"`{joint.name}`" for joint in urdf.movable_joints]
    if moving:
        return f"{', '.join(moving[:4])}{', ...' if len(moving) > 4 else ''} look like those of a gripper"
    return "all its joints are fixed" if urdf.joints else "it has none"


def _arms(urdf: UrdfModel) -> list[list[UrdfJoint]]:
    """Chains of movable joints from the root, none part of another one, without joints of grippers."""
    leads = {joint.mimic.joint for joint in urdf.joints.values() if joint.mimic}
    chains: list[list[UrdfJoint]] = []
    for joint in urdf.movable_joints:
        chain = [carrier for carrier in urdf.chain(joint.child) if carrier.movable]
        if not any(_moves_gripper(carrier, urdf, leads) for carrier in chain):
            chains = [other for other in chains if other[-1] is not (chain[-2] if len(chain) > 1 else None)]
            chains.append(chain)
    return chains


def _is_another(chain: Sequence[UrdfJoint], arm: Sequence[UrdfJoint]) -> bool:
    """Whether a chain is an arm beside another one: nearly as long, and with no joint of it, or few."""
    shared = len({*chain} & {*arm})
    return len(chain) >= len(arm) - 1 and (shared == 0 or len(chain) >= MOST_SHARED + shared)


def _tip(urdf: UrdfModel, chain: Sequence[UrdfJoint]) -> str:
    """The link at the end of a chain to which a tool is fixed: by its name, else the last one."""
    rigid = urdf.rigid_with(chain[-1].child)
    tip = min(rigid, key=lambda link: (_tip_rank(link), rigid.index(link)))
    return rigid[-1] if _tip_rank(tip) == len(_TOOL_WORDS) else tip


def _tip_rank(link: str) -> int:
    """Rank of a link's name as that of a tool frame; lower is better."""
    words = set(re.split(r"[^a-z0-9]+", link.lower()))
    return next((rank for rank, tool_words in enumerate(_TOOL_WORDS) if words & tool_words), len(_TOOL_WORDS))


def _moves_gripper(joint: UrdfJoint, urdf: UrdfModel, leads: set[str]) -> bool:
    """Whether a joint belongs to a gripper: by its name or one's beside it, because others mimic it, or as a finger.

    A joint that carries other independent joints is of the arm: what it mimics, or mimics it, is a parallel linkage.
    """
    coupled = joint.name in leads or joint.mimic is not None
    if _GRIPPER_JOINT.search(joint.name) or (coupled and not _carries_independent(joint, urdf)):
        return True
    siblings = _movable_on(joint.parent, urdf)
    beside_finger = any(_GRIPPER_JOINT.search(other.name) for other in siblings)
    return beside_finger or (
        len(siblings) > 1 and all(_depth_beyond(other, urdf) <= LONGEST_FINGER for other in siblings)
    )


def _outward(urdf: UrdfModel, arm: Sequence[UrdfJoint], tip: str, rigid: Sequence[str]) -> Array:
    """The direction out of the arm in the frame of `tip`: along the last axis, away from the joints before it.

    An arm of few axes may end with one that swings the tool, such as a wrist without roll: then it is across this axis.
    """
    last = arm[-1]
    X_JT = urdf.pose_in(last.child, tip)
    away = X_JT[:3, 3] + sum((urdf.pose_in(last.child, link)[:3, 3] for link in rigid), np.zeros(3))
    across = away - last.axis * (away @ last.axis)
    swings = len(arm) < AXES_OF_A_POSE and last.type != "prismatic" and np.linalg.norm(across) > LEAST_SWING
    if swings and np.linalg.norm(across) > 2.0 * abs(away @ last.axis):
        return X_JT[:3, :3].T @ (across / np.linalg.norm(across))
    if abs(away @ last.axis) < 1e-3:
        # The tool frame lies in the joint's origin: continue the direction that led to it.
        away = last.X_PJ[:3, :3].T @ last.X_PJ[:3, 3]
    return X_JT[:3, :3].T @ (last.axis if away @ last.axis >= 0 else -last.axis)


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
