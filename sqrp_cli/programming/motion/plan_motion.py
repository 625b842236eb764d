"""The motion of a candidate: the fastest one that is reachable, within limits and free of collisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.arm.inverse_kinematics import FIRST_HELD, MORE_REDUNDANCY_SAMPLES, REDUNDANCY_SAMPLES
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision import CollisionScene
from sqrp_cli.programming.motion.fingers import with_fingers
from sqrp_cli.programming.motion.ground_primitives import GroundSkill, SkillUse, ground_primitives
from sqrp_cli.programming.motion.paths.branch_search import fastest_sequence
from sqrp_cli.programming.motion.paths.joint_moves import JointMoves, Move
from sqrp_cli.programming.motion.paths.position_limits import worst_past_limit
from sqrp_cli.programming.motion.paths.sections import BranchFinder, Failures, Ways, cut_into_sections
from sqrp_cli.trajectory import JointPath, Trajectory

MOST_AXES_WITHOUT_REDUNDANCY = 6
"""Arms with more axes reach a pose in infinitely many ways; some of them are tried."""

MEASURED = 1e-3
"""Largest measured excess over a limit at the start of a motion, which then starts at the limit [rad or m]."""

MAX_REASONS = 5
"""Most reasons of an infeasible motion."""


@dataclass(frozen=True, eq=False)
class TimedPrimitive:
    """A primitive action with its place in time."""

    name: str

    start: float
    end: float
    """[s] from the start of the motion."""

    trajectory: Trajectory
    """Of the driven joints, from 0 to end - start."""

    held: str | None
    """The object in the tool during it, None if there is none: grasp attaches and release detaches at `end`."""

    X_TO: Array | None
    """Pose of the held object in the tool frame, shape (4, 4); None if there is none."""

    X_WO: Mapping[str, Array]
    """Poses of the objects that are not held."""

    around: str | None = None
    """The link or object that it goes around, None if it is direct."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of arm and fingers through a skill."""

    joint_names: tuple[str, ...]
    """The driven joints, in the order of all joint positions: those of the arm, then those of the fingers."""

    primitives: tuple[TimedPrimitive, ...]
    """Without gaps, in order."""

    final: World
    """The world after it, with the facts from before; X_WO of a held object is its final pose."""

    @property
    def ways_around(self) -> tuple[str, ...]:
        """Detours, such as `a1 goes around wall`."""
        return tuple(f"{p.name} goes around {p.around}" for p in self.primitives if p.around is not None)

    @property
    def time(self) -> float:
        """Duration of the whole [s]."""
        return self.primitives[-1].end if self.primitives else 0.0

    def positions(self, primitive: int, t: Array) -> Array:
        """Joint positions at times t [s] from the start of the motion, within one primitive: shapes (m,) -> (m, n)."""
        return self.primitives[primitive].trajectory.positions(np.asarray(t) - self.primitives[primitive].start)


def plan_motion(use: SkillUse, scene: CollisionScene, seed: int = 0) -> Motion | Infeasible:
    """The fastest feasible motion of a skill among all branches of inverse kinematics, joint turns included.

    seed: of the random ways around and redundant joints. Every move keeps its clearance at all times. Joint moves are
    straight in joint space; ways around are searched only if no combination of branches has direct moves throughout,
    the most promising combination first. For an arm with more than six axes, more positions of its redundant joints are
    tried if a few are not enough. Infeasible names, most useful first, what is out of reach, which joint is at its
    limit, or which contact occurs where.
    """
    use = replace(use, world=_at_limits(scene.model, use.world))
    begin = np.array([use.world.joints[name] for name in scene.model.joints])
    if (past := worst_past_limit(scene.model, JointPath.line(begin, begin))) is not None:
        return Infeasible((f"{past} before anything moves",))
    grounded = ground_primitives(use, scene)
    if isinstance(grounded, Infeasible):
        return grounded
    q_start = scene.model.arm_positions(use.world.joints)
    planner = _Planner(scene, grounded, q_start, seed, REDUNDANCY_SAMPLES)
    motion = planner.plan()
    if len(scene.model.arm) <= MOST_AXES_WITHOUT_REDUNDANCY or isinstance(motion, Motion) or planner.is_out_of_reach:
        return motion
    return _Planner(scene, grounded, q_start, seed, MORE_REDUNDANCY_SAMPLES).plan()


