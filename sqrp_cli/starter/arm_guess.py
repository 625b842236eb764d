"""Which joints of a URDF are its arm, where a tool belongs, and which way that points."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.urdf import UrdfJoint, UrdfModel

_GRIPPER_JOINT = re.compile(r"finger|grip|jaw|claw|knuckle|thumb", re.IGNORECASE)
"""Names of joints that move a gripper and not the arm."""

_TOOL_WORDS = ({"tcp"}, {"tool0", "tool"}, {"ee", "eef", "effector"}, {"flange"}, {"hand", "tip"})
"""Words in the names that tool frames usually have, the most telling first."""

LONGEST_FINGER = 2
"""Most joints in a row of a finger; a branch with more is an arm."""


@dataclass(frozen=True, eq=False)
class ArmGuess:
    """The arm in a URDF.

    joints: its movable joints, from the root outwards. tip: the link at its end that a tool is fixed to.
    carried: every link beyond the last joint, fingers included. out: unit vector in the frame of `tip` that points out
    of the arm, along the axis of the last joint, shape (3,).
    """

    joints: tuple[UrdfJoint, ...]
    tip: str
    carried: tuple[str, ...]
    out: Array


def guess_arm(urdf: UrdfModel) -> ArmGuess:
    """The longest chain of movable joints, gripper joints left out. Raises InputError if no joint moves."""
    tree = _Tree(urdf)
    leads = {joint.mimic.joint for joint in urdf.joints.values() if joint.mimic}
    arm: list[UrdfJoint] = []
    for joint in urdf.movable_joints:
        chain = tree.chain_to(joint)
        if len(chain) > len(arm) and not any(_moves_gripper(link, tree, leads) for link in chain):
            arm = chain
    if not arm:
        message = f"`{urdf.name}` has no joint that moves an arm"
        raise InputError(Problem("no-arm", message, urdf.links[urdf.root].place))
    last = arm[-1]
    rigid = tree.rigid_with(last.child)
    tip = min(rigid, key=lambda link: (_telling(link), rigid.index(link)))
    if _telling(tip) == len(_TOOL_WORDS):
        tip = rigid[-1]
    return ArmGuess(tuple(arm), tip, tree.beyond(last.child), _outward(tree, arm, tip, rigid))


def _telling(link: str) -> int:
    """How much a link's name says that it is a tool frame; the less the more."""
    words = set(re.split(r"[^a-z0-9]+", link.lower()))
    return next((rank for rank, telling in enumerate(_TOOL_WORDS) if words & telling), len(_TOOL_WORDS))


def _moves_gripper(joint: UrdfJoint, tree: _Tree, leads: set[str]) -> bool:
    """Whether a joint belongs to a gripper: by its name, because others follow it, or as one of several fingers.

    What follows a joint that carries others which move by themselves is a rod of a parallel linkage.
    """
    leads_fingers = joint.name in leads and not tree.carries_independent(joint)
    if _GRIPPER_JOINT.search(joint.name) or joint.mimic is not None or leads_fingers:
        return True
    siblings = tree.movable_on(tree.rigid_root(joint.parent))
    return len(siblings) > 1 and all(tree.depth_beyond(other) <= LONGEST_FINGER for other in siblings)


def _outward(tree: _Tree, arm: Sequence[UrdfJoint], tip: str, rigid: Sequence[str]) -> Array:
    """The direction out of the arm in the frame of `tip`: along the last axis, away from the joints before."""
    last = arm[-1]
    X_JT = tree.pose_in(last.child, tip)
    away = X_JT[:3, 3] + sum((tree.pose_in(last.child, link)[:3, 3] for link in rigid), np.zeros(3))
    if abs(away @ last.axis) < 1e-3:
        # The tool frame lies in the joint's origin: the way that led to it goes on.
        away = last.X_PJ[:3, :3].T @ last.X_PJ[:3, 3]
    out: Array = X_JT[:3, :3].T @ (last.axis if away @ last.axis >= 0 else -last.axis)
    return out


class _Tree:
    """The links and joints of a URDF, asked for what hangs on what."""

    def __init__(self, urdf: UrdfModel) -> None:
        self.urdf = urdf

    @cached_property
    def carriers(self) -> dict[str, UrdfJoint]:
        return {joint.child: joint for joint in self.urdf.joints.values()}

    def chain_to(self, joint: UrdfJoint) -> list[UrdfJoint]:
        """The movable joints from the root to a joint, itself included."""
        chain = [joint]
        while (before := self.carriers.get(chain[0].parent)) is not None:
            chain.insert(0, before)
        return [link for link in chain if link.movable]

    def rigid_root(self, link: str) -> str:
        """The link nearest to the root that is fixed to a link."""
        while link in self.carriers and not self.carriers[link].movable:
            link = self.carriers[link].parent
        return link

    def rigid_with(self, root: str) -> list[str]:
        """The links that are fixed to `root` outwards, itself first."""
        links = [root]
        for joint in self.urdf.joints.values():
            if not joint.movable and joint.parent in links:
                links.append(joint.child)
        return links

    def movable_on(self, root: str) -> list[UrdfJoint]:
        """The movable joints that sit on a rigid body."""
        body = self.rigid_with(root)
        return [joint for joint in self.urdf.movable_joints if joint.parent in body]

    def depth_beyond(self, joint: UrdfJoint) -> int:
        """The most movable joints in a row from a joint outwards, itself included."""
        return 1 + max((self.depth_beyond(other) for other in self.movable_on(joint.child)), default=0)

    def carries_independent(self, joint: UrdfJoint) -> bool:
        """Whether a joint beyond this one moves by itself."""
        beyond = {*self.beyond(joint.child)}
        return any(other.mimic is None for other in self.urdf.movable_joints if other.parent in beyond)

    def beyond(self, link: str) -> tuple[str, ...]:
        """Every link that moves with `link`, itself first."""
        links = [link]
        for joint in self.urdf.joints.values():
            if joint.parent in links:
                links.append(joint.child)
        return tuple(links)

    def pose_in(self, root: str, link: str) -> Array:
        """Pose of a link in another one that carries it, shape (4, 4), joints between them at 0."""
        X = np.eye(4)
        while link != root:
            X = self.carriers[link].X_PJ @ X
            link = self.carriers[link].parent
        return X
