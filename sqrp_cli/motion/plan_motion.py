"""The motion of a candidate, or of each branch: the fastest that is reachable, within limits and free of collisions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise, takewhile
from math import prod
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import CollisionScene
from sqrp_cli.motion.fingers import with_fingers
from sqrp_cli.motion.ground_primitives import ground_primitives
from sqrp_cli.motion.joint_moves import FoundMove, JointMoves, fastest_sequence
from sqrp_cli.motion.position_limits import worst_past_limit
from sqrp_cli.motion.sections import MotionProblem, Names, Section, Ways
from sqrp_cli.motion.tool_path import SHORTEST_LINE
from sqrp_cli.records import dataclass
from sqrp_cli.robot import inverse_kinematics
from sqrp_cli.robot.kinematics import RobotModel, positions_of
from sqrp_cli.robot.robot import AXES_OF_A_POSE
from sqrp_cli.skill.settings import MotionValue
from sqrp_cli.skill.skill import JointMove, SkillChoice
from sqrp_cli.trajectory import JointPath, Trajectory

MEASURED = 1e-3
"""Largest measured excess over a limit at the start of a motion, which then starts at the limit [rad or m]."""
REACHED = 0.98  # share of a stated speed above which it counts as reached
MAX_REASONS = 5  # most reasons of an infeasible motion
MOST_BRANCHES = 256
"""Most combinations of branches of several joint moves that are tried; those of the first moves come first."""


@dataclass(frozen=True, eq=False)
class TimedPrimitive:
    """A primitive action with its place in time."""

    name: str
    start: float
    end: float  # [s] from the start of the motion
    trajectory: Trajectory  # of the driven joints, from 0 to end - start
    held: str | None
    """The object in the tool during it, None if there is none: grasp attaches and release detaches at `end`."""
    X_TO: Array | None  # pose of the held object in the tool frame, shape (4, 4); None if there is none
    X_WO: Mapping[str, Array]  # poses of the objects that are not held
    around: str | None = None  # the link or object that it goes around, None if it is direct
    force: float | None = None  # at the tool [N], of a move that ends where it meets something
    unmet: Trajectory | None = None
    """Then the motion of the driven joints over its whole time to where it ends without contact.

    `trajectory` ends where contact is expected.
    """
    too_slow: str | None = None
    """The highest speed of its tool where that is below the stated one, such as `reaches 3.4 of 5 cm/s`."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of arm and fingers through a skill."""

    joint_names: tuple[str, ...]
    """The driven joints, in the order of all joint positions: those of the arm, then those of the fingers."""
    primitives: tuple[TimedPrimitive, ...]  # without gaps, in order
    final: World  # the world after it, with the facts from before; X_WO of a held object is its final pose
    initial: World | None = None  # the world before it, where that is its own: of a motion that was not planned
    doubts: tuple[str, ...] = ()  # of a recorded one: what was done to its clock, and what an object begins in

    @property
    def remarks(self) -> tuple[str, ...]:
        """Detours and speeds that are not reached, such as `a1 goes around wall` and `a4 reaches 3.4 of 5 cm/s`."""
        notes = ((p, note) for p in self.primitives for note in (p.around and f"goes around {p.around}", p.too_slow))
        return (*self.doubts, *(f"{p.name} {note}" for p, note in notes if note))

    @property
    def time(self) -> float:
        """Duration of the whole [s]."""
        return self.primitives[-1].end if self.primitives else 0.0

    def positions(self, primitive: int, t: Array) -> Array:
        """Joint positions at times t [s] from the start of the motion, within one primitive: shapes (m,) -> (m, n)."""
        return self.primitives[primitive].trajectory.positions(np.asarray(t) - self.primitives[primitive].start)


@dataclass(frozen=True, eq=False)
class Branches:
    """All branches that were tried for a motion."""

    tried: int  # one where no branch reaches its place, or nothing is free
    feasible: tuple[tuple[Names, Motion], ...]
    """Those with a motion, in a fixed order, each with the words of the parameters that leave it free.

    For an arm without such words the number of the solution of inverse kinematics at the end of a joint move, as
    `a1.solution`.
    """
    reasons: tuple[str, ...]  # why others fail, most useful first; not empty if all fail


