"""A candidate's motion with what must be seen during it, and its coverage: sampled, and bisected where it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, Indices, Mask, ranges
from sqrp_cli.logic.formula_time import GroundOperator
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.observation import Observation, look_at, look_closely
from sqrp_cli.study.sampling import Adaptive, Sampling, first_samples
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.task.candidate import Candidate
from sqrp_cli.task.pieces import Piece

SHORTEST_BRACKET = 1e-7
"""Transitions are not bisected further than this [s]."""

_SHARE = 0.1
"""Of the error that may remain, so much is left: qualities are compared rounded to the default, and ways that see the
same must not differ by how their brackets lie."""

_ROUNDS = range(1, 9)
"""Most rounds of narrowing a bracket."""

_LOOK = 100
"""Fixed cost of one observation, in samples."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """The coverage of a candidate over its motion, at m samples."""

    pieces: tuple[Piece, ...]
    """Of the motion, in order."""
    moving: Mask
    """Whether something moves in each piece, shape (pieces,)."""
    samples: Samples
    """The samples."""
    atoms: tuple[Atom, ...]
    """In the order of the columns of `observation`."""
    observation: Observation
    """What the cameras see in them."""
    faults: Mapping[str, tuple[int, ...]]
    """The columns of the atoms of each fault, by its name."""
    T: float
    """Duration of the union of all formulas' intervals, see `pieces.monitored_times` [s]."""
    T_eoi: float
    """Duration of the union of the events of interest, see `pieces.monitored_times` [s]."""

    @classmethod
    def of(cls, request: ObservationRequest, samples: Samples, observation: Observation) -> Timeline:
        """What was seen in samples of a motion."""
        return cls(
            pieces=request.stage.pieces,
            moving=request.stage.moving_pieces,
            samples=samples,
            atoms=tuple(target.atom for target in request.targets),
            observation=observation,
            faults=request.faults,
            T=request.T,
            T_eoi=request.T_eoi,
        )

    @property
    def monitored(self) -> Mask:
        """Whether a state holds any literal, shape (m,)."""
        return self.observation.monitored

    @property
    def covered(self) -> Mask:
        """Whether a state holds literals and all of them are covered, shape (m,)."""
        return self.observation.states_covered

    def fault_covered(self, fault: str) -> Mask:
        """Whether all literals of a fault are required and covered, shape (m,)."""
        covered: Mask = np.all(self.observation.covered[:, list(self.faults[fault])], axis=1)
        return covered

    @cached_property
    def steps(self) -> Array:
        """Time from each sample to the next within its piece [s], NaN at the end of a piece, shape (m - 1,)."""
        return np.where(np.diff(self.samples.piece) == 0, np.diff(self.samples.t), np.nan)

    @cached_property
    def interesting(self) -> Mask:
        """Whether each sample lies in an event of interest, shape (m,)."""
        return np.array([piece.of_interest for piece in self.pieces])[self.samples.piece]

    @property
    def surely_lost(self) -> Array:
        """How long no bisection can find all covered, and how long of that is of interest, shape (2,) [s].

        Where a target is seen in neither of two neighbouring samples, it is not looked for between them.
        """
        lost = self.observation.required & ~self.observation.covered
        steps = np.where((lost[:-1] & lost[1:]).any(axis=1), np.nan_to_num(self.steps), 0.0)
        return np.array([steps.sum(), steps[self.interesting[:-1]].sum()])

    @property
    def largest_gap(self) -> float:
        """Longest time between neighbouring samples that hold literals and were observed, where something moves [s].

        Shorter events may be missed. Where nothing moves, there are none.
        """
        rows = np.flatnonzero(self.monitored & self.observation.looked & self.moving[self.samples.piece])
        steps = np.diff(self.samples.t[rows])[np.diff(self.samples.piece[rows]) == 0]
        return float(steps.max(initial=0.0))

    @property
    def transition_error(self) -> float:
        """Bound on the error of Q from the unknown times of transitions between samples, as a fraction."""
        width = np.where(self.covered[1:] != self.covered[:-1], np.nan_to_num(self.steps), 0.0)
        inside = width[self.interesting[:-1]].sum()
        return max(float(width.sum() / self.T) if self.T else 0.0, float(inside / self.T_eoi) if self.T_eoi else 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservationRequest:
    """A motion, and what must be seen during it."""

    stage: Stage
    targets: tuple[Target, ...]
    faults: Mapping[str, tuple[int, ...]]
    """The columns of the atoms of each fault, by its name: indices into `targets`."""
    T: float
    """See `Timeline` [s]."""
    T_eoi: float
    """See `Timeline` [s]."""

    def for_targets(self, stage: Stage, targets: Sequence[Target]) -> ObservationRequest:
        """The same of other targets on another stage: each of their changes is located, whatever else is seen.

        So each is a fault of its own.
        """
        faults = {f"{column}": (column,) for column in range(len(targets))}
        return ObservationRequest(stage=stage, targets=tuple(targets), faults=faults, T=self.T, T_eoi=self.T_eoi)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannedMotion(ObservationRequest):
    """A feasible candidate with its motion, and what must be seen during it."""

    candidate: Candidate
    world: World
    """That it starts from."""
    motion: Motion
    formulas: tuple[GroundOperator, ...]


@dataclass(frozen=True, eq=False)
class SampledScene:
    """A planned motion at m samples, where all cameras look."""

    scene: PlannedMotion
    samples: Samples

    @cached_property
    def states(self) -> SceneStates:
        """Where everything is in the samples."""
        return self.scene.stage.states(self.samples)

    @cached_property
    def required(self) -> Mask:
        """Whether a state holds the atom of each target, shape (m, targets)."""
        return self.scene.stage.requires(self.scene.targets, self.samples)


def observe(
    request: ObservationRequest,
    observer: Observer,
    sampling: Sampling,
    *,
    full: bool,
    bars: Array | None = None,
) -> Timeline:
    """Sample a motion and, if the sampling is adaptive, bisect every transition of the coverage.

    full: give the verdicts of every camera with causes, and bisect the transitions of each camera as well. bars: times
    [s], shape (b, 2); where as much as in a row is surely lost, of all and of the events of interest, no more is looked
    at, and what was not looked at counts as lost.
    """
    stage, targets = request.stage, request.targets
    samples = first_samples(sampling, stage, observer, targets)
    if full:
        seen = look_closely(observer, stage, targets, samples)
    else:
        seen = look_at(observer, stage, targets, samples, bars=bars)
    timeline = Timeline.of(request, samples, seen)
    while isinstance(sampling, Adaptive) and (bars is None or not (timeline.surely_lost >= bars).all(axis=1).any()):
        if (finer := _finer(timeline, sampling.tolerance)) is None:
            break
        samples, seen, (more_samples, bracket) = timeline.samples, timeline.observation, finer
        if full:
            more = look_closely(observer, stage, targets, more_samples)
        else:
            more = look_at(observer, stage, targets, more_samples, seen.agreed(bracket, bracket + 1))
        order = samples.merge_order(more_samples)
        timeline = replace(timeline, samples=samples.joined(more_samples, order), observation=seen.joined(more, order))
    return timeline


def _finer(timeline: Timeline, tolerance: float) -> tuple[Samples, Indices] | None:
    """Samples that cut every bracket around a transition that is still too wide; None if none is.

    The second are the indices of the timeline's samples before each.

    The brackets around changes of the state's coverage share `_SHARE` of the allowed error of Q_avg, and those in
    events of interest that of Q_eoi. A change of a fault's coverage, on which a delay depends, is found as exactly as a
    single change in events of interest; one of a camera's, in the full matrix, to the allowed error of Q_avg. Each is
    cut into equal parts, in the number of rounds with the least total cost: many parts at once, or few repeatedly.
    """
    t, piece, steps = timeline.samples.t, timeline.samples.piece, np.nan_to_num(timeline.steps)
    # How wide the bracket from each sample to the next may be [s], shape (m - 1,); infinite where nothing changes.
    apart = ~np.isnan(timeline.steps)
    state = (timeline.covered[1:] != timeline.covered[:-1]) & apart
    interesting = state & timeline.interesting[:-1]
    error, error_eoi = tolerance * timeline.T, _SHARE * tolerance * (timeline.T_eoi or timeline.T)
    allowed = np.where(state, _SHARE * error / max(1, int(state.sum())), np.inf)
    allowed[interesting] = np.minimum(allowed[interesting], error_eoi / max(1, int(interesting.sum())))
    for covered in map(timeline.fault_covered, timeline.faults):
        changes = (covered[1:] != covered[:-1]) & apart
        allowed[changes] = np.minimum(allowed[changes], error_eoi)
    if timeline.observation.matrix:
        cameras = np.concatenate([sees_all(boxes) for boxes in timeline.observation.matrix], axis=1)
        changes = (cameras[1:] != cameras[:-1]).any(axis=1) & apart
        allowed[changes] = np.minimum(allowed[changes], error)
    ratio = steps / np.maximum(allowed, SHORTEST_BRACKET)
    rows = np.flatnonzero(ratio > 1 + 1e-9)
    if not len(rows):
        return None
    ways = [(rounds, np.ceil(ratio[rows] ** (1 / rounds) - 1e-9).astype(np.int64).clip(2)) for rounds in _ROUNDS]
    _, parts = min(ways, key=lambda way: way[0] * (_LOOK + int(way[1].sum())))
    bracket, part = ranges(np.ones(len(rows)), parts)
    row = rows[bracket]
    return Samples(piece[row], t[row] + (steps[rows] / parts)[bracket] * part), row
