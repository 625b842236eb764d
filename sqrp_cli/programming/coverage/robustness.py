"""Robustness of the qualities against a failed camera and against errors of camera poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.geometry import displacement
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.quality import Qualities
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import observe
from sqrp_cli.programming.sensing.observer import Observer, sees_all

DRAWS = 20
"""Number of random sets of camera poses for the influence of calibration errors."""


@dataclass(frozen=True)
class Calibration:
    """Accuracy of the cameras' calibration."""

    position: float
    """Standard deviation of the error of each camera's optical frame along each of its axes [m]."""
    rotation: float
    """The same about each of its axes [rad]."""
    seed: int
    """Seed of the random errors."""


def without_each_camera(cell: Cell, study: Study) -> dict[str, Qualities]:
    """The qualities of a candidate if one camera fails, by the camera's name, from the verdicts of a full study."""
    observation = study.timeline.observation
    qualities = {}
    for index, camera in enumerate(cell.observer.cameras):
        covered = observation.covered.copy()
        for column, (target, boxes) in enumerate(zip(study.targets, observation.full_matrix, strict=True)):
            enough = np.delete(sees_all(boxes), index, axis=1).sum(axis=1) >= target.cameras
            covered[:, column] = observation.required[:, column] & enough
        timeline = replace(study.timeline, observation=replace(observation, covered=covered))
        qualities[camera.name] = Qualities.of(timeline)
    return qualities


def under_calibration_errors(
    cell: Cell, study: Study, sampling: Sampling, calibration: Calibration
) -> tuple[Qualities, ...]:
    """The qualities of a candidate for `DRAWS` draws of camera poses; draw i is the same for every candidate."""
    drawn = (perturbed(cell.observer, calibration, draw) for draw in range(DRAWS))
    timelines = (observe(study.watch, observer, sampling, full=False) for observer in drawn)
    return tuple(map(Qualities.of, timelines))


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
