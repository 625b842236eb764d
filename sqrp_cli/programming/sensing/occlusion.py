"""Line of sight: which solids reach into the view hull of a box, the convex hull of camera centre and box corners.

The hull decides for the whole box at once; rays to its corners would miss thin occluders. Solids are first culled in
NumPy by planes around the hull; only what may touch it is handed to coal, whose answer against the meshes is exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, cross
from sqrp_cli.programming.solids import BOX_TRIANGLES, Solid

Pairs = tuple[NDArray[np.int64], NDArray[np.int64]]
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


@dataclass(frozen=True, eq=False)
class SightLines:
    """View hulls to test: one box seen by cameras in a batch of states. Lines that never differ share a hull.

    state: index of the state, shape (v,). hull: index of the hull, shape (v,). eyes: camera centres in the world, shape
    (h, 3). corners: of the shrunk box in the world, shape (h, 8, 3).
    """

    state: NDArray[np.int64]
    hull: NDArray[np.int64]
    eyes: Array
    corners: Array


def shrink(size: Sequence[float], normal: Sequence[float] | None) -> tuple[Array, Array]:
    """Corners (8, 3) of a box without its skin, in the box's own frame, and the offset (3,) by which its centre moved.

    A side no thicker than twice the skin keeps its thickness; the box then moves by the skin along its normal instead.
    """
    extents = np.asarray(size, dtype=float)
    thin = extents <= 2 * SKIN + TOUCH
    offset = SKIN * np.asarray(normal, dtype=float) if thin.any() and normal is not None else np.zeros(3)
    return 0.5 * np.where(thin, extents, extents - 2 * SKIN) * BOX_SIGNS + offset, offset


def hull_planes(eyes: Array, corners: Array) -> Array:
    """Planes through the eyes (h, 3) that enclose each view hull, plus one behind the box and one behind the eye.

    Returns shape (h, 10, 4): unit normal n and offset o such that n . p > o for every point p outside that plane. The
    eight side planes bound the box's image by an octagon. All-zero planes (which exclude nothing) where the eye is so
    close that the box has no bounded image.
    """
    rays = corners - eyes[:, None]
    axis = rays.mean(axis=1)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    right = cross(axis, helper)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = cross(right, axis)
    diagonal = np.sqrt(0.5)
    across = np.stack([right, up, diagonal * (right + up), diagonal * (right - up)], axis=1)
    depth = (rays @ axis[:, :, None])[..., 0]
    bounded = depth.min(axis=1) > 1e-6
    slope = (across @ np.swapaxes(rays, 1, 2)) / np.where(bounded[:, None], depth, 1.0)[:, None]
    planes = np.empty((len(rays), 10, 4))
    planes[:, 0:4, :3] = across - slope.max(axis=2)[..., None] * axis[:, None]
    planes[:, 4:8, :3] = slope.min(axis=2)[..., None] * axis[:, None] - across
    planes[:, 8, :3] = axis
    planes[:, 9, :3] = -axis
    planes[..., :3] /= np.linalg.norm(planes[..., :3], axis=2, keepdims=True)
    planes[..., 3] = (planes[..., :3] @ eyes[:, :, None])[..., 0]
    planes[:, 8, 3] += depth.max(axis=1)
    planes[~bounded] = 0.0
    return planes


def near_pairs(lines: SightLines, poses: SolidPoses, solids: Sequence[int]) -> Pairs:
    """Pairs (sight line, index of solid) whose hull and bounding volume may touch, ordered by sight line."""
    if not len(lines.state) or not solids:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    planes = hull_planes(lines.eyes, lines.corners)
    bounds = _Bounds.of(poses, solids, int(lines.state.max()) + 1)
    x, y, z = np.moveaxis(bounds.centers[:, lines.state], -1, 0)
    reach = np.array([poses.solids[index].radius for index in solids])[:, None] + TOUCH
    near = np.ones(x.shape, dtype=bool)
    # One plane at a time: NumPy is slow at reductions over short axes.
    for a, b, c, offset in np.ascontiguousarray(planes.transpose(1, 2, 0))[:, :, lines.hull]:
        near &= a * x + b * y + c * z <= reach + offset

    line, row = np.nonzero(near.T)
    hull, state = lines.hull[line], lines.state[line]
    center, half_axes = bounds.centers[row, state], bounds.half_axes(row, state)
    normals, offsets = planes[hull, :, :3], planes[hull, :, 3]
    along = normals @ np.concatenate([center[:, :, None], np.swapaxes(half_axes, 1, 2)], axis=2)
    middle, *halves = np.moveaxis(along, -1, 0)
    reaching = middle - (np.abs(halves[0]) + np.abs(halves[1]) + np.abs(halves[2])) <= offsets + TOUCH
    keep = np.flatnonzero(reaching.all(axis=1))
    points = np.concatenate([lines.corners, lines.eyes[:, None]], axis=1)[hull[keep]] - center[keep, None]
    keep = keep[_reach_into(points, half_axes[keep])]
    return line[keep], np.asarray(solids, dtype=np.int64)[row[keep]]


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Boxes around s solids in m states.

    R_WP: rotations of the solids' parents, shape (s, m, 3, 3). centers: in the world, shape (s, m, 3). parent_axes:
    half axes in the frames of the parents, one a row, shape (s, 3, 3).
    """

    R_WP: Array
    centers: Array
    parent_axes: Array

    @classmethod
    def of(cls, poses: SolidPoses, solids: Sequence[int], count: int) -> _Bounds:
        X_WP = np.empty((len(solids), count, 3, 4))
        for number, index in enumerate(solids):
            X_WP[number] = poses.pose(index)[:count, :3]
        centers_P = np.stack([poses.solids[index].center for index in solids])
        centers = (X_WP[..., :3] @ centers_P[:, None, :, None])[..., 0] + X_WP[..., 3]
        return cls(X_WP[..., :3], centers, np.stack([poses.solids[index].half_axes for index in solids]))

    def half_axes(self, row: NDArray[np.int64], state: NDArray[np.int64]) -> Array:
        """Half axes of some of the boxes in the world, one a row, shape (n, 3, 3)."""
        axes: Array = self.parent_axes[row] @ np.swapaxes(self.R_WP[row, state], 1, 2)
        return axes


