"""A candidate's motion with what must be seen during it, and its coverage: sampled, and bisected where it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import bad_input
from sqrp_cli.figures import Qualities
from sqrp_cli.geometry import Array, Indices, Mask, ranges
from sqrp_cli.kernel.kernel import BoxVerdicts, Loss
from sqrp_cli.logic.formula_time import GroundOperator
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.sampling import MAX_SAMPLES, Adaptive, FixedCount, FixedStep, Sampling, first_samples
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.task.candidate import Candidate

SHORTEST_BRACKET = 1e-7  # Transitions are not bisected further than this [s]
_SHARE = 0.1
"""Of the error that may remain, so much is left: qualities are compared rounded to the default, and ways that see the
same must not differ by how their brackets lie."""

_ROUNDS = np.arange(1, 9)  # In how many rounds a bracket may be narrowed
_LOOK = 100  # Fixed cost of one observation, in samples


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannedMotion:
    """A feasible candidate with its motion, and what must be seen during it."""

    candidate: Candidate
    world: World  # That it starts from
    motion: Motion
    formulas: tuple[GroundOperator, ...]
    since: Mapping[str, float]
    """When a fault, by its name, may first happen if images cannot tell it yet: before its formula's interval [s]."""
    stage: Stage
    targets: tuple[Target, ...]
    faults: Mapping[str, tuple[int, ...]]  # The columns of the atoms of each fault, by its name: indices into `targets`
    T: float  # Duration of the union of all formulas' intervals, see `pieces.monitored_times` [s]
    T_eoi: float  # Duration of the union of the events of interest, see `pieces.monitored_times` [s]

    def for_targets(self, stage: Stage, targets: Sequence[Target]) -> PlannedMotion:
        """The same of other targets on another stage: each of their changes is located, whatever else is seen.

        So each is a fault of its own.
        """
        faults = {f"{column}": (column,) for column in range(len(targets))}
        return replace(self, stage=stage, targets=tuple(targets), faults=faults)


@dataclass(frozen=True, eq=False)
class Observation:
    """Coverage of `a` targets in m samples."""

    looked: Mask  # Whether nothing is inferred from neighbouring samples, shape (m,)
    required: Mask  # Whether a state holds the target's atom, shape (m, a)
    known: Mask  # Where the target is required and was observed, or its neighbouring samples agree, shape (m, a)
    covered: Mask  # Whether enough cameras see the target, False where not known, shape (m, a)
    matrix: tuple[tuple[BoxVerdicts, ...], ...] | None
    """Per target and box the verdicts of every camera; None if only coverage was requested."""

    @cached_property
    def uncovered(self) -> Mask:
        """Where the target is required and not covered, shape (m, a)."""
        return self.required & ~self.covered

    @cached_property
    def blind(self) -> Mask:
        """Whether a state holds a literal that is not covered, shape (m,)."""
        blind: Mask = np.any(self.uncovered, axis=1)
        return blind

    @property
    def full_matrix(self) -> tuple[tuple[BoxVerdicts, ...], ...]:
        """The matrix. Raises ValueError if only coverage was requested."""
        if self.matrix is None:
            raise ValueError("the causes were not looked up")
        return self.matrix

    def agreed(self, first: Indices, second: Indices) -> Observation:
        """The results common to the samples `first` and `second`, by index, without a matrix."""
        known = self.known[first] & self.known[second] & (self.covered[first] == self.covered[second])
        return Observation(
            looked=~known.any(axis=1),
            required=self.required[first] & self.required[second],
            known=known,
            covered=known & self.covered[first],
            matrix=None,
        )

    def joined(self, other: Observation, order: Indices) -> Observation:
        """The rows of both in the given order."""

        def join(one: Observation | BoxVerdicts, more: Observation | BoxVerdicts) -> dict[str, NDArray[Any]]:
            arrays = ((part.name, getattr(one, part.name)) for part in fields(one))
            pairs = ((name, rows, getattr(more, name)) for name, rows in arrays if isinstance(rows, np.ndarray))
            return {name: np.concatenate([rows, added])[order] for name, rows, added in pairs}

        matrix = None
        if self.matrix is not None and other.matrix is not None:
            matrix = tuple(
                tuple(BoxVerdicts(**join(box, more)) for box, more in zip(boxes, others, strict=True))
                for boxes, others in zip(self.matrix, other.matrix, strict=True)
            )
        return Observation(**join(self, other), matrix=matrix)


