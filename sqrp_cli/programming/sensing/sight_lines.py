"""Sight lines: which boxes are seen from where, and the view hulls that must be free of anything solid.

A view hull is the convex hull of the camera's centre and the corners of a box.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array
from sqrp_cli.programming.sensing.solids import Solid

Indices = NDArray[np.int64]

Pairs = tuple[Indices, Indices]
"""Sight lines and the solids they are paired with, by index, ordered by sight line."""

SKIN = 1e-3
"""By how much a box is shrunk on every side before its sight is tested [m].

What merely touches it must not hide it.
"""

TOUCH = 1e-9
"""Distance up to which bounds count as touching [m]."""


@dataclass(frozen=True, eq=False)
class SolidPoses:
    """Solids with the world poses of their parents over a batch of states.

    X_WP: pose of each parent, shape (m, 4, 4), or (1, 4, 4) where it never moves.
    """

    solids: tuple[Solid, ...]
    X_WP: Mapping[str, Array]

    def pose(self, index: int) -> Array:
        """World poses of a solid's parent, shape (m or 1, 4, 4)."""
        return self.X_WP[self.solids[index].part.parent]

    def at(self, solid: Indices, state: Indices) -> Array:
        """World poses of the parents of solids in states, both by index and of shape (n,); shape (n, 4, 4)."""
        found = np.empty((len(solid), 4, 4))
        for index in np.flatnonzero(np.bincount(solid)).tolist():
            here, poses = np.flatnonzero(solid == index), self.pose(index)
            found[here] = poses[state[here]] if len(poses) > 1 else poses
        return found


@dataclass(frozen=True, eq=False)
class SightLines:
    """Boxes seen by cameras in a batch of states. Lines that never differ share a hull.

    state: index of the state, shape (v,). hull: index of the hull, shape (v,). box: index of the box that each hull
    belongs to, shape (h,). X_WC: world pose of the camera's optical frame, shape (h, 4, 4). X_WB: of the box, shape
    (h, 4, 4). half_size, offset: half the extents of the shrunk box and its centre in the box's frame, shape (h, 3).
    """

    state: Indices
    hull: Indices
    box: Indices
    X_WC: Array
    X_WB: Array
    half_size: Array
    offset: Array

    @property
    def eyes(self) -> Array:
        """Camera centres in the world, shape (h, 3)."""
        return self.X_WC[:, :3, 3]

    @cached_property
    def corners(self) -> Array:
        """Corners of the shrunk boxes in the world, shape (h, 8, 3)."""
        corners_B = self.half_size[:, None] * BOX_SIGNS + self.offset[:, None]
        corners: Array = corners_B @ self.X_WB[:, :3, :3].swapaxes(1, 2) + self.X_WB[:, None, :3, 3]
        return corners

    @cached_property
    def finite(self) -> NDArray[np.bool_]:
        """Whether camera and box of each hull are somewhere at all, shape (h,)."""
        finite: NDArray[np.bool_] = np.logical_and.reduce(
            [np.isfinite(places).all(axis=(1, 2)) for places in (self.X_WC, self.corners)]
        )
        return finite


def poses_at(X: Sequence[Array], which: Indices, state: Indices) -> Array:
    """Poses of things in states, both by index and of shape (n,); shape (n, 4, 4).

    X: poses of each thing over all states, shape (m, 4, 4), or (1, 4, 4) where it never moves.
    """
    found: Array = np.stack([poses[0] for poses in X])[which]
    for index, poses in enumerate(X):
        if len(poses) > 1:
            here = np.flatnonzero(which == index)
            found[here] = poses[state[here]]
    return found


def shrink(size: Sequence[float], normal: Sequence[float] | None) -> tuple[Array, Array]:
    """Half the extents (3,) of a box without its skin, and the offset (3,) by which its centre moves, in its own frame.

    A side no thicker than twice the skin keeps its thickness; the box then moves by the skin along its normal instead.
    """
    extents = np.asarray(size, dtype=float)
    thin = extents <= 2 * SKIN + TOUCH
    offset = SKIN * np.asarray(normal, dtype=float) if thin.any() and normal is not None else np.zeros(3)
    return 0.5 * np.where(thin, extents, extents - 2 * SKIN), offset
