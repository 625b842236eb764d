"""The most that a way may be worth: a look at a few instants, and at more where what the cameras see changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.observation import Look, look_at
from sqrp_cli.programming.coverage.sampling import within_pieces
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.coverage.timeline import Rehearsal, Timeline
from sqrp_cli.programming.sensing.observer import Observer

LOOKS_AT_MOVE, LOOKS_AT_OTHERS = 17, 5
"""Instants at which a joint move, and any other primitive action, is looked at; both ends included."""

ROUNDS = 3
"""How often the time between two instants is halved if the state is covered at one of them only."""

UNSEEN_EVENTS = 0.02
"""By how much Q may exceed the most favourable figure of a look, which misses short events."""

WORTH_POINTS, WORTH_TIME = 0.02, 0.05
"""By how much a way must promise to be better in quality, or be faster, to be named beside another one."""


@dataclass(frozen=True, eq=False)
class Prospect:
    """A way that can be done, with the most that it may be worth."""

    scene: Rehearsal
    q_avg: float = 1.0
    q_eoi: float = 1.0
    """At most, in 0..1."""

    @property
    def time(self) -> float:
        """Duration of the whole motion [s]."""
        return self.scene.motion.time

    def is_worth_naming_beside(self, other: Assessment) -> bool:
        """Whether it is clearly faster than a way that was studied, or may be clearly better in quality."""
        better = (
            hoped - known >= WORTH_POINTS
            for known, hoped in ((other.q_avg, self.q_avg), (other.q_eoi, self.q_eoi))
            if known is not None
        )
        return self.time < (other.time or 0.0) * (1.0 - WORTH_TIME) or any(better)


def prospects(observer: Observer, scenes: Sequence[Rehearsal]) -> list[Prospect]:
    """The most that each of several ways of one candidate may be worth.

    What lies between two instants counts as seen if it is seen in one of them, and `UNSEEN_EVENTS` are added.
    """
    samples = [_instants(scene) for scene in scenes]
    found = look_at(observer, [Look(s.stage, s.targets, at) for s, at in zip(scenes, samples, strict=True)])
    timelines = [Timeline.of(scene, at, seen) for scene, at, seen in zip(scenes, samples, found, strict=True)]
    for _ in range(ROUNDS):
        timelines = _finer(observer, scenes, timelines)
    return [_prospect(scene, timeline) for scene, timeline in zip(scenes, timelines, strict=True)]


def _instants(scene: Rehearsal) -> Samples:
    """A few instants of every primitive action."""
    actions = zip(scene.candidate.skill.primitives, scene.motion.primitives, strict=True)
    instants: list[Array] = [
        np.linspace(p.start, p.end, LOOKS_AT_MOVE if isinstance(action, JointMove) else LOOKS_AT_OTHERS)
        for action, p in actions
    ]
    return within_pieces(scene.stage.pieces, instants)


def _finer(observer: Observer, scenes: Sequence[Rehearsal], timelines: Sequence[Timeline]) -> list[Timeline]:
    """The timelines with a look at the middle between two instants where only one is covered."""
    between = [_middles(timeline) for timeline in timelines]
    found = look_at(observer, [Look(s.stage, s.targets, at) for s, at in zip(scenes, between, strict=True)])
    finer: list[Timeline] = []
    for timeline, at, seen in zip(timelines, between, found, strict=True):
        finer.append(timeline.joined(at, seen))
    return finer


def _middles(timeline: Timeline) -> Samples:
    rows = np.flatnonzero((timeline.covered[1:] != timeline.covered[:-1]) & ~np.isnan(timeline.steps))
    t = timeline.samples.t
    return Samples(timeline.samples.piece[rows], 0.5 * (t[rows] + t[rows + 1]))


def _prospect(scene: Rehearsal, timeline: Timeline) -> Prospect:
    perhaps = np.where(timeline.covered[1:] | timeline.covered[:-1], np.nan_to_num(timeline.steps), 0.0)

    def at_most(seconds: float, of: float) -> float:
        return min(1.0, seconds / of + UNSEEN_EVENTS) if of > 0 else 1.0

    return Prospect(
        scene,
        q_avg=at_most(float(perhaps.sum()), scene.T),
        q_eoi=at_most(float(perhaps[timeline.interesting[:-1]].sum()), scene.T_eoi),
    )
