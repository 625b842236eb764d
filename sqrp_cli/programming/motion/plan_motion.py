"""The motion of a candidate: reachable, within all limits, free of collisions, and the fastest of its kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise, product

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import JointMove, MotionValue, Skill, StraightMove
from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.arm.branches import chosen_branches
from sqrp_cli.programming.arm.inverse_kinematics import all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.motion.branch_search import Station, fastest_sequence
from sqrp_cli.programming.motion.collision import CollisionScene, finger_positions
from sqrp_cli.programming.motion.fingers import with_fingers
from sqrp_cli.programming.motion.ground_primitives import (
    GroundPrimitive,
    GroundSkill,
    ground_primitives,
    start_configuration,
)
from sqrp_cli.programming.motion.straight_line import LIMIT_SAMPLES, LIMIT_SLACK, ToolLine, follow, limit_reason
from sqrp_cli.programming.motion.timing import MotionLimits, joint_move, joint_move_duration, time_path
from sqrp_cli.trajectory import Path, Trajectory

MAX_REASONS = 5
"""Reasons given for an infeasible motion."""


@dataclass(frozen=True, eq=False)
class TimedPrimitive:
    """A primitive action with its place in time.

    start, end: [s] from the start of the motion. trajectory: of the driven joints, from 0 to end - start.
    held: the object in the tool all through it (grasp attaches and release detaches at `end`), with its pose in the
    tool frame `X_TO`, shape (4, 4); None if there is none. X_WO: where the objects that are not held rest.
    """

    name: str
    start: float
    end: float
    trajectory: Trajectory
    held: str | None
    X_TO: Array | None
    X_WO: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Motion:
    """How arm and fingers move through a skill.

    joint_names: the driven joints, in the order of all joint positions: those of the arm, then those of the fingers.
    primitives: without gaps, in order.
    final: the world afterwards, with the facts of before; X_WO of a held object is its pose then.
    """

    joint_names: tuple[str, ...]
    primitives: tuple[TimedPrimitive, ...]
    final: World

    @property
    def time(self) -> float:
        """Duration of the whole [s]."""
        return self.primitives[-1].end if self.primitives else 0.0

    def positions(self, primitive: int, t: Array) -> Array:
        """Joint positions at times t [s] from the start of the motion, within one primitive: shapes (m,) -> (m, n)."""
        return self.primitives[primitive].trajectory.positions(np.asarray(t) - self.primitives[primitive].start)


def plan_motion(
    skill: Skill,
    binding: Mapping[str, str],
    values: Mapping[str, MotionValue],
    objects: Mapping[str, SceneObject],
    world: World,
    model: RobotModel,
    scene: CollisionScene,
) -> Motion | Infeasible:
    """The fastest feasible motion of a skill among all branches of inverse kinematics, joint turns included.

    binding: the object that each skill parameter stands for. values: of every motion parameter. world: before it.
    Joint moves are straight in joint space; every move keeps its clearance at all times. Infeasible names, most useful
    first, what is out of reach, which joint is at its limit, or what hits what and where.
    """
    grounded = ground_primitives(skill, binding, values, objects, world, model, scene)
    if isinstance(grounded, Infeasible):
        return grounded
    return _Planner(model, scene, grounded, start_configuration(model, world)).plan()


@dataclass(frozen=True, eq=False)
class _Section:
    """A joint move (none at the start of the motion) and what is tied to where it ends, up to the next joint move.

    first: index of the first tied primitive in the skill.
    """

    move: GroundPrimitive | None
    first: int
    tied: tuple[GroundPrimitive, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether it begins at given joint positions, not at any that bring the tool to a pose."""
        return self.move is None or self.move.home


