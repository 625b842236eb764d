"""How likely detectors see boxes: by the curve of each, or, without one, surely within its limits and never outside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.camera.detector import BoxSights
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import Array, inverse
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target


class BoxLikelihood(NamedTuple):
    """How likely c cameras see a box in m states."""

    probability: Array  # Shape (m, c)
    sights: BoxSights | None
    """What it follows from, shape (5, m, c), where the detector has a curve and the box passes what limits it keeps;
    NaN elsewhere."""


def likelihoods(
    observer: Observer, targets: Sequence[Target], states: SceneStates, shutters: Mapping[float, Sequence[SceneStates]]
) -> list[list[BoxLikelihood]]:
    """How likely each camera sees each box of each target.

    shutters: the states in which a shutter opens and those in which it closes, by the time between [s]; none for 0.
    """
    gated = [
        replace(target, boxes=tuple(replace(box, limits=box.limits.hard_limits) for box in target.boxes))
        for target in targets
    ]
    every = [box for target in targets for box in target.boxes]
    aspects: Iterator[Array] = iter(observer.aspects(every, states)) if every else iter(())
    found: list[list[BoxLikelihood]] = []
    for target, boxes in zip(targets, observer.verdicts(gated, states, culprits=False), strict=True):
        found.append([])
        for box, verdicts in zip(target.boxes, boxes, strict=True):
            passed, curve = verdicts.cause == Cause.NONE, box.limits.curve
            distance, incidence, size = next(aspects)
            if curve is None:
                found[-1].append(BoxLikelihood(passed.astype(float), None))
                continue
            blur = np.zeros(passed.shape)
            for column, camera in enumerate(observer.cameras):
                if camera.exposure in shutters:
                    # What is not before the camera is moved where it can be projected: it does not count.
                    centers = (
                        (inverse(at.camera_poses(camera)) @ at.box_poses(box))[:, :3, 3]
                        for at in shutters[camera.exposure]
                    )
                    before = (np.where([True, True, False], p, np.where(p[:, 2:] > 0, p, 1.0)) for p in centers)
                    first, last = (Projection(camera).pixels(points)[0] for points in before)
                    blur[:, column] = np.hypot(*(last - first).T)
            seen = np.stack([size, incidence, distance, verdicts.visible, blur])
            sights = np.where(passed, seen, np.nan)
            found[-1].append(BoxLikelihood(np.where(passed, curve.probability(sights), 0.0), sights))
    return found


def at_least(probabilities: Array, number: int) -> Array:
    """How likely at least `number` of c cameras see something, each by itself: (m, c) becomes (m,)."""
    exactly = np.zeros((len(probabilities), number + 1))  # 0 to number - 1 cameras, and `number` or more
    exactly[:, 0] = 1.0
    for camera in probabilities.T:
        seen = exactly[:, :-1] * camera[:, None]
        exactly[:, :-1] -= seen
        exactly[:, 1:] += seen
    return exactly[:, -1]
