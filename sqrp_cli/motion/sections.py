"""The sections of a motion between its joint moves: possible starts, and the primitives tied to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property, reduce
from itertools import product
from math import prod

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.ground_primitives import GroundPrimitive
from sqrp_cli.motion.position_limits import near_limits, whole_turns
from sqrp_cli.motion.timing import MotionLimits, time_paths
from sqrp_cli.motion.tool_path import (
    LIMIT_SAMPLES,
    SHORTEST_LINE,
    ToolCurve,
    follow_within_limits,
    limit_reason,
    tool_line,
)
from sqrp_cli.records import dataclass
from sqrp_cli.robot.branches import branch_words, chosen_branches
from sqrp_cli.robot.inverse_kinematics import known_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable
from sqrp_cli.skill.settings import MotionValue
from sqrp_cli.trajectory import JointPath, JointSpan, Trajectory, side_by_side

MOST_TURNS = 4096  # combinations of whole turns of the joints that are tried for each branch

Names = Mapping[str, MotionValue]
"""The name of a branch at the end of one joint move: some of those of `Branches.feasible`."""

_Begun = tuple[Array, tuple[Trajectory, ...]]
"""Start of a branch, shape (n,), and the trajectories of its first primitives."""


@dataclass(frozen=True, eq=False)
class Section:
    """A joint move (none at the start of the motion) and the primitives tied to its end, up to the next joint move."""

    move: GroundPrimitive | None
    first: int
    """Index of the first tied primitive in the skill."""
    tied: tuple[GroundPrimitive, ...]
    is_fixed: bool
    """Whether it begins at given joint positions, not at a tool pose."""


@dataclass(frozen=True, eq=False)
class Ways:
    """All k ways through a section: its branches, with each of their turns."""

    trajectories: tuple[tuple[Trajectory, ...], ...]  # of the tied primitives, by branch
    names: tuple[Names, ...]  # of each branch at the end of the joint move; empty where nothing is free
    of: Indices  # index of the branch of each way, of which each has one or more, shape (k,)
    turns: Array
    """Offsets by whole turns of joints that keep all of each way within the joints' limits, shape (k, n)."""
    q_start: Array
    q_end: Array
    """Where each begins and ends, shape (k, n)."""
    duration: Array  # of each, shape (k,) [s]


