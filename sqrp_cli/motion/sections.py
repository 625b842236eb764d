"""The sections of a motion between its joint moves: possible starts, and the primitives tied to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property, reduce
from itertools import compress, product
from math import prod

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.ground_primitives import GroundPrimitive
from sqrp_cli.motion.position_limits import near_limits, whole_turns
from sqrp_cli.motion.timing import MotionLimits, rest_to_rest_duration, time_paths
from sqrp_cli.motion.tool_path import (
    SHORTEST_LINE,
    ToolCurve,
    follow_within_limits,
    limit_reason,
)
from sqrp_cli.records import dataclass
from sqrp_cli.robot.branches import branch_words, chosen_branches
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable
from sqrp_cli.skill.settings import MotionValue
from sqrp_cli.trajectory import JointPath, JointSpan, Trajectory, side_by_side

MOST_TURNS = 4096  # combinations of whole turns of the joints that are tried for each branch
Names = Mapping[str, MotionValue]
"""The name of a branch at the end of one joint move: some of those of `Branches.feasible`."""
Begun = tuple[Array, Array, tuple[JointPath, ...]]
"""Start and end of a branch, shape (n,) each, and its path along each of the section's legs."""


@dataclass(frozen=True, eq=False)
class Section:
    """A joint move (none at the start of the motion) and the primitives tied to its end, up to the next joint move."""

    move: GroundPrimitive | None
    first: int  # Index of the first tied primitive in the skill
    tied: tuple[GroundPrimitive, ...]
    is_fixed: bool  # Whether it begins at given joint positions, not at a tool pose

    @property
    def legs(self) -> list[tuple[int, GroundPrimitive, ToolCurve]]:
        """Every curve of the tied primitives, with the index of its primitive in the skill."""
        return [(k, one, curve) for k, one in enumerate(self.tied, self.first) for curve in one.legs]

    @property
    def least_duration(self) -> float:
        """No branch takes less than this, whatever the joints allow [s]."""
        holds = sum(one.hold for one in self.tied if not one.legs)
        stated = np.reshape([limits_along(one, curve) for _, one, curve in self.legs], (-1, 3))
        return holds + float(rest_to_rest_duration(1.0, MotionLimits(*stated[np.isfinite(stated).all(axis=1)].T)).sum())


@dataclass(frozen=True, eq=False)
class Ways:
    """All k ways through a section: its branches, with each of their turns."""

    begun: tuple[Begun, ...]  # by branch
    names: tuple[Names, ...]  # of each branch at the end of the joint move; empty where nothing is free
    of: Indices  # index of the branch of each way, of which each has one or more, shape (k,)
    turns: Array  # Offsets by whole turns of joints that keep all of each way within the joints' limits, shape (k, n)
    q_start: Array
    q_end: Array  # Where each begins and ends, shape (k, n)


