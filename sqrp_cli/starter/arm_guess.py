"""Which joints of a URDF form its arm, where a tool goes, and which way it points."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from sqrp_cli.errors import bad_input, expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import driving_joints
from sqrp_cli.robot.robot import AXES_OF_A_POSE
from sqrp_cli.robot.urdf import UrdfJoint, UrdfModel

_GRIPPER_JOINT = re.compile(r"finger|grip|jaw|claw|knuckle|thumb|hand_(index|middle|ring|little|pinky)", re.IGNORECASE)
"""Words in the names of gripper joints."""
_TOOL_WORDS = ({"tcp"}, {"tool0", "tool"}, {"ee", "eef", "effector"}, {"flange"}, {"hand", "tip"})
"""Words in usual names of tool frames, the most specific first."""
MOST_SHARED = 4
"""Joints that an arm has to itself, in addition to those that it shares with another one, such as a torso."""
LEAST_SWING = 0.02  # least distance of a tool from an axis that swings it [m]
LEAST_ACROSS = 1.2  # that distance as a share of the one along the axis, at least
LONGEST_FINGER = 2  # most joints of a finger in a row; a branch with more is an arm


@dataclass(frozen=True, eq=False)
class ArmGuess:
    """The arm in a URDF."""

    joints: tuple[UrdfJoint, ...]  # its movable joints, from the root outwards
    tip: str  # the link at its end, to which a tool is fixed
    carried: tuple[str, ...]  # every link after the last joint, fingers included
    out: Array
    """Unit vector in the frame of `tip` that points out of the arm, along the axis of the last joint, shape (3,)."""
    swinging: Array | None = None
    """Axis of the last joint in the frame of `tip`, (3,), if it may swing the tool and only shapes tell, else None."""
    others: tuple[str, ...] = ()  # where a tool would be on other arms of the robot, as on one with two


def guess_arm(urdf: UrdfModel, tip: str | None = None) -> ArmGuess:
    """The longest chain of movable joints without a gripper's, of equals the first, or the one that carries `tip`."""
    others = []
    if tip is not None:
        mend = "name the link that carries the tool: `--tip LINK`, or leave `--tip` out to have it guessed"
        if tip not in urdf.links:
            message = f"found `{tip}`, which is no link of `{urdf.name}`; {expected_names(tip, urdf.links)}"
            raise bad_input("unknown-link", message, urdf.links[urdf.root].place, mend=mend)
        arm = [joint for joint in urdf.chain(tip) if joint.movable]
        if not arm:
            message = f"no joint moves `{tip}`; expected a link at the end of an arm"
            raise bad_input("no-arm", message, urdf.links[tip].place, mend=mend)
    else:
        chains = _arms(urdf)
        if not chains:
            moving = [f"`{joint.name}`" for joint in urdf.movable_joints]
            what = "all its joints are fixed" if urdf.joints else "it has none"
            if moving:
                what = f"{', '.join(moving[:4])}{', ...' if len(moving) > 4 else ''} look like fingers or wheels"
            message = f"`{urdf.name}` has no joint that moves an arm: {what}"
            mend = "name the URDF of the arm; where its joints are named as those of a gripper, its last link:"
            raise bad_input("no-arm", message, urdf.links[urdf.root].place, mend=f"{mend} `--tip LINK`")
        arm = max(chains, key=len)  # the first of equals
        tip = _tip(urdf, arm)
        for chain in chains:  # another arm is nearly as long, and has no joint of this one, or few
            shared = len({*chain} & {*arm})
            long = len(chain) >= len(arm) - 1 and (shared == 0 or len(chain) >= MOST_SHARED + shared)
            if chain is not arm and long:
                others.append(_tip(urdf, chain))
    last = arm[-1]
    slides = [urdf.pose_in(urdf.root, joint.child)[:3, :3] @ joint.axis for joint in arm if joint.type == "prismatic"]
    ways = int(np.linalg.matrix_rank(slides, tol=1e-3)) if slides else 0  # one of a telescope
    axes = len(arm) - len(slides) + ways
    may_swing = axes < AXES_OF_A_POSE and last.type != "prismatic"
    return ArmGuess(
        joints=tuple(driving_joints(arm, urdf.movable_joints)),
        tip=tip,
        carried=tuple(urdf.beyond(last.child)),
        out=_outward(urdf, last, tip, may_swing=may_swing),
        swinging=last.axis if may_swing and urdf.rigid_with(last.child) == [tip] else None,
        others=tuple(others),
    )