def _reach_into(points: Array, half_axes: Array) -> NDArray[np.bool_]:
    """Whether the convex hull of points (n, k, 3) may reach into a box around the origin with half axes (n, 3, 3).

    It does not if all of them lie beyond the same face.
    """
    along = np.ascontiguousarray((points @ np.swapaxes(half_axes, 1, 2)).transpose(1, 2, 0))  # reductions over n rows
    length = np.sqrt(np.einsum("nai,nai->an", half_axes, half_axes))
    reach = length * (length + TOUCH)
    may: NDArray[np.bool_] = ((along.min(axis=0) <= reach) & (along.max(axis=0) >= -reach)).all(axis=0)
    return may


class HullTester:
    """Tests view hulls against solids with coal; holds one convex shape whose points are overwritten for each hull."""

    def __init__(self) -> None:
        faces = coal.StdVec_Triangle()
        for triangle in BOX_TRIANGLES.tolist():
            faces.append(coal.Triangle(*triangle))
        points = coal.StdVec_Vec3s()
        points.extend([*BOX_SIGNS, np.array([0.0, 0.0, 3.0])])
        # Only the points matter to the support function; the faces are there because coal asks for some.
        self._hull = coal.Convex(points, faces)
        self._points = self._hull.points()
        self._at_origin = coal.Transform3s.Identity()
        self._placement = coal.Transform3s.Identity()
        self._request = coal.CollisionRequest()
        self._result = coal.CollisionResult()

    def met(self, lines: SightLines, poses: SolidPoses, pairs: Pairs, *, first_only: bool) -> Pairs:
        """Those of the pairs whose solid reaches into its view hull; only the first of each line if `first_only`."""
        found = np.zeros(len(pairs[0]), dtype=bool)
        if not len(found):
            return pairs
        hulls = np.concatenate([lines.corners, lines.eyes[:, None]], axis=1)
        hull_of = lines.hull.tolist()
        still: dict[tuple[int, int], bool] = {}
        placements = {}
        for index in np.unique(pairs[1]).tolist():
            X_WG = poses.pose(index) @ poses.solids[index].part.X_PG
            placements[index] = (np.ascontiguousarray(X_WG[:, :3, :3]), np.ascontiguousarray(X_WG[:, :3, 3]))
        states = lines.state.tolist()
        current, done, loaded = -1, False, -1
        for row, (line, index) in enumerate(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True)):
            if line != current:
                current, done = line, False
            elif done:
                continue
            rotations, translations = placements[index]
            hull, fixed = hull_of[line], len(translations) == 1
            hit = still.get((hull, index)) if fixed else None
            if hit is None:
                if hull != loaded:
                    self._points[:] = hulls[hull]
                    loaded = hull
                at = 0 if fixed else states[line]
                self._placement.setRotation(rotations[at])
                self._placement.setTranslation(translations[at])
                hit = self._meets(poses.solids[index])
                if fixed:
                    still[hull, index] = hit
            found[row] = hit
            done = hit and first_only
        return pairs[0][found], pairs[1][found]

    def _meets(self, solid: Solid) -> bool:
        self._result.clear()
        contacts: int = coal.collide(
            self._hull, self._at_origin, solid.geometry, self._placement, self._request, self._result
        )
        return contacts > 0
