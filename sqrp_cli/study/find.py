"""The best way of doing what a candidate says: all are planned and observed, and none is judged by less.

A way is no longer looked at once another one, which takes no longer, surely sees as much in every respect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from itertools import compress
from math import inf

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible, bad_option
from sqrp_cli.figures import ROUNDING, Qualities
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.units import TIME, expected_quantity, read_quantity
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion, no_such_branch, plan_branches, plan_motion
from sqrp_cli.records import dataclass
from sqrp_cli.robot.reach import TURNED
from sqrp_cli.study.analysis import Analysis, planned_motion, with_delays, without_delays
from sqrp_cli.study.ranking import QUALITY_STEP, compared_quality, compared_time, contenders, rank
from sqrp_cli.study.result import BlindEnd, CandidateResult, Criterion, WayFigures, WaysFound
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.timeline import PlannedMotion, Timeline, observe
from sqrp_cli.task.feasibility import feasible_motion, impossible_start
from sqrp_cli.task.grips import first_grip, grips
from sqrp_cli.task.task import Candidate


@dataclass(frozen=True)
class TimeLimit:
    """The longest time of a way."""

    seconds: float | None = None  # [s]; None for a multiple of the fastest way's
    times: float = 1.0  # Of the time of the fastest of all ways of the candidate, where no seconds are given

    @classmethod
    def read(cls, text: str, option: str = "--max-time") -> TimeLimit:
        """A limit such as `20 s` or `1.25x`. Raises InputError for anything else."""
        stripped = text.strip()
        try:
            times = float(stripped[:-1]) if stripped.endswith("x") else None
        except ValueError:
            times = None
        if times is not None and 1.0 <= times <= 1e6:
            return cls(None, times)
        quantity = read_quantity(text)
        if times is None and quantity is not None and quantity.dimension in (None, TIME) and 0 < quantity.value <= 1e6:
            return cls(quantity.value)
        seconds = expected_quantity(replace(TIME, example="20 s"))
        expected = f"{seconds}, or a multiple of the time of the fastest of all ways, at least 1, such as `1.25x`"
        raise bad_option(f"{option} is `{text}`, expected {expected}")

    def within(
        self, motions: Sequence[PlannedMotion], whose: str = "its fastest way"
    ) -> tuple[float, Sequence[PlannedMotion] | Infeasible]:
        """The longest time of a way [s], and the ways that keep it, or by how much the fastest one exceeds it.

        motions: all ways of a candidate. whose: how the reason names the fastest.
        """
        fastest = min(planned.motion.time for planned in motions)
        longest = self.times * fastest if self.seconds is None else self.seconds
        kept = [planned for planned in motions if planned.motion.time <= longest + ROUNDING]
        late = f"{whose} takes {fastest:.2f} s, {fastest - longest:.2f} s more than allowed"
        return longest, kept or Infeasible((late,))


@dataclass(frozen=True, eq=False)
class BestWay:
    """The best way of a candidate, and what became of the others."""

    analysis: Analysis
    result: CandidateResult  # Of the analysis, with its ways


@dataclass(frozen=True)
class WantedWay:
    """Which of its ways a candidate is done in."""

    by: Criterion = "q_eoi"  # What counts first
    fastest: bool = False  # Whether the fastest branch with the first grip is taken without a look at others
    limit: TimeLimit | None = None  # How long it may take


def find_way(
    cell: Cell, candidate: Candidate, world: World, sampling: Sampling, wanted: WantedWay, plans: Plans | None = None
) -> BestWay | Infeasible:
    """The wanted way of doing what a candidate says: every way is planned, and observed as far as it may be the best.

    plans: what is known of motions already, and is added to.
    """
    compared = wanted.by in ("q_eoi", "q_avg", "time")  # then only some may be the best or Pareto-optimal
    orders = (wanted.by == "q_eoi",)
    found = _observed_ways(cell, candidate, world, sampling, wanted, plans, orders=orders, contending=compared)
    if isinstance(found, Infeasible):
        return found
    ways, seen = found
    if compared:
        seen = list(compress(seen, contenders(list(map(without_delays, seen)), wanted.by)))
    analyses = [with_delays(cell, one, sampling) for one in seen]
    ranked = rank([analysis.result for analysis in analyses], wanted.by)
    best = ranked[0]
    chosen = next(analysis for analysis in analyses if analysis.planned.candidate is best.candidate)
    optimal: dict[tuple[float, ...], CandidateResult] = {}  # one of those that are equal, as they are compared
    for one in (one for one in ranked if one.pareto or one.rank == 1):
        figures = compared_quality(one.q_eoi), compared_quality(one.q_avg), compared_time(one.time or 0.0)
        optimal.setdefault(figures, one)
    pareto = tuple(
        from_fields(
            WayFigures,
            way,
            parameters=way.candidate.parameters,
            vias={name: vias.tolist() for name, vias in way.candidate.vias.items()},
            time=float(way.time or 0.0),
        )
        for way in optimal.values()
    )
    ends: tuple[BlindEnd, ...] = ()
    if candidate.open_paths:
        from sqrp_cli.study.seen_ways import blind_ends

        ends = blind_ends(chosen, candidate.open_paths)
    return BestWay(chosen, replace(best, ways=replace(ways, pareto=pareto, blind_ends=ends)))


def analysed_ways(
    cell: Cell,
    candidate: Candidate,
    world: World,
    sampling: Sampling,
    *,
    limit: TimeLimit,
    worth: Callable[[Qualities], bool],
    plans: Plans | None = None,
) -> Iterator[Analysis]:
    """All ways of a candidate within a limit whose qualities are worth an analysis, the fastest first.

    Nothing if it cannot be done. plans: what is known of motions already.
    """
    found = _observed_ways(cell, candidate, world, sampling, WantedWay(limit=limit), plans, orders=(True, False))
    if not isinstance(found, Infeasible):
        for one in sorted(found[1], key=lambda way: compared_time(way.planned.motion.time)):
            if worth(one.qualities):
                yield with_delays(cell, one, sampling)


def _observed_ways(
    cell: Cell,
    candidate: Candidate,
    world: World,
    sampling: Sampling,
    wanted: WantedWay,
    plans: Plans | None,
    *,
    orders: Sequence[bool],
    contending: bool = False,
) -> tuple[WaysFound, list[Timeline]] | Infeasible:
    """How many ways of a candidate there are, and what is seen of those within the limit.

    Where it leaves paths open, the ways with direct ones come first, then those that are found for each of `orders`:
    whether quality in events of interest counts before all else. contending: see `observed`.
    """
    if (obstacle := impossible_start(cell, candidate, world)) is not None:
        return obstacle
    plans = plans or Plans()
    tried, motions = plans.of(cell, candidate, world, fastest=wanted.fastest)
    longest = inf
    if wanted.limit is not None and not isinstance(motions, Infeasible):
        whose = "its way with `--ways first`" if wanted.fastest else "its fastest way"
        longest, motions = wanted.limit.within(motions, whose)
    if isinstance(motions, Infeasible):
        return replace(motions, tried=tried)
    seen = observed(cell, motions, sampling, contending=contending)
    if candidate.open_paths:
        from sqrp_cli.study.seen_ways import seen_ways

        direct = (replace(one.planned, candidate=one.planned.candidate.with_paths({})) for one in seen)
        seen = [replace(one, planned=planned) for one, planned in zip(seen, direct, strict=True)]
        for first in orders:
            seen += seen_ways(cell, motions, sampling, longest=longest, interest_first=first)
    return WaysFound(tried=tried, feasible=len(motions), pareto=()), seen


def observed(
    cell: Cell, motions: Sequence[PlannedMotion], sampling: Sampling, *, contending: bool = False
) -> list[Timeline]:
    """What is seen of ways.

    contending: whether only `contenders` need exact figures. The fastest ways are looked at first. Another one is
    looked at no closer once all that it may still be found to see is no more than a way sees that takes no longer: then
    it is no contender, by its figures so far or by exact ones.
    """
    if not contending or len({(one.T > 0.0, one.T_eoi > 0.0) for one in motions}) > 1:  # not to be compared
        return [observe(one, cell.observer, sampling, full=False) for one in motions]
    found: dict[int, Timeline] = {}
    known: list[tuple[float, float, float]] = []  # time and qualities as they are compared
    for number in sorted(range(len(motions)), key=lambda index: motions[index].motion.time):
        planned, time = motions[number], compared_time(motions[number].motion.time)
        # A way that is as fast must see more. What rounding may add must not decide.
        least = [(avg - (QUALITY_STEP if time == its_time else 0.0), eoi) for its_time, avg, eoi in known]
        bars = (1.0 - np.array(least).reshape(-1, 2)) * [planned.T, planned.T_eoi] * (1.0 + 1e-9)
        found[number] = observe(planned, cell.observer, sampling, full=False, bars=bars)
        seen = found[number].qualities
        known.append((time, compared_quality(seen.q_avg), compared_quality(seen.q_eoi)))
    return [found[number] for number in range(len(motions))]


def with_branch(cell: Cell, planned: PlannedMotion) -> Candidate:
    """The candidate of a planned motion with its branch, if it leaves that free; else the candidate itself."""
    way = planned.candidate
    branches = plan_branches(way, planned.world, cell.collision, cell.seed)
    for branch, motion in () if isinstance(branches, Infeasible) or way.branch else branches.feasible:
        # Whether two motions of a skill lead through the same joint positions in the same time.
        pairs = list(zip(motion.primitives, planned.motion.primitives, strict=True))
        in_time = all(abs(a.end - b.end) < 1e-9 for a, b in pairs)
        ends = (
            (motion.positions(n, np.array([a.end])), planned.motion.positions(n, np.array([b.end])))
            for n, (a, b) in enumerate(pairs)
        )
        if in_time and all(np.allclose(a, b, atol=1e-9) for a, b in ends):
            return replace(way, branch=branch)
    return way


def some_motion(cell: Cell, candidate: Candidate, world: World) -> Motion | Infeasible:
    """The fastest motion of a candidate with the first grip that has one; else why the first has none, or a turn helps.

    Ways around are searched for the first grip only.
    """
    first = feasible_motion(cell, first_grip(candidate), world)
    if isinstance(first, Motion) or impossible_start(cell, candidate, world) is not None:
        return first
    for grip in grips(cell, candidate, world)[1:]:
        motion = plan_motion(grip, world, cell.collision, cell.seed, around=False)
        if isinstance(motion, Motion):
            return motion
        first = min(first, motion, key=_mended_by_a_turn)
    return first


def _mended_by_a_turn(none: Infeasible) -> bool:
    """False, which is less, for what would be within reach when turned."""
    return not any(TURNED in reason for reason in none.reasons)


Planned = tuple[int, Sequence[PlannedMotion] | Infeasible]
"""How many ways were tried, and those that can be done, or why none can."""


@dataclass(eq=False)
class Plans:
    """The planned ways of candidates in one world, for cells that differ in their cameras only."""

    _known: dict[tuple[int, bool], tuple[Candidate, Planned]] = field(default_factory=dict)

    def of(self, cell: Cell, candidate: Candidate, world: World, *, fastest: bool) -> Planned:
        """Every way of a candidate, of the branch that it states, if any; planned at the first time.

        World and cell: see the class. fastest: only the fastest branch with the first grip, which is its way with
        `--ways first`.
        """
        key = (id(candidate), fastest)
        if key in self._known:
            return self._known[key][1]
        tried, motions = 0, list[PlannedMotion]()
        reasons: list[tuple[str, ...]] = []
        if fastest:
            way = first_grip(candidate)
            motion = plan_motion(way, world, cell.collision, cell.seed)
            feasible = [] if isinstance(motion, Infeasible) else [planned_motion(cell, way, world, motion)]
            self._known[key] = candidate, (1, motion if isinstance(motion, Infeasible) else feasible)
            return self._known[key][1]
        for grip in grips(cell, candidate, world):
            branches = plan_branches(grip, world, cell.collision, cell.seed)
            reasons.append(branches.reasons)
            if isinstance(branches, Infeasible):
                tried += 1
                continue
            tried += 1 if grip.branch else branches.tried
            stated = ((one, motion) for one, motion in branches.feasible if {**one, **grip.branch} == one)
            ways = ((replace(grip, branch=one), motion) for one, motion in stated)
            motions += [planned_motion(cell, way, world, motion) for way, motion in ways]
        why_none = min(map(Infeasible, reasons), key=_mended_by_a_turn)
        none = no_such_branch(candidate.branch) if candidate.branch else why_none
        self._known[key] = candidate, (tried, motions or none)
        return self._known[key][1]