@dataclass(frozen=True, eq=False)
class _Branch:
    """One way through a section: where its joint move ends, and the trajectories of the tied primitives.

    turns: offsets by whole turns of joints that keep all of it within the joints' limits, shape (k, n).
    """

    q: Array
    trajectories: tuple[Trajectory, ...]
    turns: Array

    @cached_property
    def q_end(self) -> Array:
        return _end(self.trajectories[-1]) if self.trajectories else self.q

    @cached_property
    def duration(self) -> float:
        return sum(trajectory.duration for trajectory in self.trajectories)


class _Planner:
    """Plans one motion and collects why branches fail."""

    def __init__(self, model: RobotModel, scene: CollisionScene, skill: GroundSkill, q_start: Array) -> None:
        self._model, self._skill, self._q_start = model, skill, q_start
        self._limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
        placed = cache(scene.placed)
        self._scenes = [placed(primitive.world, primitive.allowed) for primitive in skill.primitives]
        self._failures: list[tuple[int, str]] = []

    def plan(self) -> Motion | Infeasible:
        sections = _sections(self._skill.primitives)
        options: list[list[tuple[_Branch, Array]]] = []
        for section in sections:
            options.append([(branch, turn) for branch in self._branches(section) for turn in branch.turns])
            if not options[-1]:
                return self._infeasible()
        stations = [_station(ways) for ways in options]
        durations = [
            self._move_durations(before.q_end[:, None], after.q_start[None], section.move)
            for before, after, section in zip(stations[:-1], stations[1:], sections[1:], strict=True)
        ]

        @cache
        def tied_is_free(i: int, branch: _Branch) -> bool:
            tied = [(sections[i].first + k, t) for k, t in enumerate(branch.trajectories)]
            return all(self._is_free(k, t) and self._fingers_are_free(k, t) for k, t in tied)

        def works(i: int, previous: int, chosen: int) -> bool:
            if not tied_is_free(i, options[i][chosen][0]):
                return False
            move = sections[i].move
            if move is None:
                return True
            ends = stations[i - 1].q_end[previous], stations[i].q_start[chosen]
            return self._is_free(sections[i].first - 1, self._move(*ends, move))

        chosen = fastest_sequence(stations, durations, works)
        if chosen is None:
            return self._infeasible()
        return self._motion(sections, [ways[k] for ways, k in zip(options, chosen, strict=True)])

    def _branches(self, section: _Section) -> list[_Branch]:
        """The branches of a section that can be followed, and that are free of contacts where its joint move ends."""
        move = section.move
        if move is None:
            configurations = [self._q_start]
        elif move.home:
            configurations = [self._model.home]
        else:
            solutions = all_solutions(self._model, move.X_end)
            wanted = chosen_branches(self._model, solutions.solutions, move.branches)
            configurations = list(solutions.solutions[wanted])
            if not configurations:
                reason = solutions.reason or f"only in other ways than {move.branches}"
                self._failures.append((section.first - 1, f"{move.name} to `{move.to}`: {reason}"))
        branches = []
        lost = False
        for q in self._clear_ends(section, configurations):
            trajectories = self._tied_trajectories(section, q)
            if trajectories is None:
                lost = True
                continue
            turns = self._turns(section, q, trajectories)
            if len(turns):
                branches.append(_Branch(q, trajectories, turns))
        if lost and not branches:
            self._note_ends_out_of_reach(section)
        return branches

    def _note_ends_out_of_reach(self, section: _Section) -> None:
        """Where a line could not be followed because its very end is out of reach, that is the most useful reason."""
        for primitive in section.tied:
            if primitive.kind is StraightMove:
                solutions = all_solutions(self._model, primitive.X_end)
                if not len(solutions.solutions):
                    reason = f"{primitive.name} to `{primitive.to}`: {solutions.reason}"
                    self._failures.insert(0, (len(self._skill.primitives), reason))

    def _clear_ends(self, section: _Section, configurations: Sequence[Array]) -> list[Array]:
        """The configurations that a section's joint move may end in without touching anything."""
        if section.move is None or not configurations:
            return list(configurations)
        contacts = self._scenes[section.first - 1].check_all(np.stack(configurations))
        ends = f"at the end of {section.move.name}"
        self._failures += [(section.first - 1, f"{contact} {ends}") for contact in contacts if contact is not None]
        return [q for q, contact in zip(configurations, contacts, strict=True) if contact is None]

    def _tied_trajectories(self, section: _Section, q: Array) -> tuple[Trajectory, ...] | None:
        trajectories: list[Trajectory] = []
        for k, primitive in enumerate(section.tied):
            if primitive.kind is StraightMove:
                line = ToolLine(primitive.X_start, primitive.X_end)
                path = follow(self._model, q, line)
                if isinstance(path, Infeasible):
                    self._failures += [(section.first + k, f"{primitive.name}: {reason}") for reason in path.reasons]
                    return None
                trajectories.append(_straight_move(path, line, primitive, self._limits))
                q = _end(trajectories[-1])
            else:
                trajectories.append(Trajectory.standstill(q, primitive.hold))
        return tuple(trajectories)

    def _turns(self, section: _Section, q: Array, trajectories: Sequence[Trajectory]) -> Array:
        """Offsets by whole turns that keep a branch within the joints' limits, shape (k, n); only 0 if q is given.

        A joint without limits goes at most one turn beyond where it is at the start and at home.
        """
        s = np.linspace(0.0, 1.0, LIMIT_SAMPLES)
        passed = np.concatenate([q[None], *(trajectory.path.positions(s) for trajectory in trajectories)])
        near = np.stack([self._q_start, self._model.home])
        lower = np.where(np.isinf(self._model.lower), near.min(axis=0) - 2 * np.pi, self._model.lower)
        upper = np.where(np.isinf(self._model.upper), near.max(axis=0) + 2 * np.pi, self._model.upper)
        fewest = np.ceil((lower - LIMIT_SLACK - passed.min(axis=0)) / (2 * np.pi))
        most = np.floor((upper + LIMIT_SLACK - passed.max(axis=0)) / (2 * np.pi))
        if section.is_fixed:
            fewest, most = np.maximum(fewest, 0.0), np.minimum(most, 0.0)
        fewest[~self._model.turns], most[~self._model.turns] = 0.0, 0.0
        ranges = [np.arange(low, high + 1) for low, high in zip(fewest, most, strict=True)]
        turns = 2 * np.pi * np.array(list(product(*ranges))).reshape(-1, len(q))
        if not len(turns):
            for k, (primitive, trajectory) in enumerate(zip(section.tied, trajectories, strict=True)):
                reason = limit_reason(self._model, trajectory.path, ToolLine(primitive.X_start, primitive.X_end))
                if reason is not None:
                    self._failures.append((section.first + k, f"{primitive.name}: {reason}"))
                    break
        return turns

    def _is_free(self, index: int, trajectory: Trajectory) -> bool:
        """Whether nothing touches during a primitive; notes what does, and when."""
        contact = self._scenes[index].check_motion(trajectory)
        if contact is not None:
            share = trajectory.law.time_at(contact.s) / trajectory.duration if trajectory.duration > 0 else 0.0
            self._failures.append((index, f"{contact} at {100 * share:.0f} % of {self._skill.primitives[index].name}"))
        return contact is None

    def _fingers_are_free(self, index: int, trajectory: Trajectory) -> bool:
        """Whether the fingers touch nothing as they move during a primitive; notes what they do."""
        primitive = self._skill.primitives[index]
        if primitive.fingers is None:
            return True
        contact = self._scenes[index].check_fingers(_end(trajectory), _end(primitive.fingers))
        if contact is not None:
            self._failures.append((index, f"{contact} as the fingers move in {primitive.name}"))
        return contact is None

    def _move_durations(self, q0: Array, q1: Array, move: GroundPrimitive | None) -> Array:
        """Durations [s] of joint moves from q0 to q1, shapes (..., n) that broadcast."""
        limits = self._move_limits(move)
        if move is None or not move.via_home:
            return joint_move_duration(q0, q1, limits)
        home = self._model.home
        return joint_move_duration(q0, home, limits) + joint_move_duration(home, q1, limits)

    def _move(self, q0: Array, q1: Array, move: GroundPrimitive) -> Trajectory:
        limits = self._move_limits(move)
        if not move.via_home:
            return joint_move(q0, q1, limits)
        return joint_move(q0, self._model.home, limits).followed_by(joint_move(self._model.home, q1, limits))

    def _move_limits(self, move: GroundPrimitive | None) -> MotionLimits:
        share = 1.0 if move is None else move.speed
        return replace(self._limits, velocity=share * self._limits.velocity)

    def _infeasible(self) -> Infeasible:
        """The reasons collected, those of the branches that got furthest first."""
        furthest_first = sorted(self._failures, key=lambda failure: -failure[0])
        return Infeasible(tuple(dict.fromkeys(reason for _, reason in furthest_first))[:MAX_REASONS])

    def _motion(self, sections: Sequence[_Section], chosen: Sequence[tuple[_Branch, Array]]) -> Motion:
        q = self._q_start
        trajectories = []
        for section, (branch, turn) in zip(sections, chosen, strict=True):
            if section.move is not None:
                trajectories.append(self._move(q, branch.q + turn, section.move))
            trajectories += [Trajectory(t.path.shifted(turn), t.law) for t in branch.trajectories]
            q = branch.q_end + turn
        primitives, start = [], 0.0
        for primitive, trajectory in zip(self._skill.primitives, trajectories, strict=True):
            world, end = primitive.world, start + trajectory.duration
            resting = {name: X_WO for name, X_WO in world.X_WO.items() if name != world.held}
            all_joints = with_fingers(self._model, trajectory, primitive.fingers, finger_positions(self._model, world))
            primitives.append(TimedPrimitive(primitive.name, start, end, all_joints, world.held, world.X_TO, resting))
            start = end
        return Motion(self._model.joints, tuple(primitives), self._final(q))

    def _final(self, q: Array) -> World:
        world = self._skill.final
        X_WO = dict(world.X_WO)
        if world.held is not None and world.X_TO is not None:
            X_WO[world.held] = self._model.tool_pose(q) @ world.X_TO
        return replace(world, X_WO=X_WO, joints={**world.joints, **dict(zip(self._model.arm, q.tolist(), strict=True))})


