"""How likely detectors see boxes: by the curve of each, or, without one, surely within its limits and never outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, box_corners, inverse, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.curve import BoxSights
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.programming.sensing.limits import Cause, aspects, exact_hull_areas
from sqrp_cli.programming.sensing.observer import BoxVerdicts, Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import SoughtBox, Target


class Shutter(NamedTuple):
    """m states when a shutter opens, and when it closes."""

    opens: SceneStates
    closes: SceneStates


class BoxLikelihood(NamedTuple):
    """How likely c cameras see a box in m states."""

    probability: Array
    """Shape (m, c)."""
    sights: BoxSights | None
    """What it follows from, arrays of shape (m, c), where the detector has a curve and the box passes what limits it
    keeps (NaN elsewhere)."""


def likelihoods(
    observer: Observer, targets: Sequence[Target], states: SceneStates, shutters: Mapping[float, Shutter]
) -> list[list[BoxLikelihood]]:
    """How likely each camera sees each box of each target.

    shutters: the states in which the shutter opens and closes, by the time between [s]; none for 0.
    """
    gated = [
        replace(target, boxes=tuple(replace(box, limits=box.limits.gates) for box in target.boxes))
        for target in targets
    ]
    matrix = observer.verdicts(gated, states)
    return [
        [
            _likelihood(observer.cameras, box, verdicts, states, shutters)
            for box, verdicts in zip(target.boxes, boxes, strict=True)
        ]
        for target, boxes in zip(targets, matrix, strict=True)
    ]


def _likelihood(
    cameras: Sequence[Camera],
    box: SoughtBox,
    verdicts: BoxVerdicts,
    states: SceneStates,
    shutters: Mapping[float, Shutter],
) -> BoxLikelihood:
    passed, curve = verdicts.cause == Cause.NONE, box.limits.curve
    if curve is None:
        return BoxLikelihood(passed.astype(float), None)
    views = [_sights(camera, box, states, shutters.get(camera.exposure)) for camera in cameras]
    found = BoxSights(*(np.stack([getattr(view, name) for view in views], axis=1) for name in BoxSights._fields))
    found = BoxSights(*(np.where(passed, values, np.nan) for values in found._replace(visible=verdicts.visible)))
    return BoxLikelihood(np.where(passed, curve.probability(found), 0.0), found)


def _sights(camera: Camera, box: SoughtBox, states: SceneStates, shutter: Shutter | None) -> BoxSights:
    """How a camera sees a box in m states, arrays of shape (m,); `visible` is not looked at."""
    projection, count = Projection.of(camera), states.count
    X_CB = _in_camera(camera, box, states)
    corners_C = np.moveaxis(transform(X_CB, box_corners(box.size)), (0, 1, 2), (2, 1, 0))[:, :, None]
    normal_C = (X_CB[:, :3, :3] @ np.array(box.normal or (0.0, 0.0, 0.0))).T[:, None]
    facing = aspects(corners_C, normal_C)
    pixels = projection.pixels(_in_front(np.moveaxis(corners_C[:, :, 0], 0, -1))).points
    size = np.sqrt(exact_hull_areas(pixels[..., 0], pixels[..., 1]))
    blur = np.zeros(1)
    if shutter is not None:
        ends = (_in_front(_in_camera(camera, box, at)[:, :3, 3]) for at in shutter)
        first, last = (projection.pixels(points).points for points in ends)
        blur = np.hypot(*(last - first).T)
    found = (size, facing.incidence[0], facing.distance[0], np.ones(1), blur)
    return BoxSights(*(np.broadcast_to(values, count) for values in found))


def _in_camera(camera: Camera, box: SoughtBox, states: SceneStates) -> Array:
    """Poses of a box in the optical frame, shape (m or 1, 4, 4)."""
    return inverse(states.camera_poses(camera)) @ states.box_poses(box)


def _in_front(points_C: Array) -> Array:
    """Points (..., 3), those that are not before the camera moved where they can be projected: they do not count."""
    depth = points_C[..., 2:]
    return np.concatenate([points_C[..., :2], np.where(depth > 0, depth, 1.0)], axis=-1)


def at_least(probabilities: Array, number: int) -> Array:
    """How likely at least `number` of c cameras see something, each by itself: (m, c) becomes (m,)."""
    exactly = np.zeros((len(probabilities), number + 1))  # 0 to number - 1 cameras, and `number` or more
    exactly[:, 0] = 1.0
    for camera in probabilities.T:
        seen = exactly[:, :-1] * camera[:, None]
        exactly[:, :-1] -= seen
        exactly[:, 1:] += seen
    return exactly[:, -1]