@dataclass(eq=False, kw_only=True)
class MotionProblem:
    """What the motion of a skill depends on; finds the branches of its sections, and records why there are none."""

    model: RobotModel
    primitives: Sequence[GroundPrimitive]
    scenes: Sequence[PlacedScene]  # The surroundings of each
    sections: Sequence[Section]
    final: World  # after the skill, with the joints from before
    q_start: Array  # where the arm begins, shape (n,)
    seed: int
    redundancy_samples: int  # As of `all_solutions`
    failures: list[tuple[int, str]] = field(default_factory=list)
    """Why branches fail, each with the index of the failing primitive."""
    out_of_reach: bool = False  # whether a waypoint is, obstacles ignored
    _solutions: dict[bytes, Array | Unreachable] = field(default_factory=dict, init=False)
    """By pose: those of a section are asked for by its branches, their names and their ways."""

    def reasons(self, most: int) -> tuple[str, ...]:
        """At most `most` different reasons, those of the branches that got furthest first."""
        furthest_first = sorted(self.failures, key=lambda failure: -failure[0])
        return tuple(dict.fromkeys(reason for _, reason in furthest_first))[:most]

    def solutions(self, X_WT: Array) -> Array | Unreachable:
        """The joint positions that bring the tool frame to a pose, shape (4, 4), or why there are none."""
        if (pose := X_WT.tobytes()) not in self._solutions:
            self._solutions[pose] = all_solutions(self.model, X_WT, self.seed, self.redundancy_samples)
        return self._solutions[pose]

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
        begun, names, branches = self._branches(section), self.names(section), list[tuple[Begun, Array, Names]]()
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
        starts, ends = (np.stack(q)[of] + turns for q in zip(*((q0, at) for (q0, at, _), *_ in branches), strict=True))
        return Ways(
            begun=tuple(begun for begun, *_ in branches),
            names=tuple(name for *_, name in branches),
            of=of,
            turns=turns,
            q_start=starts,
            q_end=ends,
        )

    def _branches(self, section: Section) -> list[Begun]:
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
        begun: list[Begun] = [(q, q, ()) for q in ends]  # as far as they have been followed
        for k, primitive, curve in section.legs:
            starts, may_turn = [at for _, at, _ in begun], self.model.turns & (not section.is_fixed)
            followed = self.follow(k, primitive, curve, np.stack(starts), may_turn) if starts else []
            goes_on = curve is primitive.beyond
            begun = [
                (q0, at if goes_on else path.end, (*paths, path))
                for (q0, at, paths), path in zip(begun, followed, strict=True)
                if path is not None
            ]
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

    def trajectories(self, section: Section, branches: Sequence[Begun]) -> list[tuple[Trajectory, ...]]:
        """Those of the tied primitives, for each of some branches; all timed together takes hardly longer than one."""
        legs = section.legs
        moves = [(path, one, leg) for *_, paths in branches for path, (_, one, leg) in zip(paths, legs, strict=True)]
        timed, found = iter(self.timed(moves)), list[tuple[Trajectory, ...]]()
        for q0, *_ in branches:
            done: list[Trajectory] = []
            for primitive in section.tied:
                parts, stops = [next(timed) for _ in primitive.legs], len(primitive.curves)
                if not parts:
                    at = done[-1].path.end if done else q0
                    parts = [Trajectory.standstill(at, primitive.hold)]
                moved = reduce(Trajectory.followed_by, parts[: max(stops, 1)])
                # A guarded move stands where contact is expected for as long as it would go on without.
                done.append(moved.resting(parts[-1].duration) if len(parts) > max(stops, 1) else moved)
            found.append(tuple(done))
        return found

    def timed(self, moves: Sequence[tuple[JointPath, GroundPrimitive, ToolCurve]]) -> list[Trajectory]:
        """Moves along curves within `limits_along`, or slower if joints cannot follow."""
        of_joints, along = MotionLimits.of(self.model), list[Array]()
        for path, primitive, curve in moves:
            stated = limits_along(primitive, curve)
            if np.isinf(stated).all() and curve.turning:  # the joints and the speed of turns alone limit it
                most = of_joints.along(path.derivative_bounds().max(axis=0))
                stated = np.array([most.velocity, most.acceleration, most.jerk])
            along.append(stated)
        going = [index for index, stated in enumerate(along) if not np.isinf(stated).all()]
        limits = MotionLimits(*np.array([along[index] for index in going]).reshape(-1, 3).T)
        timed = dict(zip(going, time_paths([moves[index][0] for index in going], of_joints, limits), strict=True))
        return [timed.get(index) or Trajectory.standstill(path.end, 0.0) for index, (path, *_) in enumerate(moves)]

    def _turns(self, section: Section, branches: Sequence[Begun]) -> list[Array]:
        """Of each branch, offsets by whole turns that keep it within the joints' limits, (k, n).

        Only 0 where the section's end is given, and of joints that slide. A joint without limits goes at most one turn
        beyond where it is at the start and at home. Where there are none, the first limit that fails is recorded.
        """
        kept = [curve is not one.beyond for _, one, curve in section.legs]
        legs, followed = list(compress(section.legs, kept)), [tuple(compress(paths, kept)) for *_, paths in branches]
        # Positions that each branch passes: those of its ends, but exact where bounds of the others decide on turns.
        ends = np.stack([(q0, at) for q0, at, _ in branches])
        low, high = ends.min(axis=1), ends.max(axis=1)
        lowest, highest = low.copy(), high.copy()
        for paths in zip(*followed, strict=True):
            for rows, path in side_by_side(paths):
                lower, upper = (bound.reshape(len(rows), -1) for bound in path.range_bounds())
                lowest[rows], highest[rows] = np.minimum(lowest[rows], lower), np.maximum(highest[rows], upper)
        narrow, wide = whole_turns(low, high, *self.bounds), whole_turns(lowest, highest, *self.bounds)
        for row, joint in np.argwhere((narrow[0] != wide[0]) | (narrow[1] != wide[1])).tolist():
            for path in followed[row]:
                first, last = path.extremes(joint)
                low[row, joint], high[row, joint] = min(low[row, joint], first), max(high[row, joint], last)
        fewest, most = whole_turns(low, high, *self.bounds)
        still = ~self.model.turns | section.is_fixed
        fewest[:, still], most[:, still] = np.maximum(fewest[:, still], 0.0), np.minimum(most[:, still], 0.0)
        turns: list[Array] = []
        for paths, least, greatest in zip(followed, fewest.tolist(), most.tolist(), strict=True):
            counts = [range(int(first), int(last) + 1) for first, last in zip(least, greatest, strict=True)]
            chosen, number = [], prod(map(len, counts))
            for count in reversed(counts):  # if there are too many combinations, the last joints turn the least
                nearest = count if number <= MOST_TURNS else sorted(count, key=abs)[:1]
                number = number // max(len(count), 1) * len(nearest)
                chosen.append(nearest)
            turns.append(2 * np.pi * np.array(list(product(*reversed(chosen))), dtype=float).reshape(-1, len(counts)))
            for (k, primitive, curve), path in zip(legs, () if len(turns[-1]) else paths):  # noqa: B905
                if (reason := limit_reason(self.model, path, curve)) is not None:
                    self.failures.append((k, f"{primitive.name}: {reason}"))
                    break
        return turns


def limits_along(primitive: GroundPrimitive, curve: ToolCurve) -> Array:
    """What a primitive's settings allow along a curve's parameter: velocity, acceleration and jerk, shape (3,).

    They are infinite for a curve on which the tool only turns, if the settings do not limit that. A turn reaches its
    speed in 0.2 s, as the limits of its acceleration and jerk say.
    """
    limits = np.full(3, np.inf)
    if curve.length > SHORTEST_LINE:
        limits = np.array([primitive.speed, primitive.acceleration, primitive.jerk]) / curve.length
    if primitive.turn_speed is not None and curve.turning > 0.0:
        limits = np.minimum(limits, primitive.turn_speed / curve.turning * np.array([1.0, 10.0, 100.0]))
    return limits
