"""Where a camera or an object may stand: clear of everything solid and of the robot's sweep, and not below a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from sqrp_cli.geometry import Array, Mask, box_corners, pose, transform
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.motion.collision.collision_body import distance_within, placement_at
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.solids import Solid, load_solid
from sqrp_cli.shapes import Part, Sphere

CAMERA_RADIUS = 0.03
"""Radius of the ball around a camera's centre that must be clear of everything [m]."""


class CameraRoom:
    """Where cameras that are fixed in the world may be."""

    def __init__(self, cell: Cell, states: Sequence[SceneStates]) -> None:
        """states: of the motions during which the cameras must not be in the way."""
        self._solids = cell.observer.solids
        self._states = states
        self._tops = sorted(_tops(cell.workspace.objects))

    def free(self, eyes: Array, present: Array | None = None) -> Mask:
        """Whether a camera may be at each of p places (p, 3); present: where it is now, (3,), above the same tables."""
        height = np.inf if present is None else float(present[2])
        lowest = max((top for top in self._tops if top <= height), default=-np.inf)
        free: Mask = eyes[:, 2] >= lowest
        for solid in self._solids:
            for states in self._states:
                rows = np.flatnonzero(free)
                free[rows] = ~touched(solid, states.X_WF[solid.part.parent], eyes[rows], CAMERA_RADIUS)
        return free


def touched(solid: Solid, X_FP: Array, places: Array, radius: float) -> Mask:
    """Whether a ball at each of p places (p, 3) touches a solid in any state, (p,).

    X_FP: poses of what carries the solid in the frame of the places, shape (m, 4, 4). radius: of the ball [m].
    """
    axes = X_FP[:, :3, :3] @ solid.half_axes.T  # columns
    half = np.linalg.norm(solid.half_axes, axis=1)
    center = X_FP[:, :3, :3] @ solid.center + X_FP[:, :3, 3]
    gap = np.abs(np.einsum("pmi,mij->pmj", places[:, None] - center, axes / half)) - half
    found = np.zeros(len(places), dtype=bool)
    ball = _ball(radius).geometry
    for place, state in np.argwhere((gap <= radius).all(axis=2)).tolist():
        if not found[place]:
            X_FG = placement_at(X_FP[state] @ solid.part.X_PG)
            at = placement_at(pose(position=places[place]))
            inside = solid.contains((places[place] - X_FP[state, :3, 3]) @ X_FP[state, :3, :3])
            found[place] = inside or distance_within(ball, at, solid.geometry, X_FG, 0.0) is not None
    return found


@cache
def _ball(radius: float) -> Solid:
    return load_solid(Part("camera", WORLD, Sphere(radius), pose()))


def _tops(objects: Mapping[str, SceneObject]) -> list[float]:
    """Heights of the tops of fixed objects that carry others [m]."""
    carriers = [objects[name] for name in {obj.on for obj in objects.values() if obj.on is not None}]
    return [
        float(transform(obj.X_WO, box_corners(obj.size))[:, 2].max())
        for obj in carriers
        if obj.fixed and obj.X_WO is not None
    ]
