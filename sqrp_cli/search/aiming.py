"""Cameras elsewhere, many at once: poses that look at points, and where a camera may stand.

That is clear of everything solid and of the robot's sweep, and not below a table.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, box_corners, cross, inverse, pose, read_only, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Part, Sphere
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import Solid, distance, load_solid

_PLACES_TOGETHER = 400_000  # places to compare with a solid at once, counted in every state, to bound the memory
_PARALLEL = 1e-9  # Sine of the angle below which a direction has no side, as in `geometry.look_at`


@dataclass(frozen=True, eq=False)
class Aim:
    """What a camera looks at, in the frame that carries it, and which way is up in its image."""

    point: Array  # in the middle of the image, shape (3,) [m]
    up: Array  # shape (3,)

    @classmethod
    def along(cls, camera: Camera, near: Array) -> Aim:
        """The aim of a camera whose orientation is stated: the point of its optical axis nearest to a point (3,)."""
        eye, axis = camera.X_FC[:3, 3], camera.X_FC[:3, 2]
        distance = max(float((near - eye) @ axis), camera.near)
        return cls(read_only(eye + distance * axis), read_only(-camera.X_FC[:3, 1]))


def looking_at(eyes: Array, points: Array, up: Array) -> Array:
    """The poses (p, 4, 4) that `geometry.look_at` gives for eyes and points (p, 3) and one upward direction (3,)."""
    forward = (points - eyes) / np.linalg.norm(points - eyes, axis=1)[:, None]
    right = np.zeros_like(forward)
    for way in (np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), up / np.linalg.norm(up)):  # the last counts most
        across = cross(forward, np.broadcast_to(way, forward.shape))
        usable = np.linalg.norm(across, axis=1) >= _PARALLEL
        right[usable] = across[usable]
    right /= np.linalg.norm(right, axis=1)[:, None]
    right -= (right * forward).sum(axis=1)[:, None] * forward
    right /= np.linalg.norm(right, axis=1)[:, None]
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


def whole_millimetres(vector: Array) -> Array:
    """A place or an offset in whole millimetres [m]."""
    rounded: Array = np.round(np.round(vector / 1e-3) * 1e-3, 6)
    return rounded


CAMERA_RADIUS = 0.03  # Radius of the ball around a camera's centre that must be clear of everything [m]


def free_for_cameras(cell: Cell, swept: Sequence[SceneStates], eyes: Array, present: Array | None = None) -> Mask:
    """Whether a camera that is fixed in the world may be at each of p places (p, 3), shape (p,).

    swept: the states of the motions during which it must not be in the way. present: where it is now, (3,): it stays
    above the tops of fixed objects that carry others which are below it now.
    """
    objects, height = cell.workspace.objects, np.inf if present is None else float(present[2])
    carriers = (objects[name] for name in {obj.on for obj in objects.values() if obj.on is not None})
    fixed = [(obj.X_WO, obj.size) for obj in carriers if obj.fixed and obj.X_WO is not None]
    tops = [float(transform(X_WO, box_corners(size))[:, 2].max()) for X_WO, size in fixed]
    free: Mask = eyes[:, 2] >= max((top for top in tops if top <= height), default=-np.inf)
    for states in swept:
        free &= ~touching(cell, states, WORLD, eyes, CAMERA_RADIUS)
    return free


def touching(cell: Cell, states: SceneStates, frame: str, places: Array, radius: float) -> Mask:
    """Whether a ball at each of p places (p, 3) in a frame touches anything in any state, shape (p,).

    What is fixed to the same link as the places is not looked at. radius: of the ball [m].
    """
    found, X_FW = np.zeros(len(places), dtype=bool), inverse(states.X_WF[frame])
    for solid in cell.observer.solids:
        X_FP = X_FW @ states.X_WF[solid.part.parent]
        if frame != WORLD and float(np.ptp(X_FP, axis=0).max()) < 1e-9:
            continue
        step = max(1, _PLACES_TOGETHER // len(X_FP))
        for start in range(0, len(places), step):
            here = np.flatnonzero(~found[start : start + step]) + start
            found[here] = touched(solid, X_FP, places[here], radius)
    return found


def touched(solid: Solid, X_FP: Array, places: Array, radius: float) -> Mask:
    """Whether a ball at each of p places (p, 3) touches a solid in any state, (p,).

    X_FP: poses of what carries the solid in the frame of the places, shape (m, 4, 4). radius: of the ball [m].
    """
    half, found = np.linalg.norm(solid.half_axes, axis=1), np.zeros(len(places), dtype=bool)
    center = X_FP[:, :3, :3] @ solid.center + X_FP[:, :3, 3]
    most = float(np.linalg.norm(half + radius)) + 1e-9
    within = (places >= center.min(axis=0, initial=np.inf) - most) & (
        places <= center.max(axis=0, initial=-np.inf) + most
    )
    near = np.flatnonzero(within.all(axis=1))  # most cameras hang far from where a solid ever is
    units = X_FP[:, :3, :3] @ solid.half_axes.T / half  # columns
    along = places[near] @ units.swapaxes(0, 1).reshape(3, -1) - (center[:, None] @ units).reshape(-1)  # all at once
    gap = np.abs(along).reshape(len(near), len(X_FP), 3) - half
    ball = load_solid(Part("camera", WORLD, Sphere(radius), pose()))
    for index, state in np.argwhere((gap <= radius).all(axis=2)).tolist():
        if not found[place := near[index]]:
            inside = solid.contains((places[place] - X_FP[state, :3, 3]) @ X_FP[state, :3, :3])
            found[place] = inside or distance(ball, pose(position=places[place]), solid, X_FP[state], 0.0) is not None
    return found
