"""Cameras elsewhere or turned, many at once: poses of optical frames that look at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, cross, read_only
from sqrp_cli.knowledge.camera.camera import Camera

_PARALLEL = 1e-9
"""Sine of the angle below which a direction has no side, as in `geometry.look_at`."""


@dataclass(frozen=True, eq=False)
class Aim:
    """What a camera looks at, in the frame that carries it, and which way is up in its image."""

    point: Array
    """In the middle of the image, shape (3,) [m]."""
    up: Array
    """Shape (3,)."""
    stated: bool = False
    """Whether the workspace says so; otherwise the orientation is stated."""

    @classmethod
    def along(cls, camera: Camera, near: Array) -> Aim:
        """The aim of a camera whose orientation is stated: the point of its optical axis nearest to a point (3,)."""
        eye, axis = camera.X_FC[:3, 3], camera.X_FC[:3, 2]
        distance = max(float((near - eye) @ axis), camera.near)
        return cls(read_only(eye + distance * axis), read_only(-camera.X_FC[:3, 1]))


def looking_at(eyes: Array, points: Array, up: Array) -> Array:
    """The poses (p, 4, 4) that `geometry.look_at` gives for eyes and points (p, 3) and one upward direction (3,)."""
    forward = _unit(points - eyes)
    right = np.zeros_like(forward)
    for way in (np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), _unit(up[None])[0]):  # the last one counts most
        across = cross(forward, np.broadcast_to(way, forward.shape))
        usable = np.linalg.norm(across, axis=1) >= _PARALLEL
        right[usable] = across[usable]
    right = _unit(right)
    right = _unit(right - (right * forward).sum(axis=1)[:, None] * forward)
    poses = np.tile(np.eye(4), (len(eyes), 1, 1))
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2], poses[:, :3, 3] = right, cross(forward, right), forward, eyes
    return poses


def turned(aim: Aim, eye: Array, angles: Array) -> Array:
    """Points (p, 3) that a camera at `eye` (3,) looks at once its axis has turned, at the same distance.

    angles: shape (p, 2): to the right and up in the image; their length is the angle between the axes [rad].
    """
    present = looking_at(eye[None], aim.point[None], aim.up)[0]
    size = np.linalg.norm(angles, axis=1)
    side = angles / np.maximum(size, 1e-12)[:, None]
    across = side[:, :1] * present[:3, 0] - side[:, 1:] * present[:3, 1]
    axes = np.cos(size)[:, None] * present[:3, 2] + np.sin(size)[:, None] * across
    points: Array = eye + float(np.linalg.norm(aim.point - eye)) * axes
    return points


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return unit