@runtime_checkable
class KnownMotions(Protocol):
    """Motions that are not planned, by what a skill's parameters say."""

    def motion(self, choice: SkillChoice, world: World, model: RobotModel) -> Motion | Infeasible:
        """The motion of a choice; world: has what it does not tell."""


_Planned = TypeVar("_Planned", Motion, Branches)


def plan_motion(
    choice: SkillChoice, world: World, scene: CollisionScene, seed: int = 0, *, around: bool = True
) -> Motion | Infeasible:
    """The fastest feasible motion of a skill among all branches of inverse kinematics, joint turns included.

    seed: of the random ways around and redundant joints. Every move keeps its clearance at all times. Joint moves are
    straight in joint space; ways around are searched only if no combination of branches has direct moves throughout,
    the most promising combination first. For an arm with more than six axes, more positions of its redundant joints are
    tried if a few are not enough. Infeasible names, most useful first, what is out of reach, which joint is at its
    limit, or which contact occurs where. With a branch of `plan_branches`, exactly the motion that it has there.
    around: whether ways around are searched at all.
    """
    if isinstance(choice.skill.recorded, KnownMotions):
        return choice.skill.recorded.motion(choice, world, scene.model)
    return _planned(choice, world, scene, seed, lambda problem: _plan(problem, choice.branch, around=around))


def plan_branches(choice: SkillChoice, world: World, scene: CollisionScene, seed: int = 0) -> Branches | Infeasible:
    """The fastest feasible motion of each branch that the skill's parameters leave free; see `plan_motion`.

    Ways around are searched only if no branch has direct moves throughout, and then only the first one is given. At
    most `MOST_BRANCHES` are tried.
    """
    if isinstance(choice.skill.recorded, KnownMotions):
        found = choice.skill.recorded.motion(choice, world, scene.model)
        return found if isinstance(found, Infeasible) else Branches(1, (({}, found),), ())
    return _planned(choice, world, scene, seed, _plan_each)


def _planned(
    choice: SkillChoice,
    world: World,
    scene: CollisionScene,
    seed: int,
    plan: Callable[[MotionProblem], _Planned | Infeasible],
) -> _Planned | Infeasible:
    """What is planned of a skill that can begin; joints that are measured to be just past a limit are at that limit."""
    model, joints = scene.model, world.joints
    lower, upper = model.position_limits
    within = {
        name: min(max(joints[name], low), high)
        for name, low, high in zip(model.joints, lower.tolist(), upper.tolist(), strict=True)
        if low - MEASURED <= joints[name] <= high + MEASURED
    }
    if any(joints[name] != at for name, at in within.items()):  # else itself, as collision scenes are kept by world
        world = replace(world, joints={**joints, **within})
    begin = np.array([world.joints[name] for name in model.joints])
    if (past := worst_past_limit(model, JointPath.line(begin, begin))) is not None:
        return Infeasible((f"{past} before anything moves",))
    grounded = ground_primitives(choice, world, scene)
    if isinstance(grounded, Infeasible):
        return grounded
    primitives, final = grounded
    placed = cache(scene.placed)
    # Sections begin with a joint move; the first has none, and may be empty.
    cuts: list[int] = [i for i, primitive in enumerate(primitives) if primitive.kind is JointMove]
    sections = [Section(None, 0, primitives[: cuts[0] if cuts else None], is_fixed=True)]
    for cut, following in pairwise([*cuts, len(primitives)]):
        move, tied = primitives[cut], primitives[cut + 1 : following]
        sections.append(Section(move, cut + 1, tied, is_fixed=move.home))
    problem = MotionProblem(
        model=model,
        primitives=primitives,
        scenes=[placed(primitive.world, primitive.allowed) for primitive in primitives],
        sections=sections,
        final=final,
        q_start=positions_of(model.arm, world.joints),
        seed=seed,
        redundancy_samples=inverse_kinematics.REDUNDANCY_SAMPLES,
    )
    found = plan(problem)
    failed = isinstance(found, Infeasible) or (isinstance(found, Branches) and not found.feasible)
    if failed and len(model.arm) > AXES_OF_A_POSE and not problem.out_of_reach:
        more = inverse_kinematics.MORE_REDUNDANCY_SAMPLES
        return plan(replace(problem, redundancy_samples=more, failures=[]))
    return found


