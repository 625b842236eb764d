"""The coverage of targets in samples of a motion: of every camera with causes, or only as much as figures need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.programming.sensing.observer import BoxVerdicts, Observer, sees_all
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import Target

Scalar = TypeVar("Scalar", bound=np.generic)


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

        def join(first: NDArray[Scalar], second: NDArray[Scalar]) -> NDArray[Scalar]:
            return np.concatenate([first, second])[order]

        matrix = None
        if self.matrix is not None and other.matrix is not None:
            matrix = tuple(
                tuple(
                    BoxVerdicts(
                        cause=join(box.cause, more.cause),
                        by=join(box.by, more.by),
                        figure=join(box.figure, more.figure),
                        visible=join(box.visible, more.visible),
                    )
                    for box, more in zip(boxes, others, strict=True)
                )
                for boxes, others in zip(self.matrix, other.matrix, strict=True)
            )
        return Observation(
            looked=join(self.looked, other.looked),
            required=join(self.required, other.required),
            known=join(self.known, other.known),
            covered=join(self.covered, other.covered),
            response=join(self.response, other.response),
            matrix=matrix,
        )


def full_observation(observer: Observer, targets: Sequence[Target], states: SceneStates, required: Mask) -> Observation:
    """The verdicts of every camera on every target; required: see `Observation`."""
    responses = np.array([camera.response for camera in observer.cameras])
    return observation_of(observer.verdicts(targets, states), responses, targets, required)


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
