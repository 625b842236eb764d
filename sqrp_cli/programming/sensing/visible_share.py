"""How much of a box a camera sees: the share of its silhouette, by area in the undistorted image.

Rays run on a grid over the silhouette (`ray_grid`). A ray is blocked if a triangle lies on it before it leaves the box.
Triangles that lie wholly before the box's far side block what their common outline winds around: layers of triangles
that hang together need not be looked at one by one, and what is left of a closed mesh is the edges at which it turns
away from the camera. Only triangles that reach through the far side are compared with single rays.

The error is that of counting rays: at most half a row, 0.8 points, for an edge that runs along the rows all across the
silhouette; far less for others, of which every row measures another place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, transform
from sqrp_cli.programming.sensing.occlusion import Pairs, SolidPoses
from sqrp_cli.programming.sensing.ray_grid import Outline, RayGrid, first_row, turns
from sqrp_cli.programming.sensing.scene import rows_of
from sqrp_cli.programming.sensing.surface import Surface
from sqrp_cli.programming.solids import BOX_TRIANGLES

_CHUNK = 256
"""Sight lines that are sampled together at most."""

_MEMORY = 2_000_000
"""Triangles, each counted for each sight line, that are looked at together at most, to bound the memory."""

_AHEAD = 1e-6
"""Depth from which on a point counts as in front of the camera [m]."""

Mask = NDArray[np.bool_]


def visible_shares(
    X_WC: Array,
    X_WB: Array,
    corners_B: Array,
    hull: NDArray[np.int64],
    state: NDArray[np.int64],
    poses: SolidPoses,
    pairs: Pairs,
) -> Array:
    """Visible share of each sight line's box, shape (v,).

    X_WC: pose of the optical frame, shape (h, 4, 4). X_WB: pose of the box, shape (h, 4, 4). corners_B: corners (8, 3)
    of the shrunk box in its own frame. hull: which of those two each sight line has, shape (v,). state: index of the
    state of each, shape (v,). pairs: (sight line, solid) that reach into the view hulls; nothing else can block. All
    corners must lie in front of the camera.
    """
    shares = np.empty(len(state))
    largest = max((len(poses.solids[index].triangles) for index in set(pairs[1].tolist())), default=0)
    size = max(1, min(_CHUNK, _MEMORY // max(1, largest)))
    for start in range(0, len(state), size):
        chunk = slice(start, start + size)
        inside = (pairs[0] >= start) & (pairs[0] < start + size)
        used, of = np.unique(hull[chunk], return_inverse=True)
        view = _View.of(X_WC[used], X_WB[used], corners_B).repeated(of)
        shares[chunk] = _shares(view, state[chunk], poses, (pairs[0][inside] - start, pairs[1][inside]))
    return shares


def _shares(view: _View, state: NDArray[np.int64], poses: SolidPoses, pairs: Pairs) -> Array:
    line, which = pairs
    solids = {index: np.flatnonzero(which == index) for index in np.unique(which).tolist()}
    X_WP, corners_P = np.empty((len(line), 4, 4)), np.empty((len(line), 8, 3))
    for index, rows in solids.items():
        X_WP[rows], corners_P[rows] = rows_of(poses.pose(index), state[line[rows]]), poses.solids[index].corners
    X_BP = inverse(view.X_WB)[line] @ X_WP
    eyes_P = transform(inverse(X_BP), view.eyes[line, None])[:, 0]
    maps = view.grid.maps(line, view.X_CB[line] @ X_BP)
    all_before = view.places(line, transform(X_BP, corners_P)).all_before()

    outlines, blocked = [], np.zeros(view.silhouette.shape, dtype=bool)
    for index, rows in solids.items():
        surface = Surface.of(poses.solids[index])
        facing = _facing(surface, eyes_P[rows])
        doubtful = np.flatnonzero(~all_before[rows])
        if len(doubtful):
            lines = line[rows[doubtful]]
            points_B = transform(X_BP[rows[doubtful]], surface.vertices)
            before, beyond = view.places(lines, points_B).of(surface.triangles)
            facing[:-1, doubtful] *= before.T
            row, triangle = np.nonzero(~before & ~beyond)
            corners_B = np.moveaxis(points_B[row[:, None], surface.triangles[triangle]], (2, 1), (0, 1))
            view.mark(lines[row], corners_B, blocked)
        outlines.append(_outline(line[rows], maps[:, :, rows], surface, facing))
    blocked |= view.grid.inside(Outline.joined(outlines))
    seen, all_rays = _count(view.silhouette & ~blocked), _count(view.silhouette)
    return np.where(all_rays > 0, seen / np.maximum(all_rays, 1), 1.0)  # nothing hides what has no area in the image


@lru_cache(maxsize=256)
def _box_surface(*bounds: float) -> Surface:
    """The surface of a box from its least x, y, z to its greatest."""
    low, high = np.split(np.array(bounds), 2)
    return Surface.of_triangles(np.where(BOX_SIGNS < 0, low, high), BOX_TRIANGLES)


@dataclass(frozen=True, eq=False)
class _View:
    """Boxes as l sight lines see them.

    X_WB: pose of each box, shape (l, 4, 4). X_CB: in its (turned) optical frame, shape (l, 4, 4). eyes: camera centres
    in the boxes' frames, shape (l, 3). nearest: least depth of each box, shape (l,). low, high: where the box's far
    faces lie on its axes, shape (l, 3) each; infinite where the face on that side looks to the camera. silhouette: rays
    that meet the box, shape (COLUMNS, l, ROWS).
    """

    X_WB: Array
    X_CB: Array
    eyes: Array
    nearest: Array
    low: Array
    high: Array
    grid: RayGrid
    silhouette: Mask

    @classmethod
    def of(cls, X_WC: Array, X_WB: Array, corners_B: Array) -> _View:
        X_CB = inverse(X_WC) @ X_WB
        corners_C = np.moveaxis(transform(X_CB, corners_B), -1, 0)
        X_CB = turns(corners_C[:2] / corners_C[2]) @ X_CB
        corners_C = np.moveaxis(transform(X_CB, corners_B), -1, 0)
        image = corners_C[:2] / corners_C[2]
        grid = RayGrid.over(image.min(axis=-1), image.max(axis=-1))
        eye_B = inverse(X_CB)[:, :3, 3]
        low, high = corners_B.min(axis=0), corners_B.max(axis=0)
        far = np.where(eye_B > low, low, -np.inf), np.where(eye_B < high, high, np.inf)
        box, lines = _box_surface(*low.tolist(), *high.tolist()), np.arange(len(X_CB))
        outline = _outline(lines, grid.maps(lines, X_CB), box, _facing(box, eye_B))
        return cls(X_WB, X_CB, eye_B, corners_C[2].min(axis=-1), *far, grid, grid.inside(outline))

    def repeated(self, of: NDArray[np.int64]) -> _View:
        """Some of them, or some more than once: those of the given indices, shape (n,)."""
        return _View(
            X_WB=self.X_WB[of],
            X_CB=self.X_CB[of],
            eyes=self.eyes[of],
            nearest=self.nearest[of],
            low=self.low[of],
            high=self.high[of],
            grid=self.grid.repeated(of),
            silhouette=self.silhouette[:, of],
        )

    def places(self, lines: NDArray[np.int64], points_B: Array) -> _Places:
        """Where points (k, n, 3) lie that k of the sight lines see."""
        X_CB = self.X_CB[lines]
        depth = (points_B @ X_CB[:, 2, :3, None])[..., 0] + X_CB[:, 2, 3, None]
        ahead = depth > _AHEAD
        beyond = [
            side
            for axis in range(3)
            for side in (
                points_B[..., axis] <= self.low[lines, axis, None],
                points_B[..., axis] >= self.high[lines, axis, None],
            )
        ]
        nearer = ahead & (depth < self.nearest[lines, None])
        return _Places((nearer, ahead & ~np.logical_or.reduce(beyond)), (~ahead, *beyond))

    def mark(self, line: NDArray[np.int64], corners_B: Array, blocked: Mask) -> None:
        """Mark in `blocked` (COLUMNS, l, ROWS) the rays that n triangles block before the far sides.

        corners_B: shape (3, 3, n), coordinate first.
        """
        R, t = self.X_CB[line, :3, :3], self.X_CB[line, :3, 3]
        corners = np.einsum("nij,jkn->ikn", R, corners_B) + t.T[:, None]
        touching = self.grid.may_hold(line, corners)
        hits = self.grid.hits(line[touching], corners[:, :, touching])
        line = line[touching][hits.triangle]
        u, v = self.grid.rays(line, hits.row, hits.column)
        ray_C = np.stack([u, v, np.ones(len(u))], axis=-1)
        point_B = self.eyes[line] + hits.depth[:, None] * (ray_C[:, None] @ self.X_CB[line, :3, :3])[:, 0]
        blocks = ((point_B > self.low[line]) & (point_B < self.high[line])).all(axis=1)
        blocked[hits.column[blocks], line[blocks], hits.row[blocks]] = True


@dataclass(frozen=True, eq=False)
class _Places:
    """Where points lie that cameras see, each mask of shape (k, n).

    What lies wholly in one of the convex regions `before` blocks the rays that it meets; what lies wholly in one of the
    convex regions `beyond` blocks none.
    """

    before: tuple[Mask, ...]
    beyond: tuple[Mask, ...]

    def all_before(self) -> Mask:
        """Whether all points of a row lie in one of the regions before, shape (k,)."""
        before: Mask = np.logical_or.reduce([mask.all(axis=1) for mask in self.before])
        return before

    def of(self, triangles: NDArray[np.int64]) -> tuple[Mask, Mask]:
        """Which triangles (F, 3) over the points lie wholly in one region before, or beyond, shape (k, F) each."""
        a, b, c = triangles.T
        whole, none = (
            np.logical_or.reduce([mask[:, a] & mask[:, b] & mask[:, c] for mask in masks])
            for masks in (self.before, self.beyond)
        )
        return whole, none


def _count(rays: Mask) -> Array:
    """How many rays of each sight line are marked, shape (l,)."""
    # First over the columns, in small numbers: an ordinary sum is several times slower.
    count: Array = np.add.reduce(rays.view(np.uint8), axis=0, dtype=np.uint8).sum(axis=1, dtype=float)
    return count


def _facing(surface: Surface, eye: Array) -> NDArray[np.int8]:
    """1 where an eye (k, 3) is in front of a triangle and -1 where not, shape (F + 1, k); 0 for no triangle."""
    facing = np.zeros((len(surface.normals) + 1, len(eye)), dtype=np.int8)
    facing[:-1] = 2 * (surface.normals @ eye.T > surface.offsets[:, None]).view(np.int8) - 1
    return facing


def _outline(lines: NDArray[np.int64], maps: Array, surface: Surface, facing: NDArray[np.int8]) -> Outline:
    """The edges between triangles that face different ways, each triangle taken as if it faced the camera.

    maps: from the surface's frame into the grids of the sight lines, shape (3, 4, k).
    """
    # Vertex by vertex, so that edges which share an end give it the same row to the last bit.
    column, row, depth = surface.vertices @ maps[:, :3] + maps[:, 3:]
    depth = np.maximum(depth, _AHEAD)  # what lies behind the camera belongs to no triangle that counts
    column, row = column / depth, row / depth
    whole_row = first_row(row)

    left, right = facing[surface.left], facing[surface.right]
    bends = np.flatnonzero(left != right)
    weight = left.take(bends) - right.take(bends)
    edge, view = np.divmod(bends, len(lines))
    start, end = (vertices[edge] * len(lines) + view for vertices in (surface.start, surface.end))
    crossing = whole_row.take(start) != whole_row.take(end)
    crossing &= np.maximum(column.take(start), column.take(end)) > 0.0  # others have no ray before them
    start, end = start[crossing], end[crossing]
    first, last = (np.stack([column.take(at), row.take(at)]) for at in (start, end))
    return Outline(lines[view[crossing]], first, last, weight[crossing])