def _at_limits(model: RobotModel, world: World) -> World:
    """The world with joints that are measured to be just past a limit at that limit."""
    lower, upper = model.position_limits
    within = {
        name: min(max(world.joints[name], low), high)
        for name, low, high in zip(model.joints, lower.tolist(), upper.tolist(), strict=True)
        if low - MEASURED <= world.joints[name] <= high + MEASURED
    }
    return replace(world, joints={**world.joints, **within})


class _Planner:
    """Plans one motion: sections, the branches of each, and the moves between them."""

    def __init__(self, scene: CollisionScene, skill: GroundSkill, q_start: Array, seed: int, samples: int) -> None:
        self._model, self._skill, self._q_start, self._seed = scene.model, skill, q_start, seed
        self._samples = samples
        placed = cache(scene.placed)
        self._scenes = [placed(primitive.world, primitive.allowed) for primitive in skill.primitives]
        self._failures = Failures()

    def plan(self) -> Motion | Infeasible:
        model, scenes, failures = self._model, self._scenes, self._failures
        sections = cut_into_sections(self._skill.primitives)
        finder = BranchFinder(model, scenes, self._q_start, failures, self._seed, self._samples)
        ways: list[Ways] = []
        for section in sections:
            branches = finder.branches(section)
            if not branches:
                return self._infeasible()
            ways.append(Ways.through(branches))
        moves = JointMoves(model, self._skill.primitives, scenes, sections, ways, self._q_start, failures, self._seed)
        durations = moves.durations()
        chosen = fastest_sequence(ways, durations, moves.direct_works)
        if chosen is None:
            chosen = fastest_sequence(ways, durations, moves.direct_works, moves.way_works)
        if chosen is None:
            return self._infeasible(moves.tries)
        along = moves.along(chosen)
        if isinstance(along, Infeasible):
            return along
        done: list[Move] = []
        for through, k, move in zip(ways, chosen, [None, *along], strict=True):
            done += [move] if move is not None else []
            done += map(Move, through.trajectories(k))
        motion = self._motion(done, ways[-1].q_end[chosen[-1]])
        for primitive in motion.primitives:
            if (past := worst_past_limit(model, primitive.trajectory.path)) is not None:
                return Infeasible((f"{primitive.name}: {past}",))
        return motion

    @property
    def is_out_of_reach(self) -> bool:
        """Whether a waypoint is out of reach, obstacles ignored."""
        return self._failures.out_of_reach

    def _infeasible(self, tries: int = 0) -> Infeasible:
        """The collected reasons, with the number of tries to find a way around."""
        reasons = self._failures.reasons(MAX_REASONS)
        if self._samples > REDUNDANCY_SAMPLES:
            joint = self._model.arm[FIRST_HELD]
            reasons = (f"{reasons[0]}, with {self._samples} positions of `{joint}` tried", *reasons[1:])
        if tries > 0:
            reasons = (f"{reasons[0]}, and no way around was found in {tries:,} tries", *reasons[1:])
        return Infeasible(reasons)

    def _motion(self, moves: Sequence[Move], q_end: Array) -> Motion:
        """The motion of one move for each primitive, which ends at q_end, shape (n,)."""
        primitives, start = [], 0.0
        for primitive, move in zip(self._skill.primitives, moves, strict=True):
            world, end = primitive.world, start + move.trajectory.duration
            resting_fingers = self._model.finger_positions(world.joints)
            moving = with_fingers(self._model, move.trajectory, primitive.fingers, resting_fingers)
            resting = {name: X_WO for name, X_WO in world.X_WO.items() if name != world.held}
            primitives.append(
                TimedPrimitive(
                    name=primitive.name,
                    start=start,
                    end=end,
                    trajectory=moving,
                    held=world.held,
                    X_TO=world.X_TO,
                    X_WO=resting,
                    around=move.around,
                )
            )
            start = end
        return Motion(self._model.joints, tuple(primitives), self._final(q_end))

    def _final(self, q: Array) -> World:
        world = self._skill.final
        X_WO = dict(world.X_WO)
        if world.held is not None and world.X_TO is not None:
            X_WO[world.held] = self._model.tool_pose(q) @ world.X_TO
        return replace(world, X_WO=X_WO, joints={**world.joints, **dict(zip(self._model.arm, q.tolist(), strict=True))})