@dataclass(eq=False, kw_only=True)
class MotionProblem:
    """What the motion of a skill depends on; finds the branches of its sections, and records why there are none."""

    model: RobotModel
    primitives: Sequence[GroundPrimitive]
    scenes: Sequence[PlacedScene]
    """The surroundings of each."""
    sections: Sequence[Section]
    final: World  # after the skill, with the joints from before
    q_start: Array  # where the arm begins, shape (n,)
    seed: int
    redundancy_samples: int
    """As of `all_solutions`."""
    failures: list[tuple[int, str]] = field(default_factory=list)
    """Why branches fail, each with the index of the failing primitive."""
    out_of_reach: bool = False  # whether a waypoint is, obstacles ignored

    def reasons(self, most: int) -> tuple[str, ...]:
        """At most `most` different reasons, those of the branches that got furthest first."""
        furthest_first = sorted(self.failures, key=lambda failure: -failure[0])
        return tuple(dict.fromkeys(reason for _, reason in furthest_first))[:most]

    def solutions(self, X_WT: Array) -> Array | Unreachable:
        """The joint positions that bring the tool frame to a pose, shape (4, 4), or why there are none."""
        return known_solutions(self.model, X_WT, self.seed, self.redundancy_samples)

    @cached_property
    def bounds(self) -> JointSpan:
        """Position limits of the arm's joints; those without any go a turn beyond where they are at start and home."""
        return near_limits(self.model, np.stack([self.q_start, self.model.home]))

    def names(self, section: Section) -> Sequence[Names]:
        """The name of each solution of inverse kinematics at the start of a section; one for all if nothing is free."""
        move = section.move
        if move is None or move.home or not move.free:
            return ({},)
        # The words for what the move leaves free, or the numbers of solutions where these do not decide.
        if isinstance(found := self.solutions(move.X_end), Unreachable):
            return ()
        words = branch_words(self.model, found)
        sensible = {name for of_one in words for name in of_one} & set(move.free)
        named = [{move.free[name]: word for name, word in of_one.items() if name in sensible} for of_one in words]
        return [
            names if sensible and len(names) == len(sensible) else {f"{move.name}.solution": float(number)}
            for number, names in enumerate(named)
        ]

    def ways(self, section: Section) -> Ways | None:
        """The feasible ways through a section, free of contacts at the end of its joint move; None if there is none."""
        begun, names, branches = self._branches(section), self.names(section), list[tuple[_Begun, Array, Names]]()
        for branch, turns in zip(begun, self._turns(section, begun) if begun else (), strict=True):
            name, move = names[0], section.move
            if len(names) > 1 and move and isinstance(ends := self.solutions(move.X_end), np.ndarray):
                name = names[int((ends == branch[0]).all(axis=1).argmax())]
            if len(turns):
                branches.append((branch, turns, name))
        if not branches:
            return None
        of = np.repeat(np.arange(len(branches)), [len(turns) for _, turns, _ in branches])
        turns = np.concatenate([turns for _, turns, _ in branches])
        starts = np.stack([q for (q, _), *_ in branches])
        ends = np.stack([trajectories[-1].path.end if trajectories else q for (q, trajectories), *_ in branches])
        durations = np.array([sum(move.duration for move in trajectories) for (_, trajectories), *_ in branches])
        return Ways(
            trajectories=tuple(trajectories for (_, trajectories), *_ in branches),
            names=tuple(name for *_, name in branches),
            of=of,
            turns=turns,
            q_start=starts[of] + turns,
            q_end=ends[of] + turns,
            duration=durations[of],
        )

    def _branches(self, section: Section) -> list[_Begun]:
        """The feasible branches of a section, whole turns and limits ignored."""
        move, index = section.move, section.first - 1
        if move is None or move.home:
            ends = (self.q_start if move is None else self.model.home)[None]
        elif isinstance(found := self.solutions(move.X_end), Unreachable):
            self.out_of_reach = True
            self.failures.append((index, f"{move.name} to `{move.to}`: {found}"))
            return []
        else:
            ends = found[chosen_branches(self.model, found, move.branches)]
            if not len(ends):
                wanted = ", ".join(f"{name} {word}" for name, word in move.branches.items())
                self.failures.append((index, f"{move.name} to `{move.to}`: cannot be reached with {wanted}"))
        if move is not None and len(ends):
            contacts = self.scenes[index].check_all(ends)
            for contact in filter(None, contacts):
                self.failures.append((index, f"{contact} at the end of {move.name}"))
            ends = ends[[contact is None for contact in contacts]]
        # The start and the present end of each branch, and the paths along the curves of its tool moves.
        going = [(q, q, list[JointPath]()) for q in ends]
        legs = [(k, one, leg) for k, one in enumerate(section.tied, section.first) for leg in one.legs]
        for k, primitive, curve in legs:
            starts, may_turn = [at for _, at, _ in going], self.model.turns & (not section.is_fixed)
            followed = self.follow(k, primitive, curve, np.stack(starts), may_turn) if starts else []
            goes_on = curve is primitive.beyond
            going = [
                (q0, at if goes_on else path.end, [*paths, path])
                for (q0, at, paths), path in zip(going, followed, strict=True)
                if path is not None
            ]
        # All are timed together: that takes hardly longer than for one.
        moves = [(path, one, leg) for *_, paths in going for path, (_, one, leg) in zip(paths, legs, strict=True)]
        timed, begun = iter(self.timed(moves)), list[_Begun]()
        for q0, *_ in going:
            done: list[Trajectory] = []
            for primitive in section.tied:
                parts, stops = [next(timed) for _ in primitive.legs], len(primitive.curves)
                if not parts:
                    at = done[-1].path.end if done else q0
                    parts = [Trajectory.standstill(at, primitive.hold)]
                moved = reduce(Trajectory.followed_by, parts[: max(stops, 1)])
                # A guarded move stands where contact is expected for as long as it would go on without.
                done.append(moved.resting(parts[-1].duration) if len(parts) > max(stops, 1) else moved)
            begun.append((q0, tuple(done)))
        for primitive in section.tied if len(ends) and not begun else ():
            for curve in primitive.curves:  # that the end of a line is out of reach is the most useful reason
                reached = self.solutions(curve.X_end)
                if isinstance(reached, Unreachable):
                    self.failures.append((len(self.scenes), f"{primitive.name} to `{primitive.to}`: {reached}"))
        return begun

    def follow(
        self, index: int, primitive: GroundPrimitive, curve: ToolCurve, q: Array, may_turn: Mask
    ) -> list[JointPath | None]:
        """Paths along a curve from joint positions (b, n); why there is none is noted.

        may_turn: joints that whole turns may bring within their limits, shape (n,).
        """
        followed = follow_within_limits(self.model, q, curve, may_turn)
        for path in followed:
            for reason in path.reasons if isinstance(path, Infeasible) else ():
                self.failures.append((index, f"{primitive.name}: {reason}"))
        return [path if isinstance(path, JointPath) else None for path in followed]

    def timed(self, moves: Sequence[tuple[JointPath, GroundPrimitive, ToolCurve]]) -> list[Trajectory]:
        """Moves along curves at the speed of their primitives, or slower if joints cannot follow.

        A curve on which the tool only turns has no speed; the joints and the speed of turns alone limit it.
        """
        # What the primitive's settings allow along the curve's parameter. A turn reaches its speed in 0.2 s, as the
        # limits of its acceleration and jerk say.
        of_joints, along = MotionLimits.of(self.model), list[Array | None]()
        for path, primitive, curve in moves:
            limits = [np.full(3, np.inf)]
            if curve.length > SHORTEST_LINE:
                limits.append(np.array([primitive.speed, primitive.acceleration, primitive.jerk]) / curve.length)
            if primitive.turn_speed is not None and curve.turning > 0.0:
                limits.append(primitive.turn_speed / curve.turning * np.array([1.0, 10.0, 100.0]))
            if len(limits) == 1 and curve.turning:
                most = of_joints.along(path.derivative_bounds().max(axis=0))
                limits.append(np.array([most.velocity, most.acceleration, most.jerk]))
            along.append(np.min(limits, axis=0) if len(limits) > 1 else None)
        paths = [path for (path, *_), limit in zip(moves, along, strict=True) if limit is not None]
        stated = np.array([limit for limit in along if limit is not None]).reshape(-1, 3)
        timed = iter(time_paths(paths, of_joints, MotionLimits(*stated.T)))
        return [
            Trajectory.standstill(path.end, 0.0) if limit is None else next(timed)
            for (path, *_), limit in zip(moves, along, strict=True)
        ]

    def _turns(self, section: Section, branches: Sequence[_Begun]) -> list[Array]:
        """Of each branch, offsets by whole turns that keep it within the joints' limits, (k, n).

        Only 0 where the section's end is given, and of joints that slide. A joint without limits goes at most one turn
        beyond where it is at the start and at home. Where there are none, the first limit that fails is recorded.
        """
        # Positions that each branch passes: sampled, but exact where the motion between samples could decide on turns.
        low = np.stack([q for q, _ in branches])
        high, unknown = low.copy(), np.zeros_like(low)
        for trajectories in zip(*(trajectories for _, trajectories in branches), strict=True):
            for rows, path in side_by_side([trajectory.path for trajectory in trajectories]):
                if path.coefficients.shape[1] > 1:
                    q = path.positions(np.linspace(0.0, 1.0, LIMIT_SAMPLES)).reshape(LIMIT_SAMPLES, len(rows), -1)
                    low[rows], high[rows] = np.minimum(low[rows], q.min(axis=0)), np.maximum(high[rows], q.max(axis=0))
                    curvature = path.derivative_bounds(2).max(axis=0).reshape(len(rows), -1)
                    unknown[rows] = np.maximum(unknown[rows], curvature / (8 * (LIMIT_SAMPLES - 1) ** 2))
        sampled, widest = whole_turns(low, high, *self.bounds), whole_turns(low - unknown, high + unknown, *self.bounds)
        for row, joint in np.argwhere((sampled[0] != widest[0]) | (sampled[1] != widest[1])).tolist():
            for trajectory in branches[row][1]:
                least, greatest = trajectory.path.extremes(joint)
                low[row, joint], high[row, joint] = min(low[row, joint], least), max(high[row, joint], greatest)
        fewest, most = whole_turns(low, high, *self.bounds)
        still = ~self.model.turns | section.is_fixed
        fewest[:, still], most[:, still] = np.maximum(fewest[:, still], 0.0), np.minimum(most[:, still], 0.0)
        turns: list[Array] = []
        for (_, trajectories), least, greatest in zip(branches, fewest.tolist(), most.tolist(), strict=True):
            counts = [range(int(first), int(last) + 1) for first, last in zip(least, greatest, strict=True)]
            chosen, number = [], prod(map(len, counts))
            for count in reversed(counts):  # if there are too many combinations, the last joints turn the least
                nearest = count if number <= MOST_TURNS else sorted(count, key=abs)[:1]
                number = number // max(len(count), 1) * len(nearest)
                chosen.append(nearest)
            turns.append(2 * np.pi * np.array(list(product(*reversed(chosen))), dtype=float).reshape(-1, len(counts)))
            for k, (primitive, move) in enumerate(zip(section.tied, () if len(turns[-1]) else trajectories)):  # noqa: B905
                one = len(primitive.curves) == 1
                curve = primitive.curves[0] if one else tool_line(primitive.X_start, primitive.X_end)
                if (reason := limit_reason(self.model, move.path, curve)) is not None:
                    self.failures.append((section.first + k, f"{primitive.name}: {reason}"))
                    break
        return turns
