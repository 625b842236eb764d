"""Ways of a candidate with paths that the cameras can follow: a race of the most promising, then the exact figures.

Which joint moves may take other paths, what limits them, and ends that no path helps come first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import ROUNDING
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.ground_primitives import ground_primitives
from sqrp_cli.motion.position_limits import near_limits
from sqrp_cli.motion.timing import MotionLimits
from sqrp_cli.records import dataclass
from sqrp_cli.skill.skill import HOME
from sqrp_cli.study.analysis import Analysis, planned_motion
from sqrp_cli.study.move_search import COST_DECIMALS, EXACTLY, SETTLED, MoveSearch, SeenPath, exchange
from sqrp_cli.study.result import BlindEnd
from sqrp_cli.study.sampling import Adaptive, Sampling
from sqrp_cli.study.stage import Samples
from sqrp_cli.study.timeline import PlannedMotion, Timeline, look_at, observe
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import Candidate
from sqrp_cli.trajectory import JointPath, Trajectory

BLIND_WEIGHT, BLIND_WEIGHT_WITHIN = 4.0, 20.0
"""Seconds of motion that a blind second counts for; and within a limit of the time, which is price enough."""
RACE = ((3, 3), (2, 3))
"""The rounds of the race: how many ways run, and for how many generations of paths; then the best goes on alone."""
MOST_WORK = 24_000  # In looks at paths of one candidate: when so many are reached, the search ends
SAME_TIME = 0.05  # Ways of one branch whose times differ by no more than this are searched once [s]
WORTH_SEARCHING = 0.05  # A move that is blind for less than this is left as it is [s]
LEVEL = 0.02
"""Qualities in events of interest that differ by no more than about this count as equal while ways are chosen."""
GLANCE_STEP = 0.4  # Time between the looks that tell direct ways apart [s]
LEFT = 6  # Paths of each move that are left in the end
MOST_COMBINATIONS = 10_000
"""Combinations of paths of several moves that are compared; of more, those that cost least go on to the next move."""


def open_moves(planned: PlannedMotion, names: Collection[str]) -> list[int]:
    """Those of the named joint moves of a way during which formulas apply, by index."""
    monitored = {piece.primitive for piece in planned.stage.pieces if piece.literals}
    named = (index for index, primitive in enumerate(planned.motion.primitives) if primitive.name in names)
    return [index for index in named if index in monitored]


def move_searches(cell: Cell, planned: PlannedMotion, names: Collection[str], spare: float) -> Iterator[MoveSearch]:
    """Searches for paths of the named joint moves during which formulas apply; moves by home have none.

    spare: longest time beyond that of the direct way [s].
    """
    model = cell.model
    grounded = ground_primitives(planned.candidate, planned.world, cell.collision)
    if isinstance(grounded, Infeasible):
        raise ValueError(f"{planned.candidate.name} was feasible a moment ago")
    seed = cell.seed
    for index in open_moves(planned, names):
        primitive, timed = grounded[0][index], planned.motion.primitives[index].trajectory
        if primitive.via_home:
            continue
        arm = slice(len(model.arm))
        direct = Trajectory(JointPath(timed.path.breaks, timed.path.coefficients[:, :, arm]), timed.law)
        q0, q1 = direct.path.positions([0.0, 1.0])
        path = SeenPath(np.zeros((0, len(q0))), direct, free=True)
        yield MoveSearch(
            planned=planned,
            primitive=index,
            q0=q0,
            q1=q1,
            bounds=near_limits(model, np.stack([q0, q1])),
            limits=MotionLimits.of(model, primitive.speed),
            placed=cell.collision.placed(primitive.world, primitive.allowed),
            direct=path,
            best=path,
            found=[path],
            longest=direct.duration + spare,
            seed=seed,
        )
        seed += 1000  # a search takes the next one for each evolution that it begins: moves have no draws in common


def blind_ends(analysis: Analysis, names: Collection[str]) -> tuple[BlindEnd, ...]:
    """The ends of the named joint moves at which the state itself is not covered, in the order of time."""
    timeline, actions = analysis.timeline, analysis.planned.candidate.skill.primitives
    t, blind, ends = timeline.samples.t, timeline.observation.blind, list[BlindEnd]()
    for index in open_moves(analysis.planned, names):
        within = np.array([piece.primitive == index for piece in analysis.planned.stage.pieces])
        rows = np.flatnonzero(within[timeline.samples.piece])
        stops = [stop for action in actions[:index] if (stop := getattr(action, "to", None)) is not None]
        for at, in_order in ((str([HOME, *stops][-1]), rows), (str(getattr(actions[index], "to", "")), rows[::-1])):
            if not blind[in_order[0]]:
                continue
            seen = np.flatnonzero(~blind[in_order])  # up to the first sample that is covered
            seconds = float(abs(t[in_order[seen[0] if len(seen) else -1]] - t[in_order[0]]))
            if seconds:
                ends.append(BlindEnd(primitive=actions[index].name, at=at, seconds=seconds))
            if not len(seen):
                break  # It is not covered anywhere: once is enough.
    return tuple(ends)


def seen_ways(
    cell: Cell,
    motions: Sequence[PlannedMotion],
    sampling: Sampling,
    *,
    longest: float = np.inf,
    interest_first: bool = True,
) -> list[Timeline]:
    """Ways with paths of joint moves along which the cameras lose sight of less, each observed exactly.

    motions: direct ways of one candidate, from one world. longest: the most time that a way may take [s].
    interest_first: whether quality in events of interest counts before all else. The result depends only on the
    arguments. It is empty if no path is better than the direct ones.

    For each joint move that leaves its path open, `BLIND_WEIGHT` times the blind time plus the duration is minimised
    over joint positions that it bends around.
    """
    runners = _runners(cell, motions, longest, interest_first)
    if not runners:
        return []
    everyone, work = [search for runner in runners for search in runner.searches], 0
    for number, generations in RACE:
        runners = sorted(runners, key=lambda runner: (-runner.level, runner.cost()))[:number]
        work += exchange(cell.observer, _searches(runners), everyone)
        for _ in range(generations):
            work += sum(search.advance(cell.observer) for search in _searches(runners))
    runners = sorted(runners, key=lambda runner: (-runner.level, runner.cost()))[:1]
    work += exchange(cell.observer, _searches(runners), everyone)
    while work < MOST_WORK and (searches := _searches(runners)):
        work += sum(search.advance(cell.observer) for search in searches)
    return [found for runner in runners if (found := _result(cell, runner, sampling, longest)) is not None]


def way_with_seen_paths(cell: Cell, way: Candidate, world: World) -> Candidate:
    """One way with the best paths from a world; with direct ones where none is better, or where it cannot be done."""
    direct = way.with_paths({})
    motion = feasible_motion(cell, direct, world)
    if isinstance(motion, Infeasible):
        return direct
    seen = seen_ways(cell, [replace(planned_motion(cell, direct, world, motion), candidate=way)], Adaptive())
    return seen[0].planned.candidate if seen else direct


@dataclass(frozen=True, eq=False)
class _Runner:
    """A way with the searches for its paths."""

    planned: PlannedMotion  # Of the direct way
    level: int
    """The quality in events of interest that it may reach, in steps of `LEVEL`; 0 where that does not count first."""
    blind_elsewhere: float  # How long the state is not covered outside the moves that are searched [s]
    searches: tuple[MoveSearch, ...]
    weight: float  # Seconds of motion that a blind second counts for

    def cost(self, paths: Sequence[SeenPath] | None = None) -> float:
        """What is minimised, with one path for each search, the best so far by default [s]."""
        paths = [search.best for search in self.searches] if paths is None else paths
        longer = sum(path.time - search.direct.time for search, path in zip(self.searches, paths, strict=True))
        blind = self.blind_elsewhere + sum(path.blind for path in paths)
        return round(self.weight * blind + (self.planned.motion.time + longer), COST_DECIMALS)


def _glance(cell: Cell, planned: PlannedMotion) -> Array:
    """How long the state is not covered, and not in events of interest, in each of p primitives, shape (2, p) [s].

    By looks in the middles of equal stretches of about `GLANCE_STEP` of each primitive of a direct way.
    """
    primitives, stage = planned.motion.primitives, planned.stage
    counts = np.array([max(1, int(np.ceil((p.end - p.start) / GLANCE_STEP))) for p in primitives])
    times = [
        p.start + (p.end - p.start) * (np.arange(count) + 0.5) / count
        for p, count in zip(primitives, counts, strict=True)
    ]
    t = np.concatenate(times)
    samples = Samples(np.searchsorted([p.end for p in stage.pieces[:-1]], t), t)
    blind = look_at(cell.observer, planned, samples).blind
    at = np.array([piece.primitive for piece in stage.pieces])[samples.piece]
    step = np.array([p.end - p.start for p in primitives]) / np.maximum(np.bincount(at, minlength=len(counts)), 1)
    uncovered = (blind, blind & stage.of_interest(samples))
    return np.stack([np.bincount(at, some, len(primitives)) * step for some in uncovered])


def _runners(cell: Cell, motions: Sequence[PlannedMotion], longest: float, interest_first: bool) -> list[_Runner]:
    """The most promising ways at the start: those that would be best if all their open moves could be seen."""
    weight = BLIND_WEIGHT if np.isinf(longest) else BLIND_WEIGHT_WITHIN

    def outlook(planned: PlannedMotion, uncovered: Array, moves: Sequence[int]) -> tuple[int, float]:
        """The level and the uncovered time elsewhere [s] if these moves were seen; uncovered: see `_glance`."""
        elsewhere, interest = np.delete(uncovered, moves, axis=1).sum(axis=1).tolist()
        level = round((1.0 - interest / planned.T_eoi) / LEVEL) if interest_first and planned.T_eoi > 0 else 0
        return level, elsewhere

    found = []
    for planned in motions:
        if moves := open_moves(planned, planned.candidate.open_paths):
            uncovered = _glance(cell, planned)
            level, elsewhere = outlook(planned, uncovered, moves)
            found.append((-level, weight * elsewhere + planned.motion.time, planned, uncovered))
    chosen: list[tuple[PlannedMotion, Array]] = []
    for _, _, planned, uncovered in sorted(found, key=lambda one: one[:2]):
        same_branch = (other for other, _ in chosen if other.candidate.branch == planned.candidate.branch)
        known = any(abs(planned.motion.time - other.motion.time) < SAME_TIME for other in same_branch)
        if len(chosen) < RACE[0][0] and not known:
            chosen.append((planned, uncovered))
    runners = []
    for planned, uncovered in chosen:
        searches = list(move_searches(cell, planned, planned.candidate.open_paths, longest - planned.motion.time))
        for search in searches:
            search.look(cell.observer, [search.direct], EXACTLY)
        searched = tuple(search for search in searches if search.direct.blind > WORTH_SEARCHING)
        level, elsewhere = outlook(planned, uncovered, [search.primitive for search in searches])
        blind = elsewhere + sum(search.direct.blind for search in searches if search not in searched)
        if searched:
            runners.append(_Runner(planned, level, blind, searched, weight))
    return runners


def _searches(runners: Sequence[_Runner]) -> list[MoveSearch]:
    """The searches that still may win more than hardly anything."""
    every = (search for runner in runners for search in runner.searches)
    return [search for search in every if search.best.cost - search.direct.time >= SETTLED]


def paths_together(left: Sequence[Sequence[SeenPath]], most: float, weight: float) -> list[tuple[SeenPath, ...]]:
    """Combinations of one path of each move that take no longer than `most` [s] together, at most `MOST_COMBINATIONS`.

    weight: seconds of motion that a blind second counts for.
    """
    together: list[tuple[SeenPath, ...]] = [()]
    for paths in left:
        longer = [(*some, path) for some in together for path in paths]
        together = [some for some in longer if sum(path.time for path in some) <= most]
        if len(together) > MOST_COMBINATIONS:
            together.sort(key=lambda some: sum(weight * path.blind + path.time for path in some))
            del together[MOST_COMBINATIONS:]
    return together


def _result(cell: Cell, runner: _Runner, sampling: Sampling, longest: float) -> Timeline | None:
    """The way with the best paths that fit the time together, observed exactly; None if none is better."""
    spare = longest - runner.planned.motion.time
    left: list[list[SeenPath]] = []
    for search in runner.searches:
        # The direct path, and the best others of which none is both longer and blind for longer than another.
        kept: list[SeenPath] = []
        for path in sorted(search.found, key=lambda path: (path.time, path.blind)):
            if not kept or path.blind < kept[-1].blind:
                kept.append(path)
        others = sorted((one for one in kept if len(one.vias)), key=lambda one: runner.weight * one.blind + one.time)
        left.append([search.direct, *others[: LEFT - 1]])
        search.look(cell.observer, left[-1], EXACTLY)
    # A free path for each move, together of the least cost within the time.
    most = sum(search.direct.time for search in runner.searches) + spare + ROUNDING
    together = paths_together(left, most, runner.weight)
    direct = tuple(search.direct for search in runner.searches)
    paths = next(
        (
            paths
            for paths in sorted(together, key=runner.cost)
            if all(search.is_free(path) for search, path in zip(runner.searches, paths, strict=True))
        ),
        direct,
    )
    names = [runner.planned.motion.primitives[search.primitive].name for search in runner.searches]
    vias = {name: path.vias for name, path in zip(names, paths, strict=True) if len(path.vias)}
    if not vias:
        return None
    way, world = runner.planned.candidate.with_paths(vias), runner.planned.world
    motion = feasible_motion(cell, way, world)
    if isinstance(motion, Infeasible) or motion.time > longest + ROUNDING:
        return None
    found = observe(planned_motion(cell, way, world, motion), cell.observer, sampling, full=False)
    blind = (1.0 - (found.qualities.q_avg or 0.0)) * found.planned.T
    return found if round(runner.weight * blind + motion.time, COST_DECIMALS) < runner.cost(direct) else None
