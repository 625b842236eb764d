"""The sections of a motion between its joint moves: possible starts, and the primitives tied to them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from math import prod

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.motion.branch_search import Station
from sqrp_cli.motion.ground_primitives import GroundPrimitive
from sqrp_cli.motion.placed_scene import PlacedScene
from sqrp_cli.motion.position_limits import near_limits, whole_turns
from sqrp_cli.motion.straight_line import LIMIT_SAMPLES, follow_within_limits, limit_reason
from sqrp_cli.motion.timing import MotionLimits, time_path, time_paths
from sqrp_cli.motion.tool_curve import ToolCurve, ToolLine
from sqrp_cli.records import dataclass
from sqrp_cli.robot.branches import chosen_branches
from sqrp_cli.robot.inverse_kinematics import known_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.trajectory import JointPath, JointSpan, Trajectory, side_by_side

_LIMIT_SAMPLES = np.linspace(0.0, 1.0, LIMIT_SAMPLES)

SHORTEST_LINE = 1e-9
"""Curves that are no longer have no speed [m]."""

MOST_TURNS = 4096
"""Combinations of whole turns of the joints that are tried for each branch."""

_Begun = tuple[Array, tuple[Trajectory, ...]]
"""Start of a branch, shape (n,), and the trajectories of its first primitives."""


@dataclass(frozen=True, eq=False)
class Section:
    """A joint move (none at the start of the motion) and the primitives tied to its end, up to the next joint move."""

    move: GroundPrimitive | None
    first: int
    """Index of the first tied primitive in the skill."""
    tied: tuple[GroundPrimitive, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether it begins at given joint positions, not at a tool pose."""
        return self.move is None or self.move.home


def cut_into_sections(primitives: Sequence[GroundPrimitive]) -> list[Section]:
    """The primitives cut before each joint move; the first section has none, and may be empty."""
    cuts = [i for i, primitive in enumerate(primitives) if primitive.kind is JointMove]
    sections = [Section(None, 0, tuple(primitives[: cuts[0] if cuts else None]))]
    for cut, following in pairwise([*cuts, len(primitives)]):
        sections.append(Section(primitives[cut], cut + 1, tuple(primitives[cut + 1 : following])))
    return sections


@dataclass(frozen=True, eq=False)
class Branch:
    """One way through a section: the end of its joint move, and the trajectories of the tied primitives."""

    q: Array
    trajectories: tuple[Trajectory, ...]
    turns: Array
    """Offsets by whole turns of joints that keep all of it within the joints' limits, shape (k, n)."""
    solution: int
    """Number of the solution of inverse kinematics at its start, in their order; 0 where the start is given."""

    @property
    def q_end(self) -> Array:
        """End of its last trajectory, shape (n,)."""
        return self.trajectories[-1].path.end if self.trajectories else self.q

    @property
    def duration(self) -> float:
        """Duration of its trajectories [s]."""
        return sum(trajectory.duration for trajectory in self.trajectories)


@dataclass(frozen=True, eq=False)
class Ways(Station):
    """All k ways through a section: its branches, with each of their turns."""

    branches: tuple[Branch, ...]
    """Some of one or more ways."""
    of: Indices
    """Index of the branch of each way, shape (k,)."""
    turns: Array
    """Of each, shape (k, n)."""

    @staticmethod
    def through(branches: Sequence[Branch]) -> Ways:
        """All ways of the branches of a section, of which there is at least one."""
        of = np.repeat(np.arange(len(branches)), [len(branch.turns) for branch in branches])
        turns = np.concatenate([branch.turns for branch in branches])
        q_start = np.stack([branch.q for branch in branches])[of] + turns
        q_end = np.stack([branch.q_end for branch in branches])[of] + turns
        duration = np.array([branch.duration for branch in branches])[of]
        return Ways(q_start=q_start, q_end=q_end, duration=duration, branches=tuple(branches), of=of, turns=turns)

    def branch(self, k: int) -> Branch:
        """The branch of a way."""
        return self.branches[int(self.of[k])]

    def trajectories(self, k: int) -> list[Trajectory]:
        """Those of a way, in its turns."""
        return [Trajectory(t.path.shifted(self.turns[k]), t.law) for t in self.branch(k).trajectories]


