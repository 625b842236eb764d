"""Sight lines from cameras to boxes, and the view hulls that must be free of solids.

A view hull is the convex hull of the camera's centre and the corners of a box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import BOX_SIGNS, Array, Indices, Mask, begins_run, inverse
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.paint import look_alike
from sqrp_cli.programming.sensing.limits import LimitVerdicts, check_limits
from sqrp_cli.programming.sensing.scene_states import SceneStates, SolidPoses, poses_at
from sqrp_cli.programming.solids import Solids
from sqrp_cli.programming.targets import SoughtBox

SKIN = 1e-3
"""Amount by which a box is shrunk on every side for sight tests [m].

A solid that only touches it must not hide it.
"""

TOUCH = 1e-9
"""Distance up to which bounds count as touching [m]."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Sight lines and solids that may be in their way: n pairs."""

    line: Indices
    """Index of the sight line, shape (n,), not decreasing."""
    solid: Indices
    """Index of the solid, shape (n,)."""

    def __len__(self) -> int:
        return len(self.line)

    def some(self, which: Mask | Indices) -> Pairs:
        """Some of the pairs, by mask or by index."""
        return Pairs(self.line[which], self.solid[which])

    def joined(self, other: Pairs) -> Pairs:
        """These pairs and those of other lines."""
        line, solid = np.concatenate([self.line, other.line]), np.concatenate([self.solid, other.solid])
        order = np.argsort(line, kind="stable")
        return Pairs(line[order], solid[order])

    def of_lines(self, wanted: Mask) -> Pairs:
        """The pairs of those sight lines (v,) that are wanted."""
        return self.some(wanted[self.line])


@dataclass(frozen=True, eq=False)
class SightLines:
    """Boxes seen by cameras in a batch of states: v lines with h view hulls. Lines that never differ share a hull."""

    state: Indices
    """Index of the state of each line, shape (v,)."""
    hull: Indices
    """Index of the hull of each line, shape (v,)."""
    box: Indices
    """Index of the box that each hull belongs to, shape (h,)."""
    X_WC: Array
    """World pose of the camera's optical frame, shape (h, 4, 4)."""
    X_WB: Array
    """World pose of the box, shape (h, 4, 4)."""
    half_size: Array
    """Half the extents of the shrunk box, shape (h, 3) [m]."""
    offset: Array
    """Centre of the shrunk box in the box's frame, shape (h, 3) [m]."""

    @property
    def eyes(self) -> Array:
        """Camera centres in the world, shape (h, 3)."""
        return self.X_WC[:, :3, 3]

    @cached_property
    def corners(self) -> Array:
        """Corners of the shrunk boxes in the world, shape (h, 8, 3)."""
        corners_B = self.half_size[:, None] * BOX_SIGNS + self.offset[:, None]
        return corners_B @ self.X_WB[:, :3, :3].swapaxes(1, 2) + self.X_WB[:, None, :3, 3]

    @cached_property
    def finite(self) -> Mask:
        """Whether camera and box of each hull are somewhere at all, shape (h,)."""
        finite: Mask = np.logical_and.reduce(
            [np.isfinite(places).all(axis=(1, 2)) for places in (self.X_WC, self.corners)]
        )
        return finite


def alike_solids(boxes: Sequence[SoughtBox], solids: Solids) -> Mask:
    """Which solids have the colour of what is looked for in which box, without the object itself; shape (s, b)."""
    colors = [solid.color for solid in solids]
    found = np.zeros((len(solids), len(boxes)), dtype=bool)
    for column, box in enumerate(boxes):
        alike = {color for color in dict.fromkeys(colors) if look_alike(box.color, color)}
        if alike:
            found[:, column] = [color in alike for color in colors]
            found[solids.called(box.seeks or ""), column] = False
    return found


class ShrunkBox(NamedTuple):
    """A box without its skin."""

    half_size: Array
    """Half its extents, shape (3,) [m]."""
    offset: Array
    """Its centre in the frame of the whole box, shape (3,) [m]."""


def shrink(size: Sequence[float], normal: Sequence[float] | None) -> ShrunkBox:
    """A box of `size` [m] without its skin, so that a solid that only touches it does not hide it.

    A side no thicker than twice the skin keeps its thickness; the box then moves by the skin along its normal instead.
    """
    extents = np.asarray(size, dtype=float)
    thin = extents <= 2 * SKIN + TOUCH
    offset = SKIN * np.asarray(normal, dtype=float) if thin.any() and normal is not None else np.zeros(3)
    return ShrunkBox(half_size=0.5 * np.where(thin, extents, extents - 2 * SKIN), offset=offset)


@dataclass(frozen=True, eq=False)
class BoxViews:
    """v views of a box by a camera in a state, by index."""

    box: Indices
    """Shape (v,)."""
    camera: Indices
    """Shape (v,)."""
    state: Indices
    """Shape (v,)."""


