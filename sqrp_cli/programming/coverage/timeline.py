"""The coverage of a candidate over time: sampled, and bisected where it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Mask, ranges
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.coverage.sampling import Adaptive, Sampling, first_samples
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.pieces import Piece
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts, Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import Target

Scalar = TypeVar("Scalar", bound=np.generic)

SHORTEST_BRACKET = 1e-7
"""Transitions are not bisected further than this [s]."""

_ROUNDS = range(1, 9)
"""In how many rounds a bracket may be made narrow enough."""

_LOOK = 100
"""What a look costs apart from its samples, in samples."""

_TOGETHER = 1000
"""Targets that are looked at together, each counted in every sample: so few that the calls cost the most."""


@dataclass(frozen=True, eq=False)
class Observation:
    """What the cameras see of `a` targets in m samples.

    looked: whether nothing is taken over from the samples around it, shape (m,). required: whether a state holds the
    target's atom, shape (m, a). known: where it is required and was asked for, shape (m, a), or the samples around it
    agree: where only coverage is asked, another atom may already have decided. covered: shape (m, a), False where not
    known. response: of the cameras that cover it [s], NaN where uncovered, shape (m, a).
    matrix: per target and box the verdicts of every camera; None where only coverage was asked.
    """

    looked: Mask
    required: Mask
    known: Mask
    covered: Mask
    response: Array
    matrix: tuple[tuple[BoxVerdicts, ...], ...] | None

    @property
    def full_matrix(self) -> tuple[tuple[BoxVerdicts, ...], ...]:
        """The matrix. Raises ValueError where only coverage was asked."""
        if self.matrix is None:
            raise ValueError("the causes were not looked up")
        return self.matrix

    @classmethod
    def unknown(cls, required: Mask) -> Observation:
        """Nothing yet of samples that require targets, shape (m, a)."""
        nothing = np.zeros(required.shape, dtype=bool)
        looked = np.ones(len(required), dtype=bool)
        return cls(looked, required, nothing, nothing, np.full(required.shape, np.nan), None)

    def agreed(self, first: NDArray[np.int64], second: NDArray[np.int64]) -> Observation:
        """What the samples `first` and `second`, by index, agree about, without a matrix."""
        covered, response = self.covered, self.response
        both = self.known[first] & self.known[second]
        seen = both & covered[first] & covered[second] & (response[first] == response[second])
        unseen = both & ~covered[first] & ~covered[second]
        required, known = self.required[first] & self.required[second], seen | unseen
        return Observation(~known.any(axis=1), required, known, seen, np.where(seen, response[first], np.nan), None)

    def joined(self, other: Observation, order: NDArray[np.int64]) -> Observation:
        """The rows of both in the given order."""

        def join(first: NDArray[Scalar], second: NDArray[Scalar]) -> NDArray[Scalar]:
            return np.concatenate([first, second])[order]

        matrix = None
        if self.matrix is not None and other.matrix is not None:
            matrix = tuple(
                tuple(
                    BoxVerdicts(
                        join(a.cause, b.cause), join(a.by, b.by), join(a.figure, b.figure), join(a.visible, b.visible)
                    )
                    for a, b in zip(boxes, others, strict=True)
                )
                for boxes, others in zip(self.matrix, other.matrix, strict=True)
            )
        return Observation(
            join(self.looked, other.looked),
            join(self.required, other.required),
            join(self.known, other.known),
            join(self.covered, other.covered),
            join(self.response, other.response),
            matrix,
        )


@dataclass(frozen=True, eq=False)
class Timeline:
    """The coverage of a candidate over its motion.

    atoms: in the order of the columns of `observation`. T, T_eoi: see `pieces.monitored_time` and `interesting_time`
    [s].
    faults: the columns of the atoms of each fault.
    """

    pieces: tuple[Piece, ...]
    samples: Samples
    atoms: tuple[Atom, ...]
    observation: Observation
    faults: Mapping[str, tuple[int, ...]]
    T: float
    T_eoi: float

    @cached_property
    def monitored(self) -> Mask:
        """Whether a state holds any literal, shape (m,)."""
        monitored: Mask = np.any(self.observation.required, axis=1)
        return monitored

    @cached_property
    def covered(self) -> Mask:
        """Whether a state holds literals and all of them are covered, shape (m,)."""
        covered: Mask = self.monitored & np.all(self.observation.covered | ~self.observation.required, axis=1)
        return covered

    def fault_covered(self, fault: str) -> Mask:
        """Whether all literals of a fault are required and covered, shape (m,)."""
        covered: Mask = np.all(self.observation.covered[:, list(self.faults[fault])], axis=1)
        return covered

    def fault_response(self, fault: str) -> Array:
        """Time from a fault until images show it [s], NaN where it is not covered, shape (m,)."""
        response: Array = self.observation.response[:, list(self.faults[fault])].max(axis=1)
        return np.where(self.fault_covered(fault), response, np.nan)

    @cached_property
    def steps(self) -> Array:
        """Time from each sample to the next within its piece [s], NaN at the end of a piece, shape (m - 1,)."""
        return np.where(np.diff(self.samples.piece) == 0, np.diff(self.samples.t), np.nan)

    @cached_property
    def interesting(self) -> Mask:
        """Whether each sample lies in an event of interest, shape (m,)."""
        return np.array([piece.of_interest for piece in self.pieces])[self.samples.piece]

    @property
    def largest_gap(self) -> float:
        """Longest time between neighbouring samples that hold literals and were looked at [s].

        Shorter events may be missed.
        """
        rows = np.flatnonzero(self.monitored & self.observation.looked)
        steps = np.diff(self.samples.t[rows])[np.diff(self.samples.piece[rows]) == 0]
        return float(steps.max(initial=0.0))

    @property
    def transition_error(self) -> float:
        """Bound on the error of Q from not knowing when between two samples the coverage changed, as a fraction."""
        width = np.where(self.covered[1:] != self.covered[:-1], np.nan_to_num(self.steps), 0.0)
        inside = width[self.interesting[:-1]].sum()
        return max(float(width.sum() / self.T) if self.T else 0.0, float(inside / self.T_eoi) if self.T_eoi else 0.0)


def observe(
    stage: Stage,
    observer: Observer,
    targets: Sequence[Target],
    faults: Mapping[str, tuple[int, ...]],
    sampling: Sampling,
    times: tuple[float, float],
    *,
    full: bool,
) -> Timeline:
    """Sample a motion and, if the sampling is adaptive, bisect every transition of the coverage.

    faults: columns (indices into `targets`) of each fault's atoms. times: T and T_eoi [s].
    full: give the verdicts of every camera with causes, and bisect the transitions of each camera as well.
    """
    samples = first_samples(sampling, stage, observer, targets)
    observation = _look(stage, observer, targets, faults, samples, full=full)
    timeline = Timeline(
        stage.pieces, samples, tuple(target.atom for target in targets), observation, faults, times[0], times[1]
    )
    while isinstance(sampling, Adaptive) and (finer := _finer(timeline, sampling.tolerance)) is not None:
        added, begin = finer
        order = timeline.samples.merge_order(added)
        agreed = timeline.observation.agreed(begin, begin + 1)
        found = _look(stage, observer, targets, faults, added, agreed, full=full)
        observation = timeline.observation.joined(found, order)
        timeline = replace(timeline, samples=timeline.samples.joined(added, order), observation=observation)
    return timeline


def _finer(timeline: Timeline, tolerance: float) -> tuple[Samples, NDArray[np.int64]] | None:
    """Samples that cut every bracket around a transition that is still too wide; None when none is.

    With the sample at which the bracket of each begins, by index.

    Each is cut into equal parts, in as many rounds as cost least in all: many parts at once, or few again and again.
    """
    t, piece, steps = timeline.samples.t, timeline.samples.piece, np.nan_to_num(timeline.steps)
    ratio = steps / _allowed_widths(timeline, tolerance)
    rows = np.flatnonzero(ratio > 1 + 1e-9)
    if not len(rows):
        return None
    ways = [(rounds, np.ceil(ratio[rows] ** (1 / rounds) - 1e-9).astype(np.int64).clip(2)) for rounds in _ROUNDS]
    _, parts = min(ways, key=lambda way: way[0] * (_LOOK + int(way[1].sum())))
    bracket, part = ranges(np.ones(len(rows)), parts)
    row = rows[bracket]
    return Samples(piece[row], t[row] + (steps[rows] / parts)[bracket] * part), row


def _allowed_widths(timeline: Timeline, tolerance: float) -> Array:
    """How wide the bracket from each sample to the next may be [s], shape (m - 1,); infinite where nothing changes.

    The brackets around changes of the state's coverage share what error Q_avg may have, and those in events of interest
    what Q_eoi may have. A change of a fault's coverage, on which a delay depends, is found as exactly as an only change
    in events of interest would be; one of a camera's, in the full matrix, as an only change at any time.
    """
    apart = ~np.isnan(timeline.steps)
    state = (timeline.covered[1:] != timeline.covered[:-1]) & apart
    interesting = state & timeline.interesting[:-1]
    error, error_eoi = tolerance * timeline.T, tolerance * (timeline.T_eoi or timeline.T)
    allowed = np.where(state, error / max(1, int(state.sum())), np.inf)
    allowed[interesting] = np.minimum(allowed[interesting], error_eoi / max(1, int(interesting.sum())))
    for covered in map(timeline.fault_covered, timeline.faults):
        changes = (covered[1:] != covered[:-1]) & apart
        allowed[changes] = np.minimum(allowed[changes], error_eoi)
    if timeline.observation.matrix:
        cameras = np.concatenate(
            [np.all([box.cause == Cause.NONE for box in boxes], axis=0) for boxes in timeline.observation.matrix],
            axis=1,
        )
        changes = (cameras[1:] != cameras[:-1]).any(axis=1) & apart
        allowed[changes] = np.minimum(allowed[changes], error)
    return np.maximum(allowed, SHORTEST_BRACKET)


def _look(
    stage: Stage,
    observer: Observer,
    targets: Sequence[Target],
    faults: Mapping[str, tuple[int, ...]],
    samples: Samples,
    agreed: Observation | None = None,
    *,
    full: bool,
) -> Observation:
    """What is seen in the samples; agreed: what those agree about between which each lies."""
    atoms = [{literal.atom for literal in piece.literals} for piece in stage.pieces]
    held = np.array([[target.atom in of_piece for target in targets] for of_piece in atoms], dtype=bool)
    required = held[samples.piece]
    states = stage.states(samples)
    if full:
        return _full_look(observer, targets, states, required)
    return _quick_look(observer, targets, faults, states, required, agreed or Observation.unknown(required))


def _full_look(observer: Observer, targets: Sequence[Target], states: SceneStates, required: Mask) -> Observation:
    matrix = observer.verdicts(targets, states)
    responses = np.array([camera.response for camera in observer.cameras])
    covered, response = np.zeros(required.shape, dtype=bool), np.full(required.shape, np.nan)
    for column, (target, boxes) in enumerate(zip(targets, matrix, strict=True)):
        sees = np.all([box.cause == Cause.NONE for box in boxes], axis=0)
        covered[:, column] = required[:, column] & (sees.sum(axis=1) >= target.cameras)
        if target.cameras <= len(responses):
            kth = np.sort(np.where(sees, responses, np.inf), axis=1)[:, target.cameras - 1]
            response[:, column] = np.where(covered[:, column], kth, np.nan)
    return Observation(np.ones(len(required), dtype=bool), required, required, covered, response, matrix)


def _quick_look(
    observer: Observer,
    targets: Sequence[Target],
    faults: Mapping[str, tuple[int, ...]],
    states: SceneStates,
    required: Mask,
    agreed: Observation,
) -> Observation:
    """Coverage only.

    A target is not looked at where the state and every fault that needs it are already known uncovered, nor between
    samples that agree about it. Where there are few samples, several targets are looked at together all the same.
    """
    known, covered, response = agreed.known.copy(), agreed.covered.copy(), agreed.response.copy()
    lost = known & ~covered
    state_open = ~lost.any(axis=1)
    fault_open = {fault: ~lost[:, list(columns)].any(axis=1) for fault, columns in faults.items()}
    order = sorted(range(len(targets)), key=lambda index: _moving_boxes(targets[index], states))
    together = max(1, _TOGETHER // len(required))
    for columns in (order[start : start + together] for start in range(0, len(order), together)):
        rows = []
        for column in columns:
            wanted = np.logical_or.reduce([state_open, *(fault_open[fault] for fault in _faults_of(column, faults))])
            rows.append(np.flatnonzero(required[:, column] & ~known[:, column] & wanted))
        found = observer.coverage([targets[column] for column in columns], states, rows)
        for column, asked, coverage in zip(columns, rows, found, strict=True):
            known[asked, column] = True
            covered[asked, column], response[asked, column] = coverage.covered, coverage.response
            state_open &= covered[:, column] | ~required[:, column]
            for fault in _faults_of(column, faults):
                fault_open[fault] &= covered[:, column]
    return Observation(agreed.looked, required, known, covered, response, None)


def _faults_of(column: int, faults: Mapping[str, tuple[int, ...]]) -> list[str]:
    return [fault for fault, columns in faults.items() if column in columns]


def _moving_boxes(target: Target, states: SceneStates) -> int:
    return sum(len(states.X_WF[box.frame]) > 1 for box in target.boxes)