def _arms(urdf: UrdfModel) -> list[list[UrdfJoint]]:
    """Chains of movable joints from the root, none part of another one, without joints of grippers.

    A joint belongs to a gripper by its name or one's beside it, because others mimic it, or as a finger. A joint that
    carries other independent joints is of the arm: what it mimics, or mimics it, is a parallel linkage.
    """
    leads = {joint.mimic.joint for joint in urdf.joints.values() if joint.mimic}
    on: dict[str, list[UrdfJoint]] = {}  # the movable joints on each rigid body
    for joint in urdf.movable_joints:
        on.setdefault(urdf.body_of[joint.parent], []).append(joint)
    deep: dict[str, int] = {}  # the length of the longest chain of movable joints from each outwards, itself included
    for joint in reversed(urdf.movable_joints):
        deep[joint.name] = 1 + max((deep[other.name] for other in on.get(joint.child, ())), default=0)
    of_gripper = set()
    for joint in urdf.movable_joints:
        beyond, siblings = {*urdf.beyond(joint.child)}, on[urdf.body_of[joint.parent]]
        alone = not any(other.mimic is None for other in urdf.movable_joints if other.parent in beyond)
        fingers = len(siblings) > 1 and all(deep[other.name] <= LONGEST_FINGER for other in siblings)
        named = any(_GRIPPER_JOINT.search(other.name) for other in siblings)  # of which it is one
        if named or fingers or (alone and (joint.name in leads or joint.mimic is not None)):
            of_gripper.add(joint)
    chains: list[list[UrdfJoint]] = []
    for joint in urdf.movable_joints:
        chain = [carrier for carrier in urdf.chain(joint.child) if carrier.movable]
        if of_gripper.isdisjoint(chain):
            chains = [other for other in chains if other[-1] is not (chain[-2] if len(chain) > 1 else None)]
            chains.append(chain)
    return chains


def _tip(urdf: UrdfModel, chain: Sequence[UrdfJoint]) -> str:
    """The link at the end of a chain to which a tool is fixed: by its name, else the last one."""
    rigid = urdf.rigid_with(chain[-1].child)
    words = [{*re.split(r"[^a-z0-9]+", link.lower())} for link in rigid]
    named = (link for usual in _TOOL_WORDS for link, parts in zip(rigid, words, strict=True) if usual & parts)
    return next(named, rigid[-1])


def _outward(urdf: UrdfModel, last: UrdfJoint, tip: str, *, may_swing: bool) -> Array:
    """The direction out of the arm in the frame of `tip`: along the last axis, away from the joints before it.

    An arm of few axes may end with one that swings the tool, such as a wrist without roll: then it is across this axis.
    """
    X_JT, rigid = urdf.pose_in(last.child, tip), urdf.rigid_with(last.child)
    away = X_JT[:3, 3] + sum((urdf.pose_in(last.child, link)[:3, 3] for link in rigid), np.zeros(3))
    across = away - last.axis * (away @ last.axis)
    far = np.linalg.norm(across)
    if may_swing and far > LEAST_SWING and far > LEAST_ACROSS * abs(away @ last.axis):
        return X_JT[:3, :3].T @ (across / far)
    away = away + last.X_PJ[:3, :3].T @ last.X_PJ[:3, 3]  # near the joint's origin, the way that led there counts
    return X_JT[:3, :3].T @ (last.axis if away @ last.axis >= 0 else -last.axis)