@dataclass(frozen=True, eq=False)
class WatchedBoxes:
    """Several boxes watched by all cameras over a batch of states: the data common to all their views."""

    boxes: Sequence[SoughtBox]
    """b boxes."""
    projections: Sequence[Projection]
    """Of c cameras."""
    solids: Solids
    """s solids; each may hide the boxes that do not enclose it."""
    states: SceneStates
    """m states."""

    @property
    def gains(self) -> Array:
        """Of the cameras, shape (c,)."""
        return np.array([projection.camera.brightness for projection in self.projections])

    @cached_property
    def solid_poses(self) -> SolidPoses:
        """World poses of the solids."""
        return self.states.solid_poses(self.solids)

    @cached_property
    def opaque(self) -> Mask:
        """Which solids can hide which box, shape (s, b)."""
        opaque = np.ones((len(self.solids), len(self.boxes)), dtype=bool)
        for index, box in enumerate(self.boxes):
            for name in box.encloses:
                opaque[self.solids.called(name), index] = False
        return opaque

    @cached_property
    def alike(self) -> Mask:
        """Which solids have the colour of what is looked for in which box, shape (s, b)."""
        return alike_solids(self.boxes, self.solids)

    def limits(self, box: Indices, state: Indices) -> LimitVerdicts:
        """Limits of every camera for boxes in states, by index, shape (n,) each, ordered by box; results (c, n)."""
        shape = (len(self.projections), len(box))
        cause, side, figure = np.empty(shape, dtype=np.int8), np.empty(shape, dtype=np.int8), np.empty(shape)
        moving = self._moving_cameras
        for group in (np.flatnonzero(~moving), np.flatnonzero(moving)):
            if len(group):
                # Boxes that never move in the image are checked once.
                differs = moving[group[0]] | self._moving_boxes[box] | begins_run(box)
                places = np.flatnonzero(differs)
                found = self._limits(group, box[places], state[places])
                same = np.cumsum(differs) - 1
                cause[group], side[group] = found.cause[:, same], found.side[:, same]
                figure[group] = found.figure[:, same]
        return LimitVerdicts(cause=cause, side=side, figure=figure)

    def sight_lines(self, views: BoxViews) -> SightLines:
        """One sight line per view; neighbours of the same camera and box share a hull where both stand still."""
        moving = self._moving_cameras
        differs = moving[views.camera] | self._moving_boxes[views.box]
        differs |= begins_run(views.box) | begins_run(views.camera)
        first = np.flatnonzero(differs)
        box, camera, state = views.box[first], views.camera[first], views.state[first]
        shrunk = [shrink(entry.size, entry.normal) for entry in self.boxes]
        return SightLines(
            state=views.state,
            hull=np.cumsum(differs) - 1,
            box=box,
            X_WC=poses_at(self._X_WC, camera, state),
            X_WB=poses_at(self._X_WB, box, state),
            half_size=np.array([entry.half_size for entry in shrunk])[box],
            offset=np.array([entry.offset for entry in shrunk])[box],
        )

    def least_of(self, lines: SightLines) -> Array:
        """The share that the detector must see of the box of each sight line, shape (v,)."""
        return np.array([entry.limits.min_visible for entry in self.boxes])[lines.box[lines.hull]]

    @cached_property
    def _X_WC(self) -> list[Array]:
        return [self.states.camera_poses(projection.camera) for projection in self.projections]

    @cached_property
    def _X_WB(self) -> list[Array]:
        return [self.states.box_poses(box) for box in self.boxes]

    @cached_property
    def _moving_cameras(self) -> Mask:
        return np.array([len(X_WC) > 1 for X_WC in self._X_WC], dtype=bool)

    @cached_property
    def _moving_boxes(self) -> Mask:
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
        return self.check(projections, box, corners_C=corners, normal_C=normal_C)

    def check(
        self, projections: Sequence[Projection], box: Indices, *, corners_C: Array, normal_C: Array
    ) -> LimitVerdicts:
        """The limits for boxes by index, see `check_limits`."""
        detectors = [entry.limits for entry in self.boxes]
        return check_limits(projections, detectors, detector=box, corners_C=corners_C, normal_C=normal_C)

    def _in_cameras(self, cameras: Indices, X_WB: Array, state: Indices) -> Array:
        """Poses of boxes (n) in the optical frames of cameras (c), shape (3, 4, c, n)."""
        X_WC = [self._X_WC[camera] for camera in cameras]
        if len(X_WC[0]) > 1:
            return np.moveaxis(inverse(np.stack([X[state] for X in X_WC]))[..., :3, :] @ X_WB, (2, 3), (0, 1))
        # One product of two matrices instead of one for every camera and box.
        X_CW = np.moveaxis(inverse(np.concatenate(X_WC))[:, :3], 0, 1).reshape(-1, 4)
        X_CB = X_CW @ np.moveaxis(X_WB, 0, 2).reshape(4, -1)
        return np.moveaxis(X_CB.reshape(3, len(cameras), 4, len(X_WB)), 1, 2)