def _sections(primitives: Sequence[GroundPrimitive]) -> list[_Section]:
    """The primitives cut before each joint move; the first section has none, and may be empty."""
    cuts = [i for i, primitive in enumerate(primitives) if primitive.kind is JointMove]
    sections = [_Section(None, 0, tuple(primitives[: cuts[0] if cuts else None]))]
    for cut, following in pairwise([*cuts, len(primitives)]):
        sections.append(_Section(primitives[cut], cut + 1, tuple(primitives[cut + 1 : following])))
    return sections


def _station(ways: Sequence[tuple[_Branch, Array]]) -> Station:
    return Station(
        np.stack([branch.q + turn for branch, turn in ways]),
        np.stack([branch.q_end + turn for branch, turn in ways]),
        np.array([branch.duration for branch, _ in ways]),
    )


def _straight_move(path: Path, line: ToolLine, primitive: GroundPrimitive, limits: MotionLimits) -> Trajectory:
    """The motion along a tool line at the primitive's speed, or slower where the joints cannot keep up.

    A line on which the tool only turns has no speed; the joints alone limit it.
    """
    tool = np.array([primitive.speed, primitive.acceleration, primitive.jerk])
    if line.length > 1e-9:
        return time_path(path, limits, MotionLimits(*(tool / line.length)))
    if line.turn.any():
        return time_path(path, limits)
    return Trajectory.standstill(path.positions([0.0])[0], 0.0)


def _end(trajectory: Trajectory) -> Array:
    q: Array = trajectory.path.positions([1.0])[0]
    return q