@dataclass(frozen=True, eq=False)
class Timeline:
    """What the cameras see of a motion, its coverage at m samples, but not yet how late faults are noticed."""

    planned: PlannedMotion
    samples: Samples
    observation: Observation  # What the cameras see in the samples

    @cached_property
    def monitored(self) -> Mask:
        """Whether a state holds any literal, shape (m,)."""
        monitored: Mask = np.any(self.observation.required, axis=1)
        return monitored

    @cached_property
    def covered(self) -> Mask:
        """Whether a state holds literals and all of them are covered, shape (m,)."""
        return self.monitored & ~self.observation.blind

    @cached_property
    def of_interest(self) -> Mask:
        """Whether each sample lies in an event of interest, shape (m,)."""
        return self.planned.stage.of_interest(self.samples)

    @cached_property
    def qualities(self) -> Qualities:
        """Q_avg: total length of the runs of covered states over T, in 0..1; Q_eoi: the same in the events of interest.

        A run is a maximal sequence of consecutive covered samples inside one stretch of formula time; its length is
        last minus first (paper, section on sensing quality computation). Samples that share an instant add no length,
        so the sum over runs is the sum over neighbouring covered samples. None where no formula, or no event, applies
        for any time.
        """
        gaps, within = self.samples.gaps, self.covered[:-1] & self.covered[1:]
        parts = ((gaps[within], self.planned.T), (gaps[within & self.of_interest[:-1]], self.planned.T_eoi))
        # Rounding may add a little.
        return Qualities(*(min(float(part.sum()), T) / T if T > 0 else None for part, T in parts))

    @property
    def largest_gap(self) -> float:
        """Longest time between neighbouring samples that hold literals and were observed, where something moves [s].

        Shorter events may be missed. Where nothing moves, there are none.
        """
        stage = self.planned.stage
        stands = [primitive.trajectory.stands for primitive in stage.motion.primitives]
        moving = np.array([not stands[piece.primitive] for piece in stage.pieces], dtype=bool)
        rows = np.flatnonzero(self.monitored & self.observation.looked & moving[self.samples.piece])
        gaps = np.diff(self.samples.t[rows])[np.diff(self.samples.piece[rows]) == 0]
        return float(gaps.max(initial=0.0))

    @property
    def transition_error(self) -> float:
        """Bound on the error of Q from the unknown times of transitions between samples, as a fraction."""
        width = np.where(self.covered[1:] != self.covered[:-1], self.samples.gaps, 0.0)
        within = width[self.of_interest[:-1]].sum()
        pairs = ((width.sum(), self.planned.T), (within, self.planned.T_eoi))
        return max(float(error / T) if T else 0.0 for error, T in pairs)


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A planned motion at m samples, where all cameras look."""

    planned: PlannedMotion
    samples: Samples

    @cached_property
    def states(self) -> SceneStates:
        """Where everything is in the samples."""
        return self.planned.stage.states(self.samples)

    @cached_property
    def required(self) -> Mask:
        """Whether a state holds the atom of each target, shape (m, targets)."""
        return self.planned.stage.requires(self.planned.targets, self.samples)


def look_at(
    observer: Observer,
    planned: PlannedMotion,
    samples: Samples,
    known: Observation | None = None,
    bars: Array | None = None,
    q: Array | None = None,
) -> Observation:
    """Whether enough cameras see each target in samples of a motion, where it is required.

    known: what is known of the samples already, and not asked again. bars: see `observe`. q: see `Stage.states`.
    """
    stage, required = planned.stage, planned.stage.requires(planned.targets, samples)
    nothing = np.zeros(required.shape, dtype=bool)
    found = Observation(
        looked=np.ones(len(samples), dtype=bool) if known is None else known.looked,
        required=required,
        known=required if known is None else known.known | required,
        covered=nothing if known is None else known.covered.copy(),
        matrix=None,
    )
    rows = [np.flatnonzero(asked) for asked in (required if known is None else required & ~known.known).T]
    if any(map(len, rows)):
        before = np.append(0.0, samples.gaps)  # the time from the sample before each
        loss = None if bars is None else Loss(np.stack([before, before * stage.of_interest(samples)], axis=1), bars)
        seen = observer.coverage(planned.targets, stage.states(samples, q), rows, loss)
        for column, (at, of_target) in enumerate(zip(rows, seen, strict=True)):
            found.covered[at, column] = of_target
    return found


def look_closely(observer: Observer, planned: PlannedMotion, samples: Samples) -> Observation:
    """The verdicts of every camera on every target in samples of a motion, with causes."""
    stage, targets = planned.stage, planned.targets
    return observation_of(observer.verdicts(targets, stage.states(samples)), targets, stage.requires(targets, samples))


def observation_of(
    matrix: tuple[tuple[BoxVerdicts, ...], ...], targets: Sequence[Target], required: Mask
) -> Observation:
    """What the verdicts of every camera on every target say."""
    covered = np.zeros(required.shape, dtype=bool)
    for column, (target, boxes) in enumerate(zip(targets, matrix, strict=True)):
        covered[:, column] = required[:, column] & (sees_all(boxes).sum(axis=1) >= target.cameras)
    return Observation(
        looked=np.ones(len(required), dtype=bool),
        required=required,
        known=required,
        covered=covered,
        matrix=matrix,
    )


def observe(
    planned: PlannedMotion, observer: Observer, sampling: Sampling, *, full: bool, bars: Array | None = None
) -> Timeline:
    """Sample a motion and, if the sampling is adaptive, bisect every transition of the coverage.

    full: give the verdicts of every camera with causes, and bisect the transitions of each camera as well.

    bars: what other motions lose, a row for each: for how long its state is not covered, in all and in the events of
    interest, shape (b, 2) [s]. Once this one surely loses as much as a row in both, it is not looked at any further,
    and what was not looked at counts as not covered.

    Raises InputError for a sampling with too many samples.
    """
    count = 0.0  # of the adaptive one, which bounds itself
    if isinstance(sampling, FixedCount):
        count = float(sampling.samples) * len(planned.motion.primitives)
    elif isinstance(sampling, FixedStep):
        count = planned.motion.time / sampling.dt
    if count > MAX_SAMPLES:
        name = planned.candidate.name
        message = f"this sampling asks for {count:,.0f} samples of `{name}`; the limit is {MAX_SAMPLES:,}"
        raise bad_input("too-many-samples", message, mend="leave it out: the default places samples where they matter")
    samples = first_samples(sampling, planned.stage, observer, planned.targets)
    seen = look_closely(observer, planned, samples) if full else look_at(observer, planned, samples, bars=bars)
    timeline = Timeline(planned, samples, seen)
    while isinstance(sampling, Adaptive):
        if bars is not None:
            # A target that is seen in neither of two neighbouring samples is not looked for between them: how long no
            # bisection can find all covered, and how long of that is of interest.
            gaps = np.where((seen.uncovered[:-1] & seen.uncovered[1:]).any(axis=1), samples.gaps, 0.0)
            if (np.array([gaps.sum(), gaps[timeline.of_interest[:-1]].sum()]) >= bars).all(axis=1).any():
                break
        if (finer := _finer(timeline, sampling.tolerance)) is None:
            break
        more_samples, bracket = finer
        if full:
            more = look_closely(observer, planned, more_samples)
        else:
            more = look_at(observer, planned, more_samples, seen.agreed(bracket, bracket + 1))
        samples, order = samples.joined(more_samples)
        seen = seen.joined(more, order)
        timeline = Timeline(planned, samples, seen)
    return timeline


def _finer(timeline: Timeline, tolerance: float) -> tuple[Samples, Indices] | None:
    """Samples that cut every bracket around a transition that is still too wide; None if none is.

    The second are the indices of the timeline's samples before each.

    The brackets around changes of the state's coverage share `_SHARE` of the allowed error of Q_avg, and those in
    events of interest that of Q_eoi. A change of a fault's coverage, on which a delay depends, is found as exactly as a
    single change in events of interest; one of a camera's, in the full matrix, to the allowed error of Q_avg. Each is
    cut into equal parts, in the number of rounds with the least total cost: many parts at once, or few repeatedly.
    """
    planned, t, piece, gaps = timeline.planned, timeline.samples.t, timeline.samples.piece, timeline.samples.gaps
    # How wide the bracket from each sample to the next may be [s], shape (m - 1,); infinite where nothing changes.
    apart = np.diff(piece) == 0
    state = (timeline.covered[1:] != timeline.covered[:-1]) & apart
    of_interest = state & timeline.of_interest[:-1]
    error, error_eoi = tolerance * planned.T, _SHARE * tolerance * (planned.T_eoi or planned.T)
    allowed = np.where(state, _SHARE * error / max(1, int(state.sum())), np.inf)
    allowed[of_interest] = np.minimum(allowed[of_interest], error_eoi / max(1, int(of_interest.sum())))
    for columns in planned.faults.values():
        covered: Mask = np.all(timeline.observation.covered[:, list(columns)], axis=1)
        changes = (covered[1:] != covered[:-1]) & apart
        allowed[changes] = np.minimum(allowed[changes], error_eoi)
    if timeline.observation.matrix:
        cameras = np.concatenate([sees_all(boxes) for boxes in timeline.observation.matrix], axis=1)
        changes = (cameras[1:] != cameras[:-1]).any(axis=1) & apart
        allowed[changes] = np.minimum(allowed[changes], error)
    ratio = gaps / np.maximum(allowed, SHORTEST_BRACKET)
    rows = np.flatnonzero(ratio > 1 + 1e-9)
    if not len(rows):
        return None
    choices = np.ceil(ratio[rows] ** (1 / _ROUNDS[:, None]) - 1e-9).astype(np.int64).clip(2)
    parts = choices[(_ROUNDS * (_LOOK + choices.sum(axis=1))).argmin()]
    bracket, part = ranges(np.ones(len(rows)), parts)
    row = rows[bracket]
    return Samples(piece[row], t[row] + (gaps[rows] / parts)[bracket] * part), row
