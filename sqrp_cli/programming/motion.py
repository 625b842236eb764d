"""The motion of a candidate: reachable, within all limits, free of collisions, and the fastest of its kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import JointMove, MotionValue, Skill, StraightMove
from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.branch_search import Station, fastest_sequence
from sqrp_cli.programming.collision import CollisionScene, PlacedScene
from sqrp_cli.programming.ground_primitives import (
    GroundPrimitive,
    GroundSkill,
    ground_primitives,
    start_configuration,
)
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.inverse_kinematics import all_solutions
from sqrp_cli.programming.kinematics import RobotModel
from sqrp_cli.programming.straight_line import ToolLine, follow, limit_reason
from sqrp_cli.programming.timing import MotionLimits, joint_move, joint_move_duration, time_path
from sqrp_cli.trajectory import Trajectory

MAX_REASONS = 5
"""Reasons given for an infeasible motion; more branches may have failed for the same or other ones."""


@dataclass(frozen=True, eq=False)
class TimedPrimitive:
    """A primitive action with its place in time.

    start, end: [s] from the start of the motion. trajectory: of the arm joints, from 0 to end - start.
    held: the object in the tool all through it (grasp attaches and release detaches at `end`), with its pose in the tool
    frame `X_TO`, shape (4, 4); None if there is none. X_WO: where the objects that are not held rest.
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
    """How the arm moves through a skill.

    joint_names: the arm joints, in the order of all joint positions. primitives: without gaps, in order.
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

    binding: the object that each skill parameter stands for. values: of every motion parameter. world: before the skill.
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


@dataclass(frozen=True, eq=False)
class _Branch:
    """One way through a section: where its joint move ends, and the trajectories of the tied primitives.

    turns: offsets by whole turns of joints that keep all of it within the joints' limits, shape (k, n).
    """

    q: Array
    trajectories: tuple[Trajectory, ...]
    turns: Array

    @property
    def q_end(self) -> Array:
        return _end(self.trajectories[-1]) if self.trajectories else self.q

    @property
    def duration(self) -> float:
        return sum(trajectory.duration for trajectory in self.trajectories)


class _Planner:
    """Plans one motion and collects why branches fail."""

    def __init__(self, model: RobotModel, scene: CollisionScene, skill: GroundSkill, q_start: Array) -> None:
        self._model, self._skill, self._q_start = model, skill, q_start
        self._limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
        self._scenes = [scene.placed(primitive.world, primitive.allowed) for primitive in skill.primitives]
        self._turning = scene.bound.turning
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
            joint_move_duration(before.q_end[:, None], after.q_start[None], self._move_limits(section.move))
            for before, after, section in zip(stations[:-1], stations[1:], sections[1:], strict=True)
        ]

        @cache
        def tied_is_free(i: int, branch: _Branch) -> bool:
            return all(self._is_free(sections[i].first + k, t) for k, t in enumerate(branch.trajectories))

        def works(i: int, previous: int, chosen: int) -> bool:
            if not tied_is_free(i, options[i][chosen][0]):
                return False
            move = sections[i].move
            if move is None:
                return True
            ends = stations[i - 1].q_end[previous], stations[i].q_start[chosen]
            return self._is_free(sections[i].first - 1, joint_move(*ends, self._move_limits(move)))

        chosen = fastest_sequence(stations, durations, works)
        if chosen is None:
            return self._infeasible()
        return self._motion(sections, [ways[k] for ways, k in zip(options, chosen, strict=True)])

    def _branches(self, section: _Section) -> list[_Branch]:
        """The branches of a section that can be followed, and that are free of contacts where its joint move ends."""
        move, fixed = section.move, section.move is None or section.move.home
        if move is None:
            configurations = [self._q_start]
        elif move.home:
            configurations = [self._model.home]
        else:
            solutions = all_solutions(self._model, move.X_end)
            configurations = list(solutions.solutions)
            if not configurations:
                self._failures.append((section.first - 1, f"{move.name}: `{move.to}` {solutions.reason}"))
        branches = []
        for q in configurations:
            if move is not None and (contact := self._scenes[section.first - 1].check(q)) is not None:
                self._failures.append((section.first - 1, f"{contact} at the end of {move.name}"))
                continue
            trajectories = self._tied_trajectories(section, q)
            if trajectories is None:
                continue
            turns = self._turns(section, q, trajectories, fixed)
            if len(turns):
                branches.append(_Branch(q, trajectories, turns))
        return branches

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
