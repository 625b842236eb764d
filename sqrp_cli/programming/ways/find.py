"""The best way of doing what a candidate says: all are planned and looked at, those that may be best are studied."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import (
    Assessment,
    Rehearsal,
    Study,
    WayFigures,
    WaysFound,
    observed,
    rehearsal,
)
from sqrp_cli.programming.coverage.look import Look, look_at
from sqrp_cli.programming.coverage.observation import Observation
from sqrp_cli.programming.coverage.sampling import Adaptive, Sampling, within_pieces
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.coverage.timeline import Timeline
from sqrp_cli.programming.feasibility import impossible_start, skill_use
from sqrp_cli.programming.motion.plan_motion import plan_branches, plan_motion
from sqrp_cli.programming.ranking import Criterion, Ranked, compared_quality, rank
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.grips import first_grip, grips
from sqrp_cli.programming.ways.time_limit import TimeLimit

LOOKS_AT_MOVE, LOOKS_AT_OTHERS = 17, 5
"""Instants at which a joint move, and any other primitive action, is looked at; both ends included."""

UNSEEN_EVENTS = 0.02
"""By how much Q may exceed the most favourable figure of a look, which misses short events."""


@dataclass(frozen=True, eq=False)
class Prospect:
    """A way that can be done, with the most that it may be worth."""

    scene: Rehearsal

    q_avg: float
    q_eoi: float
    """At most, in 0..1, rounded as figures are compared; 1 where undefined."""

    @property
    def time(self) -> float:
        """Duration of the whole motion [s]."""
        return self.scene.motion.time

    def is_beaten_by(self, other: Assessment) -> bool:
        """Whether it cannot be better than a way that was studied in any of quality, interest and time."""
        least = min(compared_quality(other.q_avg) - self.q_avg, compared_quality(other.q_eoi) - self.q_eoi)
        return least >= 0 and other.time is not None and other.time <= self.time


@dataclass(frozen=True, eq=False)
class BestWay:
    """The best way of a candidate, and what became of the others."""

    study: Study
    ways: WaysFound


@dataclass(frozen=True)
class WantedWay:
    """Which of its ways a candidate is done in."""

    by: Criterion = "q_eoi"
    """What counts first."""

    fastest: bool = False
    """Whether the fastest branch with the first grip is taken without a look at others."""

    limit: TimeLimit | None = None
    """How long it may take."""


def find_way(
    cell: Cell, candidate: Candidate, world: World, sampling: Sampling, wanted: WantedWay
) -> BestWay | Infeasible:
    """The wanted way of doing what a candidate says.

    Every way is planned. A look at a few instants of each gives the most that it may be worth: what lies between two
    instants counts as seen if it is in one of them, and `UNSEEN_EVENTS` are added. Those that cannot be better than a
    way that was studied exactly are left out; the most promising are studied first. Where that does not bound what
    counts (delays, instants that a user chose), all are studied.
    """
    if (obstacle := impossible_start(cell, candidate, world)) is not None:
        return obstacle
    planned = (_fastest if wanted.fastest else _planned)(cell, candidate, world)
    allowed = planned.scenes
    if wanted.limit is not None and not isinstance(allowed, Infeasible):
        allowed = wanted.limit.within(allowed)
    if isinstance(allowed, Infeasible):
        return replace(allowed, tried=planned.tried)
    bounded = isinstance(sampling, Adaptive) and wanted.by in ("q_eoi", "q_avg", "time") and len(allowed) > 1
    prospects = _prospects(cell, allowed) if bounded else [Prospect(scene, 1.0, 1.0) for scene in allowed]
    studies = list(_studied(cell, prospects, sampling, wanted.by, prune=bounded))
    ranked = rank([study.assessment("") for study in studies], wanted.by)
    chosen = next(study for study in studies if study.candidate is ranked[0].assessment.candidate)
    return BestWay(chosen, WaysFound(tried=planned.tried, feasible=len(allowed), pareto=_optimal(ranked)))


@dataclass(frozen=True, eq=False)
class _Planned:
    """The ways that were tried, and those that can be done, or why none can."""

    tried: int
    scenes: Sequence[Rehearsal] | Infeasible


def _fastest(cell: Cell, candidate: Candidate, world: World) -> _Planned:
    """The fastest way of a candidate, planned, with its first grip."""
    way = first_grip(candidate)
    motion = plan_motion(skill_use(cell, way, world), cell.collision, cell.seed)
    return _Planned(1, motion if isinstance(motion, Infeasible) else [rehearsal(cell, way, world, motion)])


def _planned(cell: Cell, candidate: Candidate, world: World) -> _Planned:
    """Every way of a candidate, planned."""
    tried, scenes = 0, []
    reasons: list[tuple[str, ...]] = []
    for grip in grips(cell, candidate, world):
        branches = plan_branches(skill_use(cell, grip, world), cell.collision, cell.seed)
        if isinstance(branches, Infeasible):
            tried, reasons = tried + 1, [*reasons, branches.reasons]
            continue
        tried, reasons = tried + branches.tried, [*reasons, branches.reasons]
        ways = ((replace(grip, branch=found.branch), found.motion) for found in branches.feasible)
        scenes += [rehearsal(cell, way, world, motion) for way, motion in ways]
    return _Planned(tried, scenes or Infeasible(reasons[0]))


def _prospects(cell: Cell, scenes: Sequence[Rehearsal]) -> list[Prospect]:
    """The ways with the most that they may be worth."""
    looks = [Look(scene.stage, scene.targets, _instants(scene)) for scene in scenes]
    found = look_at(cell.observer, looks)
    return [_prospect(scene, look, seen) for scene, look, seen in zip(scenes, looks, found, strict=True)]


def _instants(scene: Rehearsal) -> Samples:
    """A few instants of every primitive action."""
    actions = zip(scene.candidate.skill.primitives, scene.motion.primitives, strict=True)
    instants: list[Array] = [
        np.linspace(p.start, p.end, LOOKS_AT_MOVE if isinstance(action, JointMove) else LOOKS_AT_OTHERS)
        for action, p in actions
    ]
    return within_pieces(scene.stage.pieces, instants)


def _prospect(scene: Rehearsal, look: Look, seen: Observation) -> Prospect:
    timeline = Timeline(
        pieces=scene.stage.pieces,
        samples=look.samples,
        atoms=tuple(target.atom for target in scene.targets),
        observation=seen,
        faults={},
        T=scene.T,
        T_eoi=scene.T_eoi,
    )
    perhaps = np.where(timeline.covered[1:] | timeline.covered[:-1], np.nan_to_num(timeline.steps), 0.0)

    def at_most(seconds: float, of: float) -> float:
        return compared_quality(min(1.0, seconds / of + UNSEEN_EVENTS) if of > 0 else None)

    return Prospect(
        scene,
        q_avg=at_most(float(perhaps.sum()), scene.T),
        q_eoi=at_most(float(perhaps[timeline.interesting[:-1]].sum()), scene.T_eoi),
    )


def _studied(
    cell: Cell, prospects: Sequence[Prospect], sampling: Sampling, by: Criterion, *, prune: bool
) -> Iterator[Study]:
    """The exact studies of the ways that may be best, the most promising first."""
    found: list[Assessment] = []
    for prospect in sorted(prospects, key=lambda prospect: _promise(prospect, by)):
        if not (prune and any(map(prospect.is_beaten_by, found))):
            study = observed(cell, prospect.scene, sampling, full=False)
            found.append(study.assessment(""))
            yield study


def _promise(prospect: Prospect, by: Criterion) -> tuple[float, ...]:
    """A key that puts the most promising way first."""
    best = {"q_avg": -prospect.q_avg, "q_eoi": -prospect.q_eoi, "time": prospect.time}.get(by, 0.0)
    return best, -prospect.q_avg, prospect.time


def _optimal(ranked: Iterable[Ranked]) -> tuple[WayFigures, ...]:
    """The figures of the first way, and of all that are Pareto-optimal."""
    return tuple(
        WayFigures(
            parameters=way.candidate.parameters,
            time=float(way.time or 0.0),
            q_avg=way.q_avg,
            q_eoi=way.q_eoi,
            delay_worst=way.delay_worst,
        )
        for way, place, pareto in ((one.assessment, one.rank, one.pareto) for one in ranked)
        if pareto or place == 1
    )