class BranchFinder:
    """Finds the branches of sections, and records why there are none.

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
        self._near_limits = near_limits(model, np.stack([q_start, model.home]))

    def branches(self, section: Section) -> list[Branch]:
        """The feasible branches of a section, free of contacts at the end of its joint move."""
        move, ends = section.move, self._ends(section)
        if move is not None and len(ends):
            contacts = self._scenes[section.first - 1].check_all(ends)
            for contact in filter(None, contacts):
                self._failures.note(section.first - 1, f"{contact} at the end of {move.name}")
            ends = ends[[contact is None for contact in contacts]]
        followed = self._followed(section, [(q, ()) for q in ends])
        for primitive in section.tied if len(ends) and not followed else ():
            for curve in primitive.curves:  # that the end of a line is out of reach is the most useful reason
                reached = known_solutions(self._model, curve.X_end, self._seed, self._samples)
                if not len(reached.solutions):
                    reason = f"{primitive.name} to `{primitive.to}`: {reached.reason}"
                    self._failures.note(len(self._scenes), reason)
        if not followed:
            return []
        turns, branches = self._turns(section, followed), list[Branch]()
        for (q, trajectories), of_branch in zip(followed, turns, strict=True):
            solution = 0
            if move is not None and not section.is_fixed:
                solutions = known_solutions(self._model, move.X_end, self._seed, self._samples).solutions
                solution = int((solutions == q).all(axis=1).argmax())
            if len(of_branch):
                branches.append(Branch(q, trajectories, of_branch, solution))
        return branches

    def _ends(self, section: Section) -> Array:
        """Possible ends of a section's joint move, or the arm's position if it has none, shape (b, n)."""
        move = section.move
        if move is None:
            return self._q_start[None]
        if move.home:
            return self._model.home[None]
        solutions = known_solutions(self._model, move.X_end, self._seed, self._samples)
        ends: Array = solutions.solutions[chosen_branches(self._model, solutions.solutions, move.branches)]
        self._failures.out_of_reach |= not len(solutions.solutions)
        if not len(ends):
            reason = solutions.reason or f"cannot be reached with {move.branches}"
            self._failures.note(section.first - 1, f"{move.name} to `{move.to}`: {reason}")
        return ends

    def _followed(self, section: Section, begun: list[_Begun]) -> list[_Begun]:
        """The given branches with the trajectories of all tied primitives; without those that fail."""
        for index, primitive in enumerate(section.tied, section.first):
            q = [trajectories[-1].path.end if trajectories else q for q, trajectories in begun]
            if not q:
                break
            if primitive.curves:
                may_turn = self._model.turns & (not section.is_fixed)
                moves = self._tool_moves(index, primitive, np.stack(q), may_turn)
            else:
                moves = [Trajectory.standstill(at, primitive.hold) for at in q]
            begun = [(q0, (*done, move)) for (q0, done), move in zip(begun, moves, strict=True) if move is not None]
        return begun

    def _tool_moves(self, index: int, primitive: GroundPrimitive, q: Array, may_turn: Mask) -> list[Trajectory | None]:
        """Moves along all curves of a primitive from joint positions (b, n), with a stop after each.

        A guarded move stands where contact is expected for as long as it would go on without.
        """
        moves = self._moves_along(index, primitive, primitive.curves[0], q, may_turn)
        for curve in primitive.curves[1:]:
            moves = self._followed_by(index, primitive, curve, moves, may_turn)
        guard = primitive.guard
        if guard is None or guard.beyond.length <= SHORTEST_LINE:
            return moves
        both = self._followed_by(index, primitive, guard.beyond, moves, may_turn)
        return [
            None if whole is None or move is None else move.resting(whole.duration - move.duration)
            for move, whole in zip(moves, both, strict=True)
        ]

    def _followed_by(
        self,
        index: int,
        primitive: GroundPrimitive,
        curve: ToolCurve,
        before: Sequence[Trajectory | None],
        may_turn: Mask,
    ) -> list[Trajectory | None]:
        """The moves before, each followed by one along a curve; None where either is impossible."""
        going = [move for move in before if move is not None]
        if not going:
            return list(before)
        ends = np.stack([move.path.end for move in going])
        more = iter(self._moves_along(index, primitive, curve, ends, may_turn))
        joined = ((move, next(more)) if move is not None else (None, None) for move in before)
        return [None if one is None or two is None else one.followed_by(two) for one, two in joined]

    def _moves_along(
        self, index: int, primitive: GroundPrimitive, line: ToolCurve, q: Array, may_turn: Mask
    ) -> list[Trajectory | None]:
        """Moves along a curve from joint positions (b, n) at the primitive's speed, or slower if joints cannot follow.

        A curve on which the tool only turns has no speed; the joints and the speed of turns alone limit it.
        """
        followed = follow_within_limits(self._model, q, line, may_turn)
        for path in followed:
            if isinstance(path, Infeasible):
                for reason in path.reasons:
                    self._failures.note(index, f"{primitive.name}: {reason}")
        paths = [path for path in followed if isinstance(path, JointPath)]
        # What the primitive's settings allow along the curve's parameter. A turn reaches its speed in 0.2 s, as the
        # limits of its acceleration and jerk say.
        speed, turning = primitive.turn_speed, line.turning
        tool = np.array([primitive.speed, primitive.acceleration, primitive.jerk])
        limits = [tool / line.length] if line.length > SHORTEST_LINE else []
        if speed is not None and turning > 0.0:
            limits.append(speed / turning * np.array([1.0, 10.0, 100.0]))
        if limits:
            timed = time_paths(paths, self._limits, MotionLimits(*np.min(limits, axis=0)))
        elif line.turning:
            timed = [time_path(path, self._limits) for path in paths]
        else:
            timed = [Trajectory.standstill(path.end, 0.0) for path in paths]
        moves = iter(timed)
        return [next(moves) if isinstance(path, JointPath) else None for path in followed]

    def beyond(self, index: int, primitive: GroundPrimitive, q: Array) -> Trajectory | None:
        """How a guarded primitive goes on from q, shape (n,), where contact is expected; None if it cannot."""
        if primitive.guard is None:
            raise ValueError(f"{primitive.name} is not guarded")
        still = np.zeros_like(self._model.turns)
        return self._moves_along(index, primitive, primitive.guard.beyond, q[None], still)[0]

    def _turns(self, section: Section, branches: Sequence[_Begun]) -> list[Array]:
        """Of each branch, offsets by whole turns that keep it within the joints' limits, (k, n).

        Only 0 where the section's end is given, and of joints that slide. A joint without limits goes at most one turn
        beyond where it is at the start and at home. Where there are none, the first limit that fails is recorded.
        """
        fewest, most = whole_turns(*_passed(branches, self._near_limits), *self._near_limits)
        still = ~self._model.turns | section.is_fixed
        fewest[:, still], most[:, still] = np.maximum(fewest[:, still], 0.0), np.minimum(most[:, still], 0.0)
        turns: list[Array] = []
        for (_, trajectories), least, greatest in zip(branches, fewest.tolist(), most.tolist(), strict=True):
            counts = [range(int(first), int(last) + 1) for first, last in zip(least, greatest, strict=True)]
            turns.append(2 * np.pi * _combinations(counts))
            for k, (primitive, move) in enumerate(zip(section.tied, () if len(turns[-1]) else trajectories)):  # noqa: B905
                one = len(primitive.curves) == 1
                curve = primitive.curves[0] if one else ToolLine(primitive.X_start, primitive.X_end)
                if (reason := limit_reason(self._model, move.path, curve)) is not None:
                    self._failures.note(section.first + k, f"{primitive.name}: {reason}")
                    break
        return turns


class Failures:
    """Why branches fail, each with the index of the failing primitive.

    out_of_reach: whether a waypoint is, obstacles ignored.
    """

    def __init__(self) -> None:
        self._found: list[tuple[int, str]] = []
        self.out_of_reach = False

    def note(self, index: int, reason: str) -> None:
        """Record a reason at a primitive."""
        self._found.append((index, reason))

    def reasons(self, most: int) -> tuple[str, ...]:
        """At most `most` different reasons, those of the branches that got furthest first."""
        furthest_first = sorted(self._found, key=lambda failure: -failure[0])
        return tuple(dict.fromkeys(reason for _, reason in furthest_first))[:most]


def _combinations(counts: Sequence[range]) -> Array:
    """All combinations of whole turns of n joints, shape (k, n), k at most `MOST_TURNS`.

    If there would be more, the last joints turn the least.
    """
    chosen, number = [], prod(map(len, counts))
    for turns in reversed(counts):
        nearest = turns if number <= MOST_TURNS else sorted(turns, key=abs)[:1]
        number = number // max(len(turns), 1) * len(nearest)
        chosen.append(nearest)
    return np.array(list(product(*reversed(chosen))), dtype=float).reshape(-1, len(counts))


def _passed(branches: Sequence[_Begun], limits: JointSpan) -> JointSpan:
    """The least and the greatest joint positions of each branch, shape (b, n).

    Sampled, but exact where the motion between samples could decide which whole turns keep the limits, (n,) each.
    """
    low = np.stack([q for q, _ in branches])
    high, unknown = low.copy(), np.zeros_like(low)
    for trajectories in zip(*(trajectories for _, trajectories in branches), strict=True):
        for rows, path in side_by_side([trajectory.path for trajectory in trajectories]):
            if path.coefficients.shape[1] > 1:
                q = path.positions(_LIMIT_SAMPLES).reshape(len(_LIMIT_SAMPLES), len(rows), -1)
                low[rows], high[rows] = np.minimum(low[rows], q.min(axis=0)), np.maximum(high[rows], q.max(axis=0))
                curvature = path.derivative_bounds(2).max(axis=0).reshape(len(rows), -1)
                unknown[rows] = np.maximum(unknown[rows], curvature / (8 * (LIMIT_SAMPLES - 1) ** 2))
    sampled, widest = whole_turns(low, high, *limits), whole_turns(low - unknown, high + unknown, *limits)
    for row, joint in np.argwhere((sampled[0] != widest[0]) | (sampled[1] != widest[1])).tolist():
        for trajectory in branches[row][1]:
            least, greatest = trajectory.path.extremes(joint)
            low[row, joint], high[row, joint] = min(low[row, joint], least), max(high[row, joint], greatest)
    return JointSpan(low, high)
