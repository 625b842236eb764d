"""Several boxes looked at together by all cameras over a batch of states: what all their views have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, inverse
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.programming.ranges import begins_run
from sqrp_cli.programming.sensing.limits import LimitVerdicts, check_limits
from sqrp_cli.programming.sensing.scene import SceneStates
from sqrp_cli.programming.sensing.sight_lines import Indices, SightLines, SolidPoses, poses_at, shrink
from sqrp_cli.programming.sensing.solids import Solid
from sqrp_cli.programming.targets import SoughtBox


@dataclass(frozen=True, eq=False)
class Views:
    """What is looked at from where: a box, a camera and a state, by index, shape (v,) each."""

    box: Indices
    camera: Indices
    state: Indices


@dataclass(frozen=True, eq=False)
class Look:
    """b boxes, c cameras and s solids in m states."""

    boxes: Sequence[SoughtBox]
    projections: Sequence[Projection]
    solids: tuple[Solid, ...]
    states: SceneStates

    @cached_property
    def solid_poses(self) -> SolidPoses:
        """World poses of the solids."""
        return self.states.solid_poses(self.solids)

    @cached_property
    def opaque(self) -> NDArray[np.bool_]:
        """Which solids can hide which box, shape (s, b)."""
        parts = [solid.part for solid in self.solids]
        hiding = [
            [part.parent not in box.encloses and part.name not in box.encloses for box in self.boxes] for part in parts
        ]
        return np.array(hiding, dtype=bool).reshape(len(parts), len(self.boxes))

    def limits(self, box: Indices, state: Indices) -> LimitVerdicts:
        """Limits of every camera for boxes in states, by index and of shape (n,), ordered by box; results (c, n)."""
        shape = (len(self.projections), len(box))
        cause, side, figure = np.empty(shape, dtype=np.int8), np.empty(shape, dtype=np.int8), np.empty(shape)
        moving = self._moving_cameras
        for group in (np.flatnonzero(~moving), np.flatnonzero(moving)):
            if len(group):
                # What never moves in the image is looked at once.
                differs = moving[group[0]] | self._moving_boxes[box] | begins_run(box)
                places = np.flatnonzero(differs)
                found = self._limits(group, box[places], state[places])
                same = np.cumsum(differs) - 1
                cause[group], side[group], figure[group] = (
                    values[:, same] for values in (found.cause, found.side, found.figure)
                )
        return LimitVerdicts(cause, side, figure)

    def sight_lines(self, views: Views) -> SightLines:
        """One sight line per view; neighbours of the same camera and box share a hull where both stand still."""
        moving = self._moving_cameras
        differs = moving[views.camera] | self._moving_boxes[views.box]
        differs |= begins_run(views.box) | begins_run(views.camera)
        first = np.flatnonzero(differs)
        box, camera, state = views.box[first], views.camera[first], views.state[first]
        shrunk = np.array([shrink(entry.size, entry.normal) for entry in self.boxes])
        return SightLines(
            state=views.state,
            hull=np.cumsum(differs) - 1,
            box=box,
            X_WC=poses_at(self._X_WC, camera, state),
            X_WB=poses_at(self._X_WB, box, state),
            half_size=shrunk[box, 0],
            offset=shrunk[box, 1],
        )

    def centers(self, views: Views) -> Array:
        """Centres of the boxes in the world, shape (v, 3)."""
        return poses_at(self._X_WB, views.box, views.state)[:, :3, 3]

    @cached_property
    def _X_WC(self) -> list[Array]:
        return [self.states.camera_poses(projection.camera) for projection in self.projections]

    @cached_property
    def _X_WB(self) -> list[Array]:
        return [self.states.box_poses(box) for box in self.boxes]

    @cached_property
    def _moving_cameras(self) -> NDArray[np.bool_]:
        return np.array([len(X_WC) > 1 for X_WC in self._X_WC], dtype=bool)

    @cached_property
    def _moving_boxes(self) -> NDArray[np.bool_]:
        return np.array([len(X_WB) > 1 for X_WB in self._X_WB], dtype=bool)

    def _limits(self, cameras: Indices, box: Indices, state: Indices) -> LimitVerdicts:
        """Limits of cameras that all move or all stand still."""
        X_CB = self._in_cameras(cameras, poses_at(self._X_WB, box, state), state)
        half_size = 0.5 * np.array([entry.size for entry in self.boxes])[box].T
        half_axes = (X_CB[:, :3] * half_size[:, None]).reshape(3, 3, -1)
        corners = (BOX_SIGNS @ half_axes).reshape(3, 8, *X_CB.shape[2:]) + X_CB[:, 3:]
        normals = np.array([entry.normal or (0.0, 0.0, 0.0) for entry in self.boxes])[box].T
        normal_C = (X_CB[:, :3] * normals[:, None]).sum(axis=1)
        projections = [self.projections[camera] for camera in cameras]
        return check_limits(projections, [entry.limits for entry in self.boxes], box, corners, normal_C)

    def _in_cameras(self, cameras: Indices, X_WB: Array, state: Indices) -> Array:
        """Poses of boxes (n) in the optical frames of cameras (c), shape (3, 4, c, n)."""
        X_WC = [self._X_WC[camera] for camera in cameras]
        if len(X_WC[0]) > 1:
            return np.moveaxis(inverse(np.stack([X[state] for X in X_WC]))[..., :3, :] @ X_WB, (2, 3), (0, 1))
        # One product of two matrices, in place of one for every camera and box.
        X_CW = np.moveaxis(inverse(np.concatenate(X_WC))[:, :3], 0, 1).reshape(-1, 4)
        X_CB = X_CW @ np.moveaxis(X_WB, 0, 2).reshape(4, -1)
        return np.moveaxis(X_CB.reshape(3, len(cameras), 4, len(X_WB)), 1, 2)
