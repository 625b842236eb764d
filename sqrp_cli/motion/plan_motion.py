"""The motion of a candidate, or of each branch: the fastest that is reachable, within limits and free of collisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import prod

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.motion import sections
from sqrp_cli.motion.branch_search import Station, fastest_sequence
from sqrp_cli.motion.collision import CollisionScene
from sqrp_cli.motion.fingers import with_fingers
from sqrp_cli.motion.ground_primitives import GroundPrimitive, GroundSkill, SkillUse, ground_primitives
from sqrp_cli.motion.joint_moves import FoundMove, JointMoves
from sqrp_cli.motion.position_limits import worst_past_limit
from sqrp_cli.records import dataclass
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.robot.branches import branch_words
from sqrp_cli.robot.robot import AXES_OF_A_POSE
from sqrp_cli.skill.settings import MotionValue
from sqrp_cli.trajectory import JointPath, Trajectory

MEASURED = 1e-3
"""Largest measured excess over a limit at the start of a motion, which then starts at the limit [rad or m]."""

REACHED = 0.98
"""Share of a stated speed above which it counts as reached."""

MAX_REASONS = 5
"""Most reasons of an infeasible motion."""

MOST_BRANCHES = 256
"""Most combinations of branches of several joint moves that are tried; those of the first moves come first."""


@dataclass(frozen=True, eq=False)
class Guard:
    """How a guarded move goes on where it meets nothing, and what it takes for contact."""

    force: float
    """At the tool [N]."""
    trajectory: Trajectory
    """Of the driven joints, over the whole time of the primitive, to where it ends without contact."""


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
    guard: Guard | None = None
    """Of a move that ends at contact; its trajectory then ends where contact is expected."""
    too_slow: str | None = None
    """The highest speed of its tool where that is below the stated one, such as `reaches 3.4 of 5 cm/s`."""


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
    def remarks(self) -> tuple[str, ...]:
        """Detours and speeds that are not reached, such as `a1 goes around wall` and `a4 reaches 3.4 of 5 cm/s`."""
        return tuple(
            f"{p.name} {note}"
            for p in self.primitives
            for note in (p.around and f"goes around {p.around}", p.too_slow)
            if note
        )

    @property
    def time(self) -> float:
        """Duration of the whole [s]."""
        return self.primitives[-1].end if self.primitives else 0.0

    def positions(self, primitive: int, t: Array) -> Array:
        """Joint positions at times t [s] from the start of the motion, within one primitive: shapes (m,) -> (m, n)."""
        return self.primitives[primitive].trajectory.positions(np.asarray(t) - self.primitives[primitive].start)


@dataclass(frozen=True, eq=False)
class BranchMotion:
    """The motion of one branch, or one for each of several joint moves."""

    branch: Mapping[str, MotionValue]
    """The words of the parameters that leave it free; for an arm without such words the number of the solution of
    inverse kinematics at the end of a joint move, as `a1.solution`."""
    motion: Motion


@dataclass(frozen=True, eq=False)
class Branches:
    """All branches that were tried for a motion."""

    tried: int
    """One where no branch reaches its place, or nothing is free."""
    feasible: tuple[BranchMotion, ...]
    """Those with a motion, in a fixed order."""
    reasons: tuple[str, ...]
    """Why others fail, most useful first; not empty if all fail."""


def plan_motion(use: SkillUse, scene: CollisionScene, seed: int = 0, *, around: bool = True) -> Motion | Infeasible:
    """The fastest feasible motion of a skill among all branches of inverse kinematics, joint turns included.

    seed: of the random ways around and redundant joints. Every move keeps its clearance at all times. Joint moves are
    straight in joint space; ways around are searched only if no combination of branches has direct moves throughout,
    the most promising combination first. For an arm with more than six axes, more positions of its redundant joints are
    tried if a few are not enough. Infeasible names, most useful first, what is out of reach, which joint is at its
    limit, or which contact occurs where. With a branch of `plan_branches`, exactly the motion that it has there.
    around: whether ways around are searched at all.
    """
    planner = _first_planner(use, scene, seed)
    if isinstance(planner, Infeasible):
        return planner
    motion = planner.plan(use.branch, around=around)
    more = planner.needs_more_samples(motion)
    return planner.with_more_samples().plan(use.branch, around=around) if more else motion


def plan_branches(use: SkillUse, scene: CollisionScene, seed: int = 0) -> Branches | Infeasible:
    """The fastest feasible motion of each branch that the skill's parameters leave free; see `plan_motion`.

    Ways around are searched only if no branch has direct moves throughout, and then only the first one is given. At
    most `MOST_BRANCHES` are tried.
    """
    planner = _first_planner(use, scene, seed)
    if isinstance(planner, Infeasible):
        return planner
    found = planner.plan_each()
    return planner.with_more_samples().plan_each() if planner.needs_more_samples(found) else found


def _first_planner(use: SkillUse, scene: CollisionScene, seed: int) -> _Planner | Infeasible:
    """The planner of a skill that can begin; joints that are measured to be just past a limit are at that limit."""
    joints, (lower, upper) = use.world.joints, scene.model.position_limits
    within = {
        name: min(max(joints[name], low), high)
        for name, low, high in zip(scene.model.joints, lower.tolist(), upper.tolist(), strict=True)
        if low - MEASURED <= joints[name] <= high + MEASURED
    }
    if any(
        joints[name] != value for name, value in within.items()
    ):  # else itself, as collision scenes are kept by world
        use = replace(use, world=replace(use.world, joints={**joints, **within}))
    begin = np.array([use.world.joints[name] for name in scene.model.joints])
    if (past := worst_past_limit(scene.model, JointPath.line(begin, begin))) is not None:
        return Infeasible((f"{past} before anything moves",))
    grounded = ground_primitives(use, scene)
    if isinstance(grounded, Infeasible):
        return grounded
    return _Planner(
        scene, grounded, scene.model.arm_positions(use.world.joints), seed, inverse_kinematics.REDUNDANCY_SAMPLES
    )


def _within(ways: Sequence[sections.Ways], masks: Sequence[Mask]) -> list[Station]:
    """The ways in the masks; the others take endlessly long."""
    return [
        Station(through.q_start, through.q_end, np.where(mask, through.duration, np.inf))
        for through, mask in zip(ways, masks, strict=True)
    ]


class _Planner:
    """Plans the motions of one skill: sections, the branches of each, and the moves between them."""

    def __init__(self, scene: CollisionScene, skill: GroundSkill, q_start: Array, seed: int, samples: int) -> None:
        self._scene, self._model, self._skill, self._q_start, self._seed = scene, scene.model, skill, q_start, seed
        self._samples = samples
        placed = cache(scene.placed)
        self._scenes = [placed(primitive.world, primitive.allowed) for primitive in skill.primitives]
        self._sections = sections.cut_into_sections(skill.primitives)
        self._failures = sections.Failures()
        self._finder = sections.BranchFinder(self._model, self._scenes, q_start, self._failures, seed, samples)
        self._named: dict[str, Sequence[_Names]] = {}

    def with_more_samples(self) -> _Planner:
        """A planner that tries more positions of redundant joints."""
        return _Planner(self._scene, self._skill, self._q_start, self._seed, inverse_kinematics.MORE_REDUNDANCY_SAMPLES)

    def needs_more_samples(self, found: Motion | Branches | Infeasible) -> bool:
        """Whether more positions of redundant joints may help; not where a waypoint is out of reach anyway."""
        redundant = len(self._model.arm) > AXES_OF_A_POSE
        failed = isinstance(found, Infeasible) or (isinstance(found, Branches) and not found.feasible)
        return redundant and failed and not self._failures.out_of_reach

    def plan(self, branch: Mapping[str, MotionValue], *, around: bool) -> Motion | Infeasible:
        """The fastest motion of a branch as `plan_each` names it; of all, if it is empty."""
        ways = self._ways()
        if ways is None:
            return self._infeasible()
        stations: Sequence[Station] = ways
        if branch:
            masks = self._masks(ways, branch)
            if not all(mask.any() for mask in masks):
                return no_such_branch(branch)
            stations = _within(ways, masks)
        return self._fastest(ways, self._moves(ways), stations, around=around)

    def plan_each(self) -> Branches:
        """The fastest motion of each branch."""
        ways = self._ways()
        tried = prod(max(1, len(_different(self._names(section)))) for section in self._sections)
        if ways is None:
            return Branches(tried, (), self._infeasible().reasons)
        moves = self._moves(ways)
        branches: list[dict[str, MotionValue]] = [{}]
        for section, through in zip(self._sections, ways, strict=True):
            possible = _different([self._name(section, branch) for branch in through.branches])
            branches = [{**one, **more} for one in branches for more in possible if _agree(one, more)][:MOST_BRANCHES]
        stations = [_within(ways, self._masks(ways, branch)) for branch in branches]
        planned = [
            (branch, self._fastest(ways, moves, of_branch, around=False))
            for branch, of_branch in zip(branches, stations, strict=True)
        ]
        feasible = [BranchMotion(branch, motion) for branch, motion in planned if isinstance(motion, Motion)]
        if not feasible:
            motion = self._fastest(ways, moves, ways)
            if isinstance(motion, Infeasible):
                return Branches(tried, (), motion.reasons)
            feasible = [BranchMotion({}, motion)]
        return Branches(tried, tuple(feasible), self._failures.reasons(MAX_REASONS))

    def _ways(self) -> list[sections.Ways] | None:
        """The ways through each section; None if one has none."""
        ways: list[sections.Ways] = []
        for section in self._sections:
            branches = self._finder.branches(section)
            if not branches:
                return None
            ways.append(sections.Ways.through(branches))
        return ways

    def _moves(self, ways: Sequence[sections.Ways]) -> JointMoves:
        primitives, start, failures = self._skill.primitives, self._q_start, self._failures
        return JointMoves(self._model, primitives, self._scenes, self._sections, ways, start, failures, self._seed)

    def _masks(self, ways: Sequence[sections.Ways], branch: _Names) -> list[Mask]:
        """Which ways through each section belong to a branch."""

        def mask(section: sections.Section, through: sections.Ways) -> Mask:
            fitting = [_agree(branch, self._name(section, of_way)) for of_way in through.branches]
            return np.array(fitting)[through.of]

        return [mask(section, through) for section, through in zip(self._sections, ways, strict=True)]

    def _name(self, section: sections.Section, branch: sections.Branch) -> _Names:
        """The name of a branch of a section."""
        names = self._names(section)
        return names[branch.solution] if len(names) > 1 else names[0]

    def _names(self, section: sections.Section) -> Sequence[_Names]:
        """The name of each solution of inverse kinematics at the start of a section; one for all if nothing is free."""
        move = section.move
        if move is None or move.home or not move.free:
            return ({},)
        if move.name not in self._named:
            solutions = inverse_kinematics.known_solutions(self._model, move.X_end, self._seed, self._samples).solutions
            # The words for what the move leaves free, or the numbers of solutions where these do not decide.
            words = branch_words(self._model, solutions)
            sensible = {name for found in words for name in found} & set(move.free)
            named = [{move.free[name]: word for name, word in found.items() if name in sensible} for found in words]
            self._named[move.name] = [
                names if sensible and len(names) == len(sensible) else {f"{move.name}.solution": float(number)}
                for number, names in enumerate(named)
            ]
        return self._named[move.name]

    def _fastest(
        self, ways: Sequence[sections.Ways], moves: JointMoves, stations: Sequence[Station], *, around: bool = True
    ) -> Motion | Infeasible:
        """The fastest motion of some of the ways; see `_within`. around: look for ways around, if need be."""
        durations = moves.durations
        chosen = fastest_sequence(stations, durations, moves.direct_works)
        if chosen is None and around:
            chosen = fastest_sequence(stations, durations, moves.direct_works, moves.way_works)
        if chosen is None:
            return self._infeasible(moves.tries)
        along = moves.along(chosen)
        if isinstance(along, Infeasible):
            return along
        done: list[FoundMove] = []
        for through, k, move in zip(ways, chosen, [None, *along], strict=True):
            done += [move] if move is not None else []
            done += map(FoundMove, through.trajectories(k))
        guarded = self._guarded(done)
        if isinstance(guarded, Infeasible):
            return guarded
        motion = self._motion(done, guarded, ways[-1].q_end[chosen[-1]])
        for primitive in motion.primitives:
            if (past := worst_past_limit(self._model, primitive.trajectory.path)) is not None:
                return Infeasible((f"{primitive.name}: {past}",))
        return motion

    def _infeasible(self, tries: int = 0) -> Infeasible:
        """The collected reasons, with the number of tries to find a way around."""
        reasons = self._failures.reasons(MAX_REASONS)
        if self._samples > inverse_kinematics.REDUNDANCY_SAMPLES:
            joint = self._model.arm[inverse_kinematics.held_joints(self._model)[0]]
            reasons = (f"{reasons[0]}, with {self._samples} positions of `{joint}` tried", *reasons[1:])
        if tries > 0:
            reasons = (f"{reasons[0]}, and no way around was found in {tries:,} tries", *reasons[1:])
        return Infeasible(reasons)

    def _guarded(self, moves: Sequence[FoundMove]) -> dict[str, Trajectory] | Infeasible:
        """The whole motion of the arm in each guarded primitive, by its name, where it meets nothing."""
        found: dict[str, Trajectory] = {}
        for index, (primitive, move) in enumerate(zip(self._skill.primitives, moves, strict=True)):
            if primitive.guard is None:
                continue
            approach, whole = move.trajectory, move.trajectory
            beyond = primitive.guard.beyond
            if beyond.length > sections.SHORTEST_LINE:
                moving = self._finder.beyond(index, primitive, approach.path.end)
                if moving is None:
                    return self._infeasible()
                whole = approach.shortened(approach.duration - moving.duration).followed_by(moving)
            if (contact := self._scenes[index].check_path(whole.path)) is not None:
                return Infeasible((f"{contact} if {primitive.name} meets nothing",))
            found[primitive.name] = whole
        return found

    def _motion(self, moves: Sequence[FoundMove], guarded: Mapping[str, Trajectory], q_end: Array) -> Motion:
        """The motion of one move for each primitive, which ends at q_end, shape (n,)."""
        primitives, start = [], 0.0
        resting: dict[int, Mapping[str, Array]] = {}  # by world, which several primitives share
        for primitive, move in zip(self._skill.primitives, moves, strict=True):
            world, end = primitive.world, start + move.trajectory.duration
            resting_fingers, guard = self._model.finger_positions(world.joints), None
            moving = with_fingers(self._model, move.trajectory, primitive.fingers, resting_fingers)
            if primitive.guard is not None:
                whole = with_fingers(self._model, guarded[primitive.name], None, resting_fingers)
                guard = Guard(primitive.guard.force, whole)
            if id(world) not in resting:
                resting[id(world)] = {name: X_WO for name, X_WO in world.X_WO.items() if name != world.held}
            primitives.append(
                TimedPrimitive(
                    name=primitive.name,
                    start=start,
                    end=end,
                    trajectory=moving,
                    held=world.held,
                    X_TO=world.X_TO,
                    X_WO=resting[id(world)],
                    around=move.around,
                    guard=guard,
                    too_slow=self._too_slow(primitive, move.trajectory),
                )
            )
            start = end
        final = self._skill.final
        X_WO, arm = dict(final.X_WO), dict(zip(self._model.arm, q_end.tolist(), strict=True))
        if final.held is not None and final.X_TO is not None:
            X_WO[final.held] = self._model.tool_pose(q_end) @ final.X_TO
        final = replace(final, X_WO=X_WO, joints={**final.joints, **arm})
        return Motion(self._model.joints, tuple(primitives), final)

    def _too_slow(self, primitive: GroundPrimitive, arm: Trajectory) -> str | None:
        """Its highest speed on curves of a stated one, where its phases meet, if that is not reached."""
        if not any(curve.length > sections.SHORTEST_LINE for curve in primitive.curves):
            return None
        q, velocity = arm.motion(arm.law.breaks, 1)
        J = self._model.tool_poses_and_jacobians(q).J[:, :3]
        reached = float(np.linalg.norm((J @ velocity[:, :, None])[..., 0], axis=1).max())
        slow = reached < REACHED * primitive.speed
        return f"reaches {100 * reached:.2g} of {100 * primitive.speed:.3g} cm/s" if slow else None


def no_such_branch(branch: Mapping[str, MotionValue]) -> Infeasible:
    """Why a stated branch cannot be taken."""
    words = (f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in branch.items())
    return Infeasible((f"no way of its arm is called {' '.join(words)}",))


_Names = Mapping[str, MotionValue]
"""The name of a branch at the end of one joint move: some of those of `BranchMotion.branch`."""


def _different(names: Sequence[_Names]) -> list[_Names]:
    """The names without repetitions, in their order."""
    return [found for number, found in enumerate(names) if found not in names[:number]]


def _agree(branch: _Names, names: _Names) -> bool:
    """Whether two branches say the same of what both name."""
    return all(branch.get(name, value) == value for name, value in names.items())
