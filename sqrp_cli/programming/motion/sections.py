"""The parts of a motion between its joint moves: where each may begin, and the moves that are tied to that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill import JointMove, StraightMove
from sqrp_cli.programming.arm.branches import chosen_branches
from sqrp_cli.programming.arm.inverse_kinematics import all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.motion.collision import PlacedScene
from sqrp_cli.programming.motion.ground_primitives import GroundPrimitive
from sqrp_cli.programming.motion.straight_line import LIMIT_SAMPLES, LIMIT_SLACK, ToolLine, follow, limit_reason
from sqrp_cli.programming.motion.timing import MotionLimits, time_path
from sqrp_cli.trajectory import Path, Trajectory


@dataclass(frozen=True, eq=False)
class Section:
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
class Branch:
    """One way through a section: where its joint move ends, and the trajectories of the tied primitives.

    turns: offsets by whole turns of joints that keep all of it within the joints' limits, shape (k, n).
    """

    q: Array
    trajectories: tuple[Trajectory, ...]
    turns: Array

    @cached_property
    def q_end(self) -> Array:
        """Where the last of its trajectories ends, shape (n,)."""
        return end_of(self.trajectories[-1]) if self.trajectories else self.q

    @cached_property
    def duration(self) -> float:
        """Duration of its trajectories [s]."""
        return sum(trajectory.duration for trajectory in self.trajectories)


def cut_into_sections(primitives: Sequence[GroundPrimitive]) -> list[Section]:
    """The primitives cut before each joint move; the first section has none, and may be empty."""
    cuts = [i for i, primitive in enumerate(primitives) if primitive.kind is JointMove]
    sections = [Section(None, 0, tuple(primitives[: cuts[0] if cuts else None]))]
    for cut, following in pairwise([*cuts, len(primitives)]):
        sections.append(Section(primitives[cut], cut + 1, tuple(primitives[cut + 1 : following])))
    return sections


class Failures:
    """Why branches fail, each with the index of the primitive at which it does.

    out_of_reach: whether a waypoint is, whatever is in the way.
    """

    def __init__(self) -> None:
        self._found: list[tuple[int, str]] = []
        self.out_of_reach = False

    def note(self, index: int, reason: str) -> None:
        """Note a reason at a primitive."""
        self._found.append((index, reason))

    def reasons(self, most: int) -> tuple[str, ...]:
        """The different reasons, those of the branches that got furthest first, at most so many."""
        furthest_first = sorted(self._found, key=lambda failure: -failure[0])
        return tuple(dict.fromkeys(reason for _, reason in furthest_first))[:most]


class BranchFinder:
    """Finds the branches of sections, and notes why there are none.

    scenes: the surroundings of each primitive of the skill. seed, redundancy_samples: as of `all_solutions`.
    """

    def __init__(
        self,
        model: RobotModel,
        scenes: Sequence[PlacedScene],
        q_start: Array,
        failures: Failures,
        seed: int,
        redundancy_samples: int,
    ) -> None:
        self._model, self._scenes, self._q_start, self._failures = model, scenes, q_start, failures
        self._seed, self._samples = seed, redundancy_samples
        self._limits = MotionLimits(model.velocity, model.acceleration, model.jerk)

    def branches(self, section: Section) -> list[Branch]:
        """The branches of a section that can be followed, and that are free of contacts where its joint move ends."""
        move = section.move
        if move is None:
            configurations = [self._q_start]
        elif move.home:
            configurations = [self._model.home]
        else:
            solutions = all_solutions(self._model, move.X_end, self._seed, self._samples)
            wanted = chosen_branches(self._model, solutions.solutions, move.branches)
            configurations = list(solutions.solutions[wanted])
            self._failures.out_of_reach |= not len(solutions.solutions)
            if not configurations:
                reason = solutions.reason or f"cannot be reached with {move.branches}"
                self._failures.note(section.first - 1, f"{move.name} to `{move.to}`: {reason}")
        branches = []
        lost = False
        for q in self._clear_ends(section, configurations):
            trajectories = self._tied_trajectories(section, q)
            if trajectories is None:
                lost = True
                continue
            turns = self._turns(section, q, trajectories)
            if len(turns):
                branches.append(Branch(q, trajectories, turns))
        if lost and not branches:
            self._note_ends_out_of_reach(section)
        return branches

    def _note_ends_out_of_reach(self, section: Section) -> None:
        """Where a line could not be followed because its very end is out of reach, that is the most useful reason."""
        for primitive in section.tied:
            if primitive.kind is StraightMove:
                solutions = all_solutions(self._model, primitive.X_end, self._seed, self._samples)
                if not len(solutions.solutions):
                    reason = f"{primitive.name} to `{primitive.to}`: {solutions.reason}"
                    self._failures.note(len(self._scenes), reason)

    def _clear_ends(self, section: Section, configurations: Sequence[Array]) -> list[Array]:
        """The configurations that a section's joint move may end in without touching anything."""
        if section.move is None or not configurations:
            return list(configurations)
        contacts = self._scenes[section.first - 1].check_all(np.stack(configurations))
        ends = f"at the end of {section.move.name}"
        for contact in contacts:
            if contact is not None:
                self._failures.note(section.first - 1, f"{contact} {ends}")
        return [q for q, contact in zip(configurations, contacts, strict=True) if contact is None]

    def _tied_trajectories(self, section: Section, q: Array) -> tuple[Trajectory, ...] | None:
        trajectories: list[Trajectory] = []
        for k, primitive in enumerate(section.tied):
            if primitive.kind is StraightMove:
                line = ToolLine(primitive.X_start, primitive.X_end)
                path = follow(self._model, q, line)
                if isinstance(path, Infeasible):
                    for reason in path.reasons:
                        self._failures.note(section.first + k, f"{primitive.name}: {reason}")
                    return None
                trajectories.append(_straight_move(path, line, primitive, self._limits))
                q = end_of(trajectories[-1])
            else:
                trajectories.append(Trajectory.standstill(q, primitive.hold))
        return tuple(trajectories)

    def _turns(self, section: Section, q: Array, trajectories: Sequence[Trajectory]) -> Array:
        """Offsets by whole turns that keep a branch within the joints' limits, shape (k, n); only 0 if q is given.

        A joint without limits goes at most one turn beyond where it is at the start and at home.
        """
        s = np.linspace(0.0, 1.0, LIMIT_SAMPLES)
        passed = np.concatenate([q[None], *(trajectory.path.positions(s) for trajectory in trajectories)])
        lower, upper = near_limits(self._model, np.stack([self._q_start, self._model.home]))
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
                    self._failures.note(section.first + k, f"{primitive.name}: {reason}")
                    break
        return turns


def near_limits(model: RobotModel, near: Array) -> tuple[Array, Array]:
    """The joints' limits, shape (n,) each; where there are none, a turn beyond positions `near`, shape (m, n)."""
    lower = np.where(np.isinf(model.lower), near.min(axis=0) - 2 * np.pi, model.lower)
    upper = np.where(np.isinf(model.upper), near.max(axis=0) + 2 * np.pi, model.upper)
    return lower, upper


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


def end_of(trajectory: Trajectory) -> Array:
    """Joint positions at the end of a trajectory, shape (n,)."""
    q: Array = trajectory.path.positions([1.0])[0]
    return q
