"""One kinematics of a robot with its tool and fingers: every joint and link as a tree of matrices, and its arm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Mask, cross, read_only
from sqrp_cli.kernel.kernel import joint_poses
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import JointLimits, Robot
from sqrp_cli.robot.urdf import UrdfJoint
from sqrp_cli.shapes import Part
from sqrp_cli.trajectory import JointSpan

Mount = tuple[int, Array]
"""What a link is rigidly fixed to: the index of a joint, -1 for the world, and the pose of the link in it, (4, 4)."""


def driving_joints(chain: Sequence[UrdfJoint], joints: Iterable[UrdfJoint]) -> list[UrdfJoint]:
    """The joints that drive those of a chain, in its order: the arm's, where the chain leads to its tool.

    They are the movable ones that follow no other. Where a joint with independent ones after it follows one beside the
    chain, such as the motor of a parallel linkage, the arm is driven by that one. joints: all of the robot.
    """
    named = {joint.name: joint for joint in joints}
    moving = [joint for joint in chain if joint.movable]
    last = max((place for place, joint in enumerate(moving) if joint.mimic is None), default=-1)
    within = [joint if joint.mimic is None else named[joint.mimic.joint] for joint in moving[: last + 1]]
    return list(dict.fromkeys(within))


@dataclass(frozen=True, eq=False)
class JointTree:
    """N movable joints, parents first, and the links that they carry.

    A joint at position q has the pose `A + sin(q) B + (1 - cos(q)) C` in its parent if it turns (Rodrigues' formula),
    and `A + q B` if it slides.
    """

    joints: tuple[UrdfJoint, ...]  # as in the URDFs
    parents: tuple[int, ...]  # index of each joint's parent, -1 for the world
    turns: Mask  # whether each joint turns, shape (N,); the others slide
    axes: Array  # unit vectors in the joints' frames, shape (N, 3)
    terms: Array  # the matrices A (the pose at position 0), B and C of each joint, shape (N, 3, 4, 4)
    mounts: dict[str, Mount]  # what carries each link of robot and tool
    with_links: tuple[NDArray[np.int64], Mask, Array, Mapping[str, int]]
    """Parents, turns and terms with a joint at rest for each link beside the one that carries it; rows of links."""
    ratios: Array
    offsets: Array
    """Positions of all joints are `q @ ratios.T + offsets` [rad or m]: from those of the n driven ones, with shapes
    (N, n) and (N,); see `driven_by`."""

    @staticmethod
    def of(robot: Robot) -> JointTree:
        """All movable joints, all driven, and all links of a robot and its tool, placed in the world."""
        joints: list[UrdfJoint] = []
        seats: list[Mount] = []  # of the joints at position 0
        mounts: dict[str, Mount] = {}

        for urdf in robot.urdfs:
            mounts[urdf.root] = -1, robot.X_WB
            if robot.tool is not None and urdf is robot.tool.urdf:
                carrier, X_JL = mounts[robot.tool.link]
                mounts[urdf.root] = carrier, X_JL @ robot.tool.X_LT
            for joint in urdf.joints.values():
                carrier, X_JL = mounts[joint.parent]
                mounts[joint.child] = carrier, X_JL @ joint.X_PJ
                if joint.movable:
                    joints.append(joint)
                    seats.append(mounts[joint.child])
                    mounts[joint.child] = len(joints) - 1, np.eye(4)
        axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
        still = np.array([X_JL for _, X_JL in seats]).reshape(-1, 4, 4)
        turns = np.array([joint.type != "prismatic" for joint in joints], dtype=bool)
        motion = np.zeros_like(still)
        motion[turns, :3, :3] = np.cross(axes[turns, None, :], np.eye(3)).swapaxes(1, 2)
        motion[~turns, :3, 3] = axes[~turns]
        parents, terms = (
            [carrier for carrier, _ in seats],
            np.stack([still, still @ motion, still @ motion @ motion], axis=1),
        )
        beside = {link: on for link, on in mounts.items() if on[0] >= 0 and not np.array_equal(on[1], np.eye(4))}
        resting = np.zeros((len(beside), 3, 4, 4))
        resting[:, 0] = [X_JL for _, X_JL in beside.values()] or resting[:, 0]
        rows = {link: joint for link, (joint, _) in mounts.items()}
        with_links = (
            np.array([*parents, *(joint for joint, _ in beside.values())]),
            np.concatenate([turns, np.zeros(len(beside), dtype=bool)]),
            np.concatenate([terms, resting]),
            rows | {link: len(parents) + k for k, link in enumerate(beside)},
        )
        return JointTree(
            joints=tuple(joints),
            parents=tuple(parents),
            turns=turns,
            axes=axes,
            terms=terms,
            mounts=mounts,
            with_links=with_links,
            ratios=np.eye(len(joints)),
            offsets=np.zeros(len(joints)),
        )

    def driven_by(self, driven: Sequence[int], rest: Mapping[str, float]) -> JointTree:
        """The same tree, driven by these joints, given by index.

        Joints that mimic another one follow it unless they are driven themselves. The others rest at their position in
        `rest`, else at their `UrdfJoint.rest`.
        """
        ratios, offsets = np.zeros((len(self.joints), len(driven))), np.zeros(len(self.joints))
        ratios[driven, range(len(driven))] = 1.0
        for row, joint in enumerate(self.joints):
            if joint.mimic is None and row not in driven:
                offsets[row] = rest.get(joint.name, joint.rest)
        for row, joint in enumerate(self.joints):
            if joint.mimic is not None and row not in driven:
                leader = self.index(joint.mimic.joint)
                ratios[row] = joint.mimic.multiplier * ratios[leader]
                offsets[row] = joint.mimic.multiplier * offsets[leader] + joint.mimic.offset
        return replace(self, ratios=ratios, offsets=offsets)

    def index(self, joint: str) -> int:
        """The index of a joint by its name."""
        return [one.name for one in self.joints].index(joint)

    def chain(self, link: str) -> list[int]:
        """Indices of the joints that carry a link, from the world outwards."""
        chain, joint = [], self.mounts[link][0]
        while joint >= 0:
            chain.append(joint)
            joint = self.parents[joint]
        return chain[::-1]

    def poses(self, positions: Array) -> Array:
        """World poses X_WJ of all joints, shape (m, N, 4, 4), at positions of shape (m, N) [rad or m]."""
        return joint_poses(np.array(self.parents), self.turns, self.terms, positions).swapaxes(0, 1)

    def positions(self, q: Array) -> Array:
        """Positions of all joints, shape (..., N), from those of the driven ones, shape (..., n)."""
        return q @ self.ratios.T + self.offsets

    def link_poses(self, positions: Array) -> dict[str, Array]:
        """World pose X_WL of every link, shape (m, 4, 4) each, at positions of all joints, shape (m, N)."""
        parents, turns, terms, rows = self.with_links
        rest = np.zeros((len(positions), len(parents) - len(self.joints)))
        X_WL = joint_poses(parents, turns, terms, np.concatenate([positions, rest], axis=1))
        return {
            link: X_JL[None].repeat(len(positions), axis=0) if joint < 0 else X_WL[rows[link]]
            for link, (joint, X_JL) in self.mounts.items()
        }


@dataclass(frozen=True, eq=False)
class FingerModel(JointLimits[Array]):
    """The fingers of a gripper with the limits of f joints; without any, f is 0. Positions in rad or m, (f,) each."""

    joints: tuple[str, ...]  # names of the f joints that drive them
    open: Array
    closed: Array
    links: frozenset[str]
    """All links that these joints move."""
    width: float | None = None  # clear width between them when open, if stated [m]; closed, it is 0


@dataclass(frozen=True, eq=False)
class RobotModel(JointLimits[Array]):
    """A robot with its tool, placed in the world, that moves with the joints of its arm and its fingers.

    The arm's n joints are those that drive the ones from the robot's root to the tool frame. Joints of neither arm nor
    fingers rest at 0 or the limit nearest to it; joints that mimic another one follow it. Positions and limits of the
    arm's joints are in rad or m, and s, of shape (n,) each.
    """

    arm: tuple[str, ...]  # names of the arm's joints, from the root outwards
    turns: Mask  # which of them turn; the others slide
    home: Array
    """Their positions at the start of a program."""
    links: tuple[str, ...]  # all of robot and tool
    joints: tuple[str, ...]  # names of those that are driven: of the arm, then of the fingers; n + f of them
    fingers: FingerModel  # those of its gripper
    tool_links: frozenset[str]
    hand_links: frozenset[str]
    """The links that may touch a grasped object: those of the tool, and the robot's own fingers."""
    still_links: frozenset[str]
    """The links that no driven joint moves."""
    tool_frame: str
    """The link that grasps."""
    parts: tuple[Part, ...]  # the solid parts of robot and tool
    adjacent_pairs: frozenset[tuple[str, str]]
    """Links with parts, each pair in alphabetical order, that are rigidly connected or meet at a joint."""
    angle_tolerance: float
    """By how much the tool may be turned away from a pose that it is to take [rad]; 0 with six axes or more."""
    tree: JointTree  # every joint and link of robot and tool, driven by the joints of arm and fingers
    _chain: JointTree  # of the joints that carry the tool frame, driven by those of the arm; mounts are of no use

    @staticmethod
    def load(robot: Robot) -> RobotModel:
        """Put robot and tool together; names are as `RobotReader` checks them."""
        tree, moved = JointTree.of(robot), robot.fingers
        chain = tree.chain(robot.tool_frame)
        arm = [tree.index(joint.name) for joint in driving_joints([tree.joints[k] for k in chain], tree.joints)]
        names = () if moved is None else tuple(moved.open)
        named = [{joint.name, joint.mimic.joint if joint.mimic else joint.name} for joint in tree.joints]
        driving = {index for index, either in enumerate(named) if either & {*names}}
        fingers = FingerModel(
            joints=names,
            open=read_only([] if moved is None else [moved.open[name] for name in names]),
            closed=read_only([] if moved is None else [moved.closed[name] for name in names]),
            **_limit_arrays([tree.joints[tree.index(name)] for name in names], robot),
            links=frozenset(link for link in tree.mounts if driving.intersection(tree.chain(link))),
            width=None if moved is None else moved.width,
        )
        carried = sorted({(part.parent, tree.mounts[part.parent][0]) for part in robot.parts})
        adjacent = frozenset(
            (one, other)
            for (one, a), (other, b) in combinations(carried, 2)
            if a == b or (a >= 0 and tree.parents[a] == b) or (b >= 0 and tree.parents[b] == a)
        )
        of_arm = tree.driven_by(arm, robot.rest)
        driven = tree.driven_by([*arm, *map(tree.index, fingers.joints)], robot.rest)
        moves, of_tool = (driven.ratios != 0.0).any(axis=1), frozenset(robot.tool.urdf.links if robot.tool else ())
        names = tuple(tree.joints[index].name for index in arm)
        return RobotModel(
            arm=names,
            links=tuple(tree.mounts),
            joints=(*names, *fingers.joints),
            turns=tree.turns[arm],
            **_limit_arrays([tree.joints[index] for index in arm], robot),
            home=read_only([robot.home.get(tree.joints[index].name, tree.joints[index].rest) for index in arm]),
            fingers=fingers,
            tool_links=of_tool,
            hand_links=of_tool | fingers.links | {tree.joints[index].parent for index in driving},
            still_links=frozenset(link for link in tree.mounts if not moves[tree.chain(link)].any()),
            tool_frame=robot.tool_frame,
            parts=robot.parts,
            adjacent_pairs=adjacent,
            angle_tolerance=robot.angle_tolerance,
            tree=driven,
            _chain=replace(
                of_arm,
                joints=tuple(tree.joints[row] for row in chain),
                parents=tuple(range(-1, len(chain) - 1)),
                turns=tree.turns[chain],
                axes=tree.axes[chain],
                terms=tree.terms[chain],
                ratios=of_arm.ratios[chain],
                offsets=of_arm.offsets[chain],
            ),
        )

    @cached_property
    def position_limits(self) -> JointSpan:
        """Position limits of the driven joints, n + f of them."""
        fingers = self.fingers
        return JointSpan(np.concatenate([self.lower, fingers.lower]), np.concatenate([self.upper, fingers.upper]))

    @cached_property
    def home_links(self) -> Mapping[str, Array]:
        """World pose X_WL of every link with the arm at home and the fingers open, shape (4, 4) each."""
        return {link: X_WL[0] for link, X_WL in self.link_poses(self.home[None]).items()}

    def with_fingers(self, q: Array, fingers: Array | None = None) -> Array:
        """Positions of all driven joints, shape (..., n + f), from those of the arm, (..., n), unless q has all.

        fingers: their positions, shape (f,); open by default.
        """
        if q.shape[-1] == len(self.joints):
            return q
        added = self.fingers.open if fingers is None else fingers
        return np.concatenate([q, np.broadcast_to(added, (*q.shape[:-1], len(added)))], axis=-1)

    def link_poses(self, q: Array) -> Mapping[str, Array]:
        """World pose X_WL of every link, shape (m, 4, 4) each, at m positions of the driven joints, shape (m, n + f).

        With those of the arm alone, shape (m, n), the fingers are open.
        """
        return self.tree.link_poses(self.tree.positions(self.with_fingers(q)))

    def tool_pose(self, q: Array) -> Array:
        """World pose X_WT of the tool frame, shape (4, 4), at arm positions of shape (n,)."""
        X_WT: Array = self.tool_poses(q[None, : len(self.arm)])[0]
        return X_WT

    def tool_poses(self, q: Array) -> Array:
        """As `tool_pose` at m positions of shape (m, n): shape (m, 4, 4)."""
        return self._chain.poses(self._chain.positions(q))[:, -1] @ self.tree.mounts[self.tool_frame][1]

    def tool_poses_and_jacobians(self, q: Array) -> tuple[Array, Array]:
        """As `tool_pose`, (m, 4, 4), and its Jacobians, at m positions of shape (m, n).

        These have shape (m, 6, n): velocity over angular velocity, in world axes.
        """
        X_WJ = self._chain.poses(self._chain.positions(q))
        X_WT = X_WJ[:, -1] @ self.tree.mounts[self.tool_frame][1]
        axes = (X_WJ[:, :, :3, :3] @ self._chain.axes[:, :, None])[..., 0]
        arms = X_WT[:, None, :3, 3] - X_WJ[:, :, :3, 3]
        columns = np.concatenate([cross(axes, arms), axes], axis=-1)
        if not (turns := self._chain.turns).all():
            columns[:, ~turns, :3], columns[:, ~turns, 3:] = axes[:, ~turns], 0.0
        return X_WT, np.swapaxes(columns, 1, 2) @ self._chain.ratios

    @property
    def joints_move_alone(self) -> bool:
        """Whether no joint on the way to the tool frame follows another one."""
        return all(joint.mimic is None for joint in self._chain.joints)

    def joint_lines(self, q: Array) -> Array:
        """The axes of the arm's joints, in the world, and a point on each [m], at m positions (m, n); (2, m, n, 3)."""
        X_WJ = self._chain.poses(self._chain.positions(q))
        own = (self._chain.ratios != 0.0).argmax(axis=0)  # the first that a joint of the arm moves
        axes = (X_WJ[:, :, :3, :3] @ self._chain.axes[:, :, None])[..., 0]
        return np.stack([axes[:, own], X_WJ[:, :, :3, 3][:, own]])

    def joint_origins(self, q: Array) -> Array:
        """World position [m] of each arm joint's origin, shape (n, 3), at arm positions of shape (n,)."""
        origins: Array = self.joint_lines(q[None])[1, 0]
        return origins

    def joint_values(self, q: Array) -> dict[str, float]:
        """Position [rad or m] of every movable joint of robot and tool, at positions as `link_poses` takes them."""
        positions = self.tree.positions(self.with_fingers(q)).tolist()
        return {joint.name: value for joint, value in zip(self.tree.joints, positions, strict=True)}


def positions_of(joints: Sequence[str], values: Mapping[str, float]) -> Array:
    """Positions of some joints in order, such as of the arm's or the fingers', from those of joints by name."""
    return np.array([values[name] for name in joints])


def _limit_arrays(joints: Sequence[UrdfJoint], robot: Robot) -> dict[str, Array]:
    """Each of the limits of some joints."""
    limits = [robot.limits[joint.name] for joint in joints]
    return {part.name: read_only([getattr(one, part.name) for one in limits]) for part in fields(JointLimits)}
