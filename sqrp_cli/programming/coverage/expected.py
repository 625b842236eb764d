"""Expected evidence: how likely images show all that must be seen, on average over the time that is monitored.

Whether one camera sees something is taken to be independent of whether another does, and of what else it sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.timeline import Timeline
from sqrp_cli.programming.sensing.likelihood import BoxLikelihood, Shutter, at_least, likelihoods


@dataclass(frozen=True, eq=False)
class Expectation:
    """How likely images show the targets of a motion, at m samples."""

    boxes: list[list[BoxLikelihood]]
    """Of each box of each of `a` targets, from every camera."""
    targets: Array
    """That enough cameras see all boxes of each target, shape (m, a)."""
    states: Array
    """That they see all that a state requires, NaN where it requires nothing, shape (m,)."""


def expectation(cell: Cell, study: Study) -> Expectation | None:
    """How likely images show the targets at the samples of a study; None in a cell without curves."""
    if all(detector.curve is None for detector in cell.workspace.detectors.values()):
        return None
    samples, stage = study.timeline.samples, study.stage
    exposures = {camera.exposure for camera in cell.observer.cameras} - {0.0}
    shutters: Mapping[float, Shutter] = {
        exposure: Shutter(*(stage.states(stage.shifted(samples, part * exposure)) for part in (-0.5, 0.5)))
        for exposure in exposures
    }
    boxes = likelihoods(cell.observer, study.targets, stage.states(samples), shutters)
    # All boxes of a target must be seen by the same camera.
    seen = [np.prod([box.probability for box in of_target], axis=0) for of_target in boxes]
    targets = np.stack(
        [at_least(found, target.cameras) for found, target in zip(seen, study.targets, strict=True)], axis=1
    )
    required = study.timeline.observation.required
    states = np.where(required, targets, 1.0).prod(axis=1)
    return Expectation(boxes, targets, np.where(required.any(axis=1), states, np.nan))


def expected_quality(cell: Cell, study: Study) -> float | None:
    """q_expected: the mean of the probability over the time T; None without curves, or where T is 0."""
    found = expectation(cell, study)
    return None if found is None else _mean(study.timeline, found.states)


def _mean(timeline: Timeline, states: Array) -> float | None:
    """The time integral of what holds at samples, over T.

    Linear between neighbouring samples, and 0 where it is 0 at either: with probabilities of 0 and 1 this is Q_avg.
    """
    if timeline.T <= 0:
        return None
    before, after = np.nan_to_num(states[:-1]), np.nan_to_num(states[1:])
    height = np.where((before > 0) & (after > 0), 0.5 * (before + after), 0.0)
    return min(1.0, float((height * np.nan_to_num(timeline.steps)).sum() / timeline.T))