def _plan(problem: MotionProblem, branch: Names, *, around: bool) -> Motion | Infeasible:
    """The fastest motion of a branch as `plan_branches` names it; of all, if it is empty."""
    ways = _ways(problem)
    if ways is None:
        return _infeasible(problem)
    durations = _durations(problem, ways, branch)
    if not all(np.isfinite(duration).any() for duration in durations):
        return no_such_branch(branch)
    return _fastest(problem, ways, JointMoves(problem, ways), durations, around=around)


def _plan_each(problem: MotionProblem) -> Branches:
    """The fastest motion of each branch."""
    ways = _ways(problem)
    tried = prod(max(1, len({tuple(name.items()) for name in problem.names(one)})) for one in problem.sections)
    if ways is None:
        return Branches(tried, (), _infeasible(problem).reasons)
    moves = JointMoves(problem, ways, each=True)
    branches: list[dict[str, MotionValue]] = [{}]
    for through in ways:
        possible = {tuple(name.items()): name for name in through.names}.values()
        branches = [{**one, **more} for one in branches for more in possible if _agree(one, more)][:MOST_BRANCHES]
    planned = [(one, _fastest(problem, ways, moves, _durations(problem, ways, one), around=False)) for one in branches]
    feasible = [(one, motion) for one, motion in planned if isinstance(motion, Motion)]
    if not feasible:
        motion = _fastest(problem, ways, moves, _durations(problem, ways, {}), around=True)
        if isinstance(motion, Infeasible):
            return Branches(tried, (), motion.reasons)
        feasible = [({}, motion)]
    return Branches(tried, tuple(feasible), problem.reasons(MAX_REASONS))


def _ways(problem: MotionProblem) -> list[Ways] | None:
    """The ways through each section; None if one has none."""
    found = (problem.ways(section) for section in problem.sections)
    ways = [*takewhile(lambda through: through is not None, found)]
    return [*filter(None, ways)] if len(ways) == len(problem.sections) else None


def _fastest(
    problem: MotionProblem, ways: Sequence[Ways], moves: JointMoves, durations: Sequence[Array], *, around: bool
) -> Motion | Infeasible:
    """The fastest motion of the ways of finite durations; around: look for ways around, if need be."""
    starts = [through.q_start for through in ways]
    given = starts, durations, moves.durations, moves.works
    chosen = fastest_sequence(*given, takes=moves.takes)
    if chosen is None and around:
        chosen = fastest_sequence(*given, takes=moves.takes, around=True)
    if chosen is None:
        return _infeasible(problem, moves.tries)
    along = moves.along(chosen)
    if isinstance(along, Infeasible):
        return along
    done: list[FoundMove] = []
    for i, (through, k, move) in enumerate(zip(ways, chosen, [None, *along], strict=True)):
        done += [move] if move is not None else []
        tied = moves.tied(i, int(through.of[k]))
        done += [(Trajectory(one.path.shifted(through.turns[k]), one.law), None) for one in tied]
    motion = _motion(problem, done, ways[-1].q_end[chosen[-1]])
    for primitive in motion.primitives if isinstance(motion, Motion) else ():
        if (past := worst_past_limit(problem.model, primitive.trajectory.path)) is not None:
            return Infeasible((f"{primitive.name}: {past}",))
    return motion


