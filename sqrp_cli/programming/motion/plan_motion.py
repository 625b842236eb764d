"""The motion of a candidate: reachable, within all limits, free of collisions, and the fastest of its kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import MotionValue, Skill
from sqrp_cli.knowledge.workspace import World
from sqrp_cli.programming.arm.inverse_kinematics import FIRST_HELD, MORE_REDUNDANCY_SAMPLES, REDUNDANCY_SAMPLES
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.motion.branch_search import Question, Station, fastest_sequence
from sqrp_cli.programming.motion.collision import CollisionScene, Contact, finger_positions
from sqrp_cli.programming.motion.fingers import with_fingers
from sqrp_cli.programming.motion.ground_primitives import GroundSkill, ground_primitives, start_configuration
from sqrp_cli.programming.motion.sections import Branch, BranchFinder, Failures, cut_into_sections, near_limits
from sqrp_cli.programming.motion.timing import MotionLimits, joint_move, joint_move_duration
from sqrp_cli.programming.motion.way_around import find_way
from sqrp_cli.trajectory import Trajectory

MOST_AXES_WITHOUT_REDUNDANCY = 6
"""Arms with more axes reach a pose in infinitely many ways, of which some are tried."""

MAX_REASONS = 5
"""Reasons given for an infeasible motion."""

TRIES_PER_WAY = 250
"""Straight pieces that the search for one way around may look at."""

MOST_TRIES = 1500
"""Those that all searches for one motion may look at together."""


@dataclass(frozen=True, eq=False)
class TimedPrimitive:
    """A primitive action with its place in time.

    start, end: [s] from the start of the motion. trajectory: of the driven joints, from 0 to end - start.
    held: the object in the tool all through it (grasp attaches and release detaches at `end`), with its pose in the
    tool frame `X_TO`, shape (4, 4); None if there is none. X_WO: where the objects that are not held rest.
    around: the link or object that it goes around, None if it is direct.
    """

    name: str
    start: float
    end: float
    trajectory: Trajectory
    held: str | None
    X_TO: Array | None
    X_WO: Mapping[str, Array]
    around: str | None = None


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
    def ways_around(self) -> tuple[str, ...]:
        """What goes around what: `a1 goes around wall`."""
        return tuple(f"{p.name} goes around {p.around}" for p in self.primitives if p.around is not None)

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
    seed: int = 0,
) -> Motion | Infeasible:
    """The fastest feasible motion of a skill among all branches of inverse kinematics, joint turns included.

    binding: the object that each skill parameter stands for. values: of every motion parameter. world: before it.
    seed: of what is drawn at random: ways around, and redundant joints. Every move keeps its clearance at all times.
    Joint moves are straight in joint space; only where no combination of branches has direct joint moves alone are
    ways around looked for, most promising combination first. Of an arm with more than six axes, more positions of its
    redundant joints are tried where few do not do. Infeasible names, most useful first, what is out of reach, which
    joint is at its limit, or what hits what and where.
    """
    grounded = ground_primitives(skill, binding, values, objects, world, model, scene)
    if isinstance(grounded, Infeasible):
        return grounded
    q_start = start_configuration(model, world)
    planner = _Planner(model, scene, grounded, q_start, seed, REDUNDANCY_SAMPLES)
    motion = planner.plan()
    if len(model.arm) <= MOST_AXES_WITHOUT_REDUNDANCY or isinstance(motion, Motion) or planner.is_out_of_reach:
        return motion
    return _Planner(model, scene, grounded, q_start, seed, MORE_REDUNDANCY_SAMPLES).plan()


@dataclass(frozen=True, eq=False)
class _Move:
    """A joint move between two branches, with what it goes around if it does."""

    trajectory: Trajectory
    around: str | None = None


class _Planner:
    """Plans one motion: sections, the branches of each, and the moves between them."""

    def __init__(
        self, model: RobotModel, scene: CollisionScene, skill: GroundSkill, q_start: Array, seed: int, samples: int
    ) -> None:
        self._model, self._skill, self._q_start, self._seed = model, skill, q_start, seed
        self._samples = samples
        self._limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
        self._radii = scene.bound.radii
        placed = cache(scene.placed)
        self._scenes = [placed(primitive.world, primitive.allowed) for primitive in skill.primitives]
        self._failures = Failures()
        self._tries_left = MOST_TRIES

    def plan(self) -> Motion | Infeasible:
        sections = cut_into_sections(self._skill.primitives)
        finder = BranchFinder(self._model, self._scenes, self._q_start, self._failures, self._seed, self._samples)
        options: list[list[tuple[Branch, Array]]] = []
        for section in sections:
            options.append([(branch, turn) for branch in finder.branches(section) for turn in branch.turns])
            if not options[-1]:
                return self._infeasible()
        stations = [_station(ways) for ways in options]
        durations = [
            self._move_durations(section.first - 1, before.q_end[:, None], after.q_start[None])
            for before, after, section in zip(stations[:-1], stations[1:], sections[1:], strict=True)
        ]

        @cache
        def tied_is_free(i: int, branch: Branch) -> bool:
            tied = [(sections[i].first + k, t) for k, t in enumerate(branch.trajectories)]
            return all(self._contact(k, t) is None and self._fingers_are_free(k, t) for k, t in tied)

        moves: dict[Question, _Move] = {}
        blocked: dict[Question, Contact] = {}

        def ends(i: int, previous: int, chosen: int) -> tuple[Array, Array]:
            return stations[i - 1].q_end[previous], stations[i].q_start[chosen]

        @cache
        def direct_works(i: int, previous: int, chosen: int) -> bool:
            if not tied_is_free(i, options[i][chosen][0]):
                return False
            if sections[i].move is None:
                return True
            index = sections[i].first - 1
            direct = self._move(index, *ends(i, previous, chosen))
            contact = self._contact(index, direct)
            if contact is None:
                moves[i, previous, chosen] = _Move(direct)
            else:
                blocked[i, previous, chosen] = contact
            return contact is None

        def way_works(i: int, previous: int, chosen: int) -> bool:
            contact = blocked.get((i, previous, chosen))
            if contact is None:
                return False  # What is tied to the branch is blocked, not the way to it.
            way = self._way_around(sections[i].first - 1, *ends(i, previous, chosen))
            if way is not None:
                moves[i, previous, chosen] = _Move(way, contact.second)
            return way is not None

        chosen = fastest_sequence(stations, durations, direct_works)
        if chosen is None:
            chosen = fastest_sequence(stations, durations, direct_works, way_works)
        if chosen is None:
            return self._infeasible()
        branches = [ways[k] for ways, k in zip(options, chosen, strict=True)]
        return self._motion(branches, [moves[i, chosen[i - 1], chosen[i]] for i in range(1, len(chosen))])

    @property
    def is_out_of_reach(self) -> bool:
        """Whether a waypoint is out of reach, whatever is in the way."""
        return self._failures.out_of_reach

    def _contact(self, index: int, trajectory: Trajectory) -> Contact | None:
        """The first contact during a primitive; notes what touches, and when."""
        contact = self._scenes[index].check_motion(trajectory)
        if contact is not None:
            share = trajectory.law.time_at(contact.s) / trajectory.duration if trajectory.duration > 0 else 0.0
            self._failures.note(index, f"{contact} at {100 * share:.0f} % of {self._skill.primitives[index].name}")
        return contact

    def _fingers_are_free(self, index: int, trajectory: Trajectory) -> bool:
        """Whether the fingers touch nothing as they move during a primitive; notes what they do."""
        primitive = self._skill.primitives[index]
        if primitive.fingers is None:
            return True
        contact = self._scenes[index].check_fingers(trajectory.path.end, primitive.fingers.path.end)
        if contact is not None:
            self._failures.note(index, f"{contact} as the fingers move in {primitive.name}")
        return contact is None

    def _way_around(self, index: int, q0: Array, q1: Array) -> Trajectory | None:
        """A joint move from q0 to q1 whose direct one is blocked; none where it has to be by home."""
        tries = min(TRIES_PER_WAY, self._tries_left)
        if tries == 0 or self._skill.primitives[index].via_home:
            return None
        bounds = near_limits(self._model, np.stack([self._q_start, self._model.home]))
        limits = self._move_limits(index)
        found = find_way(self._scenes[index], q0, q1, bounds, self._radii, limits, tries, self._seed)
        self._tries_left -= found.tries
        return found.trajectory

    def _move_durations(self, index: int, q0: Array, q1: Array) -> Array:
        """Durations [s] of direct joint moves from q0 to q1, or by home, shapes (..., n) that broadcast."""
        limits = self._move_limits(index)
        if not self._skill.primitives[index].via_home:
            return joint_move_duration(q0, q1, limits)
        home = self._model.home
        return joint_move_duration(q0, home, limits) + joint_move_duration(home, q1, limits)

    def _move(self, index: int, q0: Array, q1: Array) -> Trajectory:
        """The direct joint move from q0 to q1, or the one by home."""
        limits = self._move_limits(index)
        if not self._skill.primitives[index].via_home:
            return joint_move(q0, q1, limits)
        return joint_move(q0, self._model.home, limits).followed_by(joint_move(self._model.home, q1, limits))

    def _move_limits(self, index: int) -> MotionLimits:
        return replace(self._limits, velocity=self._skill.primitives[index].speed * self._limits.velocity)

    def _infeasible(self) -> Infeasible:
        """The reasons collected, and whether a way around was looked for."""
        reasons = self._failures.reasons(MAX_REASONS)
        if self._samples > REDUNDANCY_SAMPLES:
            joint = self._model.arm[FIRST_HELD]
            reasons = (f"{reasons[0]}, with {self._samples} positions of `{joint}` tried", *reasons[1:])
        if (tries := MOST_TRIES - self._tries_left) > 0:
            reasons = (f"{reasons[0]}, and no way around was found in {tries:,} tries", *reasons[1:])
        return Infeasible(reasons)

    def _motion(self, branches: Sequence[tuple[Branch, Array]], moves: Sequence[_Move]) -> Motion:
        """The motion of a branch for each section, with its turn, and the moves between them."""
        done: list[_Move] = []
        for i, (branch, turn) in enumerate(branches):
            done += moves[i - 1 : i] if i else []
            done += [_Move(Trajectory(t.path.shifted(turn), t.law)) for t in branch.trajectories]
        q = branches[-1][0].q_end + branches[-1][1]
        primitives, start = [], 0.0
        for primitive, move in zip(self._skill.primitives, done, strict=True):
            world, end = primitive.world, start + move.trajectory.duration
            fingers = primitive.fingers
            moving = with_fingers(self._model, move.trajectory, fingers, finger_positions(self._model, world))
            resting = {name: X_WO for name, X_WO in world.X_WO.items() if name != world.held}
            primitives.append(
                TimedPrimitive(primitive.name, start, end, moving, world.held, world.X_TO, resting, move.around)
            )
            start = end
        return Motion(self._model.joints, tuple(primitives), self._final(q))

    def _final(self, q: Array) -> World:
        world = self._skill.final
        X_WO = dict(world.X_WO)
        if world.held is not None and world.X_TO is not None:
            X_WO[world.held] = self._model.tool_pose(q) @ world.X_TO
        return replace(world, X_WO=X_WO, joints={**world.joints, **dict(zip(self._model.arm, q.tolist(), strict=True))})


def _station(ways: Sequence[tuple[Branch, Array]]) -> Station:
    return Station(
        np.stack([branch.q + turn for branch, turn in ways]),
        np.stack([branch.q_end + turn for branch, turn in ways]),
        np.array([branch.duration for branch, _ in ways]),
    )
