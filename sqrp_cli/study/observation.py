"""The coverage of targets in samples of a motion: of every camera with causes, or only as much as figures need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.kernel.kernel import BoxVerdicts, Loss
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.stage import Samples, Stage


@dataclass(frozen=True, eq=False)
class Observation:
    """Coverage of `a` targets in m samples."""

    looked: Mask
    """Whether nothing is inferred from neighbouring samples, shape (m,)."""
    required: Mask
    """Whether a state holds the target's atom, shape (m, a)."""
    known: Mask
    """Where the target is required and was observed, or its neighbouring samples agree, shape (m, a)."""
    covered: Mask
    """Whether enough cameras see the target, False where not known, shape (m, a)."""
    response: Array
    """Response of the cameras that cover it, NaN where uncovered, shape (m, a) [s]."""
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
        covered, response = self.covered, self.response
        both = self.known[first] & self.known[second]
        seen = both & covered[first] & covered[second] & (response[first] == response[second])
        known = seen | (both & ~covered[first] & ~covered[second])
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


def look_at(
    observer: Observer,
    stage: Stage,
    targets: Sequence[Target],
    samples: Samples,
    known: Observation | None = None,
    bars: Array | None = None,
    q: Array | None = None,
) -> Observation:
    """Whether enough cameras see each target in samples of a motion, where it is required.

    known: what is known of the samples already, and not asked again. bars: see `observe`. q: see `Stage.states`.
    """
    required = stage.requires(targets, samples)
    nothing = np.zeros(required.shape, dtype=bool)
    found = Observation(
        looked=np.ones(len(samples), dtype=bool) if known is None else known.looked,
        required=required,
        known=required if known is None else known.known | required,
        covered=nothing if known is None else known.covered.copy(),
        response=np.full(required.shape, np.nan) if known is None else known.response.copy(),
        matrix=None,
    )
    rows = [np.flatnonzero(asked) for asked in (required if known is None else required & ~known.known).T]
    if any(map(len, rows)):
        before = np.append(0.0, samples.gaps)  # the time from the sample before each
        loss = None if bars is None else Loss(np.stack([before, before * stage.of_interest(samples)], axis=1), bars)
        seen = observer.coverage(targets, stage.states(samples, q), rows, loss)
        for column, (at, of_target) in enumerate(zip(rows, seen, strict=True)):
            found.covered[at, column], found.response[at, column] = ~np.isnan(of_target), of_target
    return found


def look_closely(observer: Observer, stage: Stage, targets: Sequence[Target], samples: Samples) -> Observation:
    """The verdicts of every camera on every target in samples of a motion, with causes."""
    matrix = observer.verdicts(targets, stage.states(samples))
    responses = np.array([camera.response for camera in observer.cameras])
    return observation_of(matrix, responses, targets, stage.requires(targets, samples))


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
