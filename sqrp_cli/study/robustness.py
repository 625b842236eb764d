"""Figures under doubt: with a failed camera, with errors of camera poses, and as detectors see with a probability.

Whether one camera sees something is taken to be independent of whether another does, and of what else it sees.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sqrp_cli.figures import Qualities
from sqrp_cli.geometry import Array, displacement
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.sight.likelihood import BoxLikelihood, at_least, likelihoods
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.study.analysis import Analysis
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.timeline import observe

DRAWS = 20  # Number of random sets of camera poses for the influence of calibration errors


@dataclass(frozen=True)
class Calibration:
    """Accuracy of the cameras' calibration."""

    position: float  # Standard deviation of the error of each camera's optical frame along each of its axes [m]
    rotation: float  # The same about each of its axes [rad]
    seed: int  # Seed of the random errors


def without_each_camera(cell: Cell, analysis: Analysis) -> dict[str, Qualities]:
    """The qualities of a candidate if one camera fails, by the camera's name, from the verdicts of a full analysis."""
    observation = analysis.timeline.observation
    qualities = {}
    for index, camera in enumerate(cell.observer.cameras):
        covered = observation.covered.copy()
        for column, (target, boxes) in enumerate(zip(analysis.planned.targets, observation.full_matrix, strict=True)):
            enough = np.delete(sees_all(boxes), index, axis=1).sum(axis=1) >= target.cameras
            covered[:, column] = observation.required[:, column] & enough
        without = replace(analysis.timeline, observation=replace(observation, covered=covered))
        qualities[camera.name] = without.qualities
    return qualities


def under_calibration_errors(
    cell: Cell, analysis: Analysis, sampling: Sampling, calibration: Calibration
) -> tuple[Qualities, ...]:
    """The qualities of a candidate for `DRAWS` draws of camera poses; draw i is the same for every candidate."""
    drawn = (perturbed(cell.observer, calibration, draw) for draw in range(DRAWS))
    timelines = (observe(analysis.planned, observer, sampling, full=False) for observer in drawn)
    return tuple(one.qualities for one in timelines)


def perturbed(observer: Observer, calibration: Calibration, draw: int) -> Observer:
    """The cameras with the errors of one draw; the same solids."""
    random = np.random.default_rng([calibration.seed, draw])
    errors = random.normal(size=(len(observer.cameras), 6))
    cameras = (
        replace(
            camera, X_FC=camera.X_FC @ displacement(calibration.position * error[:3], calibration.rotation * error[3:])
        )
        for camera, error in zip(observer.cameras, errors, strict=True)
    )
    return replace(observer, cameras=tuple(cameras))


@dataclass(frozen=True, eq=False)
class Expectation:
    """How likely images show the targets of a motion, at m samples."""

    boxes: list[list[BoxLikelihood]]  # Of each box of each of `a` targets, from every camera
    targets: Array  # That enough cameras see all boxes of each target, shape (m, a)
    states: Array  # That they see all that a state requires, NaN where it requires nothing, shape (m,)


def expectation(cell: Cell, analysis: Analysis) -> Expectation | None:
    """How likely images show the targets at the samples of an analysis; None in a cell without curves."""
    if all(detector.curve is None for detector in cell.workspace.detectors.values()):
        return None
    samples, stage = analysis.timeline.samples, analysis.planned.stage
    # Where everything is as shutters open and close, but within the primitive of each sample.
    spans = [(one.start, one.end) for one in stage.motion.primitives]
    start, end = np.array([spans[piece.primitive] for piece in stage.pieces])[samples.piece].T
    shutters = dict[float, list[SceneStates]]()
    for exposure in {camera.exposure for camera in cell.observer.cameras} - {0.0}:
        times = (np.clip(samples.t + part * exposure, start, end) for part in (-0.5, 0.5))
        shutters[exposure] = [stage.states(replace(samples, t=t)) for t in times]
    boxes = likelihoods(cell.observer, analysis.planned.targets, stage.states(samples), shutters)
    # All boxes of a target must be seen by the same camera.
    seen = [np.prod([box.probability for box in of_target], axis=0) for of_target in boxes]
    targets = np.stack(
        [at_least(found, target.cameras) for found, target in zip(seen, analysis.planned.targets, strict=True)], axis=1
    )
    required = analysis.timeline.observation.required
    states = np.where(required, targets, 1.0).prod(axis=1)
    return Expectation(boxes, targets, np.where(required.any(axis=1), states, np.nan))


def expected_quality(cell: Cell, analysis: Analysis) -> float | None:
    """q_expected: the mean of the probability over the time T; None without curves, or where T is 0."""
    found, timeline = expectation(cell, analysis), analysis.timeline
    if found is None or analysis.planned.T <= 0:
        return None
    # Linear between neighbouring samples, and 0 where it is 0 at either: with probabilities of 0 and 1 this is Q_avg.
    before, after = np.nan_to_num(found.states[:-1]), np.nan_to_num(found.states[1:])
    height = np.where((before > 0) & (after > 0), 0.5 * (before + after), 0.0)
    return min(1.0, float((height * timeline.samples.gaps).sum() / analysis.planned.T))