def _infeasible(problem: MotionProblem, tries: int = 0) -> Infeasible:
    """The collected reasons, with the number of tries to find a way around."""
    reasons, samples = problem.reasons(MAX_REASONS), problem.redundancy_samples
    if samples > inverse_kinematics.REDUNDANCY_SAMPLES:
        joint = problem.model.arm[inverse_kinematics.held_joints(problem.model)[0]]
        reasons = (f"{reasons[0]}, with {samples} positions of `{joint}` tried", *reasons[1:])
    if tries > 0:
        reasons = (f"{reasons[0]}, and no way around was found in {tries:,} tries", *reasons[1:])
    return Infeasible(reasons)


def _motion(problem: MotionProblem, moves: Sequence[FoundMove], q_end: Array) -> Motion | Infeasible:
    """The motion of one move for each primitive, which ends at q_end, shape (n,)."""
    primitives, start, model = [], 0.0, problem.model
    resting: dict[int, Mapping[str, Array]] = {}  # by world, which several primitives share
    for index, (primitive, (trajectory, around)) in enumerate(zip(problem.primitives, moves, strict=True)):
        world, end = primitive.world, start + trajectory.duration
        fingers, unmet = positions_of(model.fingers.joints, world.joints), None
        if primitive.force is not None:
            # The whole motion where it meets nothing; that of the move is up to contact.
            whole, still = trajectory, np.zeros_like(model.turns)
            for curve in primitive.legs[len(primitive.curves) :]:
                (path,) = problem.follow(index, primitive, curve, whole.path.end[None], still)
                if path is None:
                    return _infeasible(problem)
                (beyond,) = problem.timed([(path, primitive, curve)])
                whole = trajectory.shortened(trajectory.duration - beyond.duration).followed_by(beyond)
            if (contact := problem.scenes[index].check_path(whole.path)) is not None:
                return Infeasible((f"{contact} if {primitive.name} meets nothing",))
            unmet = with_fingers(model, whole, None, fingers)
        too_slow = None
        if any(curve.length > SHORTEST_LINE for curve in primitive.curves):
            q, velocity = trajectory.motion(trajectory.law.breaks, 1)  # it is fastest where phases meet
            J = model.tool_poses_and_jacobians(q)[1][:, :3]
            reached = float(np.linalg.norm((J @ velocity[:, :, None])[..., 0], axis=1).max())
            if reached < REACHED * primitive.speed:
                too_slow = f"reaches {100 * reached:.2g} of {100 * primitive.speed:.3g} cm/s"
        if id(world) not in resting:
            resting[id(world)] = {name: X_WO for name, X_WO in world.X_WO.items() if name != world.held}
        primitives.append(
            TimedPrimitive(
                name=primitive.name,
                start=start,
                end=end,
                trajectory=with_fingers(model, trajectory, primitive.fingers, fingers),
                held=world.held,
                X_TO=world.X_TO,
                X_WO=resting[id(world)],
                around=around,
                force=primitive.force,
                unmet=unmet,
                too_slow=too_slow,
            )
        )
        start = end
    final = problem.final
    X_WO, arm = dict(final.X_WO), dict(zip(model.arm, q_end.tolist(), strict=True))
    if final.held is not None and final.X_TO is not None:
        X_WO[final.held] = model.tool_pose(q_end) @ final.X_TO
    return Motion(model.joints, tuple(primitives), replace(final, X_WO=X_WO, joints={**final.joints, **arm}))


def no_such_branch(branch: Mapping[str, MotionValue]) -> Infeasible:
    """Why a stated branch cannot be taken."""
    words = (f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in branch.items())
    return Infeasible((f"no way of its arm is called {' '.join(words)}",))


def _durations(problem: MotionProblem, ways: Sequence[Ways], branch: Names) -> list[Array]:
    """How long the ways through each section take at least [s]; those of other branches take endlessly long."""
    return [
        np.where([_agree(branch, through.names[one]) for one in through.of.tolist()], section.least_duration, np.inf)
        for section, through in zip(problem.sections, ways, strict=True)
    ]


def _agree(branch: Names, names: Names) -> bool:
    """Whether two branches say the same of what both name."""
    return all(branch.get(name, value) == value for name, value in names.items())
