"""The coverage of targets in samples of a motion: of every camera with causes, or only as much as figures need.

Many motions of one cell are looked at in one batch. What a look finds of one does not depend on the others: each asks
for its targets in rounds; all ask at once, and the observer answers all questions of a round together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise, starmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.knowledge.frames import FrameName
from sqrp_cli.programming.coverage.stage import Samples, Stage, states_of
from sqrp_cli.programming.sensing.observer import BoxVerdicts, CoveredStates, Observer, sees_all
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import Target


@dataclass(frozen=True, eq=False)
class Observation:
    """Coverage of `a` targets in m samples."""

    looked: Mask
    """Whether nothing is inferred from neighbouring samples, shape (m,)."""
    required: Mask
    """Whether a state holds the target's atom, shape (m, a)."""
    known: Mask
    """Where the target is required and was observed, or its neighbouring samples agree, shape (m, a).

    If only coverage is requested, another atom may already decide a state.
    """
    covered: Mask
    """Whether enough cameras see the target, False where not known, shape (m, a)."""
    response: Array
    """Response of the cameras that cover it, NaN where uncovered, shape (m, a) [s]."""
    matrix: tuple[tuple[BoxVerdicts, ...], ...] | None
    """Per target and box the verdicts of every camera; None if only coverage was requested."""

    @cached_property
    def monitored(self) -> Mask:
        """Whether a state holds any literal, shape (m,)."""
        monitored: Mask = np.any(self.required, axis=1)
        return monitored

    @cached_property
    def states_covered(self) -> Mask:
        """Whether a state holds literals and all of them are covered, shape (m,)."""
        covered: Mask = self.monitored & np.all(self.covered | ~self.required, axis=1)
        return covered

    @property
    def full_matrix(self) -> tuple[tuple[BoxVerdicts, ...], ...]:
        """The matrix. Raises ValueError if only coverage was requested."""
        if self.matrix is None:
            raise ValueError("the causes were not looked up")
        return self.matrix

    @classmethod
    def unknown(cls, required: Mask) -> Observation:
        """An observation without results, of samples that require targets, shape (m, a)."""
        nothing = np.zeros(required.shape, dtype=bool)
        return cls(
            looked=np.ones(len(required), dtype=bool),
            required=required,
            known=nothing,
            covered=nothing,
            response=np.full(required.shape, np.nan),
            matrix=None,
        )

    def agreed(self, first: Indices, second: Indices) -> Observation:
        """The results common to the samples `first` and `second`, by index, without a matrix."""
        covered, response = self.covered, self.response
        both = self.known[first] & self.known[second]
        seen = both & covered[first] & covered[second] & (response[first] == response[second])
        unseen = both & ~covered[first] & ~covered[second]
        known = seen | unseen
        return Observation(
            looked=~known.any(axis=1),
            required=self.required[first] & self.required[second],
            known=known,
            covered=seen,
            response=np.where(seen, response[first], np.nan),
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


def full_observation(observer: Observer, look: Look) -> Observation:
    """The verdicts of every camera on every target of a look, whatever is known already."""
    responses = np.array([camera.response for camera in observer.cameras])
    matrix = observer.verdicts(look.targets, look.stage.states(look.samples))
    return observation_of(matrix, responses, look.targets, look.stage.requires(look.targets, look.samples))


def observation_of(
    matrix: tuple[tuple[BoxVerdicts, ...], ...], responses: Array, targets: Sequence[Target], required: Mask
) -> Observation:
    """What the verdicts of every camera on every target say; responses: of the cameras, shape (c,) [s]."""
    covered, response = np.zeros(required.shape, dtype=bool), np.full(required.shape, np.nan)
    for column, (target, boxes) in enumerate(zip(targets, matrix, strict=True)):
        sees = sees_all(boxes)
        covered[:, column] = required[:, column] & (sees.sum(axis=1) >= target.cameras)
        if target.cameras <= len(responses):
            kth = np.sort(np.where(sees, responses, np.inf), axis=1)[:, target.cameras - 1]
            response[:, column] = np.where(covered[:, column], kth, np.nan)
    return Observation(
        looked=np.ones(len(required), dtype=bool),
        required=required,
        known=required,
        covered=covered,
        response=response,
        matrix=matrix,
    )


_STATES_TOGETHER = 4000
"""States to look at together, to bound the memory."""


@dataclass(frozen=True, eq=False)
class Look:
    """Samples of a motion, and what must be seen in them."""

    stage: Stage
    targets: tuple[Target, ...]
    samples: Samples
    faults: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """The columns of the atoms of each fault, by its name: indices into `targets`.

    A target is left out where the state and every fault that needs it are already known uncovered.
    """
    known: Observation | None = None
    """What is known of the samples already; None if nothing is."""
    at_once: int = 1
    """How many targets to ask for in one round. With more, fewer are left out."""


def look_at(observer: Observer, looks: Sequence[Look]) -> tuple[Observation, ...]:
    """The coverage of motions in one cell, each as if it were the only one; much faster than one by one."""
    return tuple(observation for batch in _batches(looks) for observation in _look_at(observer, batch))


def _batches(looks: Sequence[Look]) -> Iterator[Sequence[Look]]:
    """The looks in order, as many at once as fit the memory."""
    batch = np.cumsum([len(look.samples) for look in looks]) // _STATES_TOGETHER
    edges = [0, *(np.flatnonzero(np.diff(batch)) + 1).tolist(), len(looks)]
    yield from (looks[start:end] for start, end in pairwise(edges) if start < end)


def _look_at(observer: Observer, looks: Sequence[Look]) -> Iterator[Observation]:
    states = states_of([look.stage for look in looks], [look.samples for look in looks])
    rows = list(starmap(slice, pairwise(np.cumsum([0, *(len(look.samples) for look in looks)]).tolist())))
    alike: dict[Hashable, dict[int, Target]] = defaultdict(dict)  # of each kind, the targets by index of their look
    kinds = [[_kind(target) for target in look.targets] for look in looks]
    for index, (look, of_look) in enumerate(zip(looks, kinds, strict=True)):
        for target, kind in zip(look.targets, of_look, strict=True):
            alike[kind][index] = target
    frames = dict(states.X_WF)
    as_one = {kind: _as_one(targets, rows, frames, states.count) for kind, targets in alike.items()}
    states = SceneStates(states.count, frames)
    rounds = list(map(_Rounds, looks))
    while asked := [(index, column, at) for index, one in enumerate(rounds) for column, at in one.questions().items()]:
        sought: dict[Hashable, list[Indices]] = defaultdict(list)
        for index, column, at in asked:
            sought[kinds[index][column]].append(at + rows[index].start)
        targets, in_rows = [as_one[kind] for kind in sought], [np.concatenate(parts) for parts in sought.values()]
        found = dict(zip(sought, observer.coverage(targets, states, in_rows), strict=True))
        shares = {kind: iter(found[kind].split([len(at) for at in parts])) for kind, parts in sought.items()}
        for index, column, at in asked:
            rounds[index].take(column, at, next(shares[kinds[index][column]]))
    return (one.observation for one in rounds)


class _Rounds:
    """The questions of one look, several targets at a time, and what is known so far."""

    def __init__(self, look: Look) -> None:
        required = look.stage.requires(look.targets, look.samples)
        known = Observation.unknown(required) if look.known is None else replace(look.known, required=required)
        covered, response = known.covered.copy(), known.response.copy()
        self.observation = replace(known, known=known.known.copy(), covered=covered, response=response)
        self._faults = {fault: set(columns) for fault, columns in look.faults.items()}
        lost = known.known & ~known.covered
        self._state_open = ~lost.any(axis=1)
        self._fault_open = {fault: ~lost[:, list(columns)].any(axis=1) for fault, columns in look.faults.items()}
        # Targets that stand still decide a state with the least work.
        order = sorted(range(len(look.targets)), key=lambda column: look.stage.moving_boxes(look.targets[column]))
        self._left = [order[start : start + look.at_once] for start in range(0, len(order), look.at_once)]

    def questions(self) -> dict[int, Indices]:
        """The next targets to ask for, by column, with the samples, by index; empty if nothing is open."""
        asked: dict[int, Indices] = {}
        while self._left and not asked:
            asked = {column: rows for column in self._left.pop(0) if len(rows := self._open(column))}
        return asked

    def _open(self, column: int) -> Indices:
        wanted = np.logical_or.reduce([self._state_open, *(self._fault_open[fault] for fault in self._with(column))])
        return np.flatnonzero(self.observation.required[:, column] & ~self.observation.known[:, column] & wanted)

    def _with(self, column: int) -> list[str]:
        """The faults that need a target."""
        return [fault for fault, columns in self._faults.items() if column in columns]

    def take(self, column: int, rows: Indices, found: CoveredStates) -> None:
        """Note whether a target is covered in samples."""
        seen = self.observation
        seen.known[rows, column] = True
        seen.covered[rows, column], seen.response[rows, column] = found.covered, found.response
        self._state_open &= seen.covered[:, column] | ~seen.required[:, column]
        for fault in self._with(column):
            self._fault_open[fault] &= seen.covered[:, column]


def _kind(target: Target) -> Hashable:
    """What targets have in common that are looked at together."""
    boxes = ((box.frame, box.size, box.normal, box.encloses, box.limits) for box in target.boxes)
    return target.atom, target.cameras, tuple(boxes)


def _as_one(targets: Mapping[int, Target], rows: Sequence[slice], frames: dict[str, Array], count: int) -> Target:
    """Targets of one kind as one target; adds a frame for each box that has several poses in its own.

    targets: by the index of their look. rows: the states of each look, of `count` in all. frames: see `SceneStates`.
    """
    first, boxes = next(iter(targets.values())), []
    for number, box in enumerate(first.boxes):
        poses = {index: target.boxes[number].X_FB for index, target in targets.items()}
        if not all(np.array_equal(X_FB, box.X_FB) for X_FB in poses.values()):
            X_FB = np.tile(box.X_FB, (count, 1, 1))
            for index, X in poses.items():
                X_FB[rows[index]] = X
            frame = FrameName(f"box {number} of {first.atom}")
            frames[frame] = frames[box.frame] @ X_FB
            box = replace(box, frame=frame, X_FB=np.eye(4))
        boxes.append(box)
    return replace(first, boxes=tuple(boxes))
