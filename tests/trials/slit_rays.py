"""What a camera sees, from rays that Embree casts: written without any of the code that it judges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, Mask, inverse
from sqrp_cli.sight.solids import Solid
from sqrp_cli.skill.target_box import TargetBox

SHRUNK = 1e-3
"""By how much a box is smaller on each side than it is stated [m]."""

FINE = 9
"""Points along each edge of a box that must be seen whole."""

GRID = 24
"""Directions along each side of the rectangle around the image of a box of which a share is enough."""

TOGETHER = 2_000_000
"""Rays cast at once, to bound the memory."""


class Rays:
    """Rays from a fixed camera to a box over m states of a cell."""

    def __init__(self, solids: Sequence[Solid], X_WF: Mapping[str, Array]) -> None:
        """X_WF: world poses of all frames, shape (m or 1, 4, 4)."""
        self._X_FW = {frame: inverse(X) for frame, X in X_WF.items()}
        self._parts: dict[str, EmbreeScene] = {}
        for solid in solids:
            scene = self._parts.setdefault(solid.part.parent, EmbreeScene())
            TriangleMesh(scene, solid.vertices.astype(np.float32), solid.triangles.astype(np.int32))

    def see(self, eye: Array, ends: Array, state: Array, least: float) -> Mask:
        """Whether so large a share of the points (v, n, 3) is seen from an eye (3,) in states (v,), shape (v,).

        Points that are NaN do not count.
        """
        free = np.isfinite(ends[..., 0])
        needed = least * free.sum(axis=1)
        ends = np.where(free[..., None], ends, eye)
        for frame, scene in sorted(self._parts.items(), key=lambda part: len(self._X_FW[part[0]])):
            X = self._X_FW[frame]
            rows = np.flatnonzero(free.sum(axis=1) >= needed)
            for some in np.array_split(rows, rows.size * ends.shape[1] // TOGETHER + 1) if len(rows) else ():
                X_FW = X[state[some]] if len(X) > 1 else np.repeat(X, len(some), axis=0)
                origins = X_FW[:, :3, :3] @ eye + X_FW[:, :3, 3]
                rays = np.einsum("vij,vnj->vni", X_FW[:, :3, :3], ends[some] - eye)
                starts = np.repeat(origins, ends.shape[1], axis=0).astype(np.float32)
                length = np.ones(len(starts), dtype=np.float32)
                hit = scene.run(starts, rays.reshape(-1, 3).astype(np.float32), length, query="OCCLUDED")
                free[some] &= (hit < 0).reshape(len(some), -1)
        enough: Mask = free.sum(axis=1) >= needed
        return enough


def seen(camera: Camera, X_WC: Array, box: TargetBox, X_WB: Array, rays: Rays, *, least: float) -> Mask:
    """Whether a camera without distortion sees a box, at X_WB (m, 4, 4), in each state, shape (m,).

    least: which share of it must be seen. Its detector's own limits are taken for kept.
    """
    full = _points(X_WB, 0.5 * np.array(box.size), 2)
    at = (full - X_WC[:3, 3]) @ X_WC[:3, :3]
    depth = np.where(at[..., 2] > 0, at[..., 2], np.nan)
    K = camera.matrix
    u, v = K[0, 0] * at[..., 0] / depth + K[0, 2], K[1, 1] * at[..., 1] / depth + K[1, 2]
    inside = (abs(u - 0.5 * (camera.width - 1)) <= 0.5 * camera.width) & (
        abs(v - 0.5 * (camera.height - 1)) <= 0.5 * camera.height
    )
    ranged = (at[..., 2] >= camera.near) & (at[..., 2] <= camera.far)
    found: Mask = (inside & ranged).all(axis=1)
    half, eye = 0.5 * np.array(box.size) - SHRUNK, X_WC[:3, 3]
    for fineness in (2, FINE) if least >= 1 else (GRID,):
        rows = np.flatnonzero(found)
        ends = _points(X_WB[rows], half, fineness) if least >= 1 else _grid(X_WC, X_WB[rows], half, fineness)
        found[rows] = rays.see(eye, ends, rows, least)
    return found


def _points(X_WB: Array, half: Array, count: int) -> Array:
    """A lattice of points on boxes, shape (m, n, 3); count: along each edge."""
    line = np.linspace(-1.0, 1.0, count)
    lattice = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    lattice = lattice[np.abs(lattice).max(axis=1) == 1.0] * half
    points: Array = np.einsum("mij,nj->mni", X_WB[:, :3, :3], lattice) + X_WB[:, None, :3, 3]
    return points


def _grid(X_WC: Array, X_WB: Array, half: Array, count: int) -> Array:
    """Where rays in count^2 even directions leave boxes, shape (m, n, 3); NaN for those that miss them."""
    corners = (_points(X_WB, half, 2) - X_WC[:3, 3]) @ X_WC[:3, :3]
    plane = corners[..., :2] / corners[..., 2:]
    low, high = plane.min(axis=1), plane.max(axis=1)
    share = (np.arange(count) + 0.5) / count
    cells = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    spots = low[:, None] + cells * (high - low)[:, None]
    rays = np.concatenate([spots, np.ones((*spots.shape[:2], 1))], axis=2) @ X_WC[:3, :3].T
    X_BW = inverse(X_WB)
    start = X_BW[:, :3, :3] @ X_WC[:3, 3] + X_BW[:, :3, 3]
    along = np.einsum("mij,mnj->mni", X_BW[:, :3, :3], rays)
    with np.errstate(divide="ignore"):
        slabs = np.stack([(-half - start[:, None]) / along, (half - start[:, None]) / along])
    enters, leaves = slabs.min(axis=0).max(axis=2), slabs.max(axis=0).min(axis=2)
    ends: Array = X_WC[:3, 3] + rays * np.where(enters < leaves, leaves, np.nan)[..., None]
    return ends
