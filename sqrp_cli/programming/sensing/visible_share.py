"""How much of a box a camera sees: the share of its silhouette, by area in the undistorted image.

Directions are sampled on a grid of `GRID` x `GRID` cells over the silhouette's bounding rectangle in the plane z = 1,
one direction at a fixed pseudo-random place in each cell. A direction is blocked if a triangle lies on it before it
leaves the box. The error is about the standard deviation of the cells that an edge cuts, below 0.5 points typically and
2 points at worst.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross, inverse, transform
from sqrp_cli.programming.sensing.occlusion import Pairs, SolidPoses
from sqrp_cli.programming.solids import Solid

GRID = 40
"""Cells along each side of the silhouette's bounding rectangle."""

TILES = 5
"""Tiles along each side of it; a triangle is compared with whole tiles before it is with the cells in them."""

_TILE = GRID // TILES
_CELLS_OF_TILE = (np.arange(_TILE)[:, None] * GRID + np.arange(_TILE)).reshape(-1)

_SLACK = 1 + 1e-6
"""Factor on the size of tiles, far above the rounding of what is compared with their edges."""

_BATCH = 2048
"""Pairs of triangle and tile whose cells are compared together: about what fits the cache."""

_CHUNK = 64
"""Sight lines that are sampled together, to bound the memory."""

_JITTER = np.random.default_rng(2021).random((2, GRID, GRID))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Sampled directions (u, v, 1) in the optical frames of l sight lines; cell (i, j) has index i * GRID + j.

    low: least u and v, shape (l, 2). step: size of a cell, shape (l, 2). u, v: shape (l, GRID**2).
    """

    low: Array
    step: Array
    u: Array
    v: Array

    @classmethod
    def over(cls, low: Array, high: Array) -> _Grid:
        """The grid over rectangles from `low` to `high`, shape (l, 2) each."""
        step = (high - low) / GRID
        cells = np.arange(GRID)
        u = low[:, :1] + step[:, :1] * (cells[:, None] + _JITTER[0]).reshape(-1)
        v = low[:, 1:] + step[:, 1:] * (cells[None, :] + _JITTER[1]).reshape(-1)
        return cls(low, step, u, v)


def visible_shares(
    X_WC: Array,
    X_WB: Array,
    corners_B: Array,
    state: NDArray[np.int64],
    poses: SolidPoses,
    pairs: Pairs,
    enough: float | None = None,
) -> Array:
    """Visible share of each sight line's box, shape (v,).

    X_WC: pose of the optical frame, shape (v, 4, 4). X_WB: pose of the box, shape (v, 4, 4). corners_B: corners (8, 3)
    of the shrunk box in its own frame. state: index of the state of each sight line, shape (v,). pairs: (sight line,
    solid) that reach into the view hulls; nothing else can block. All corners must lie in front of the camera.
    enough: if given, a share is only looked at closely enough to tell whether it is at least that, and is otherwise an
    upper bound.
    """
    shares = np.empty(len(state))
    for start in range(0, len(state), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        inside = (pairs[0] >= start) & (pairs[0] < start + _CHUNK)
        here = (pairs[0][inside] - start, pairs[1][inside])
        shares[chunk] = _chunk_shares(X_WC[chunk], X_WB[chunk], corners_B, state[chunk], poses, here, enough)
    return shares


def _chunk_shares(
    X_WC: Array,
    X_WB: Array,
    corners_B: Array,
    state: NDArray[np.int64],
    poses: SolidPoses,
    pairs: Pairs,
    enough: float | None,
) -> Array:
    X_CW = inverse(X_WC)
    X_CB = X_CW @ X_WB
    corners_C = transform(X_CB, corners_B)
    image = corners_C[..., :2] / corners_C[..., 2:]
    grid = _Grid.over(image.min(axis=1), image.max(axis=1))
    leaves = _exit_depths(X_CB, corners_B, grid)
    tiles = leaves.reshape(-1, TILES, _TILE, TILES, _TILE)
    count = (tiles > 0).sum(axis=(2, 4))
    depths = (np.where(tiles > 0, tiles, np.inf).min(axis=(2, 4)), tiles.max(axis=(2, 4)))
    full, touched = np.zeros(count.shape, dtype=bool), np.zeros(count.shape, dtype=bool)
    found = []
    for index in np.unique(pairs[1]).tolist():
        lines = pairs[0][pairs[1] == index]
        X_WP = poses.pose(index)
        X_CP = X_CW[lines] @ X_WP[state[lines] if len(X_WP) > 1 else np.zeros_like(lines)]
        on_tiles = _on_tiles(lines, X_CP, poses.solids[index], grid, depths)
        full[on_tiles.full] = True
        touched[on_tiles.tile] = True
        found.append(on_tiles)

    total = np.maximum(count.sum(axis=(1, 2)), 1)
    most = np.where(full, 0, count).sum(axis=(1, 2)) / total
    least = np.where(full | touched, 0, count).sum(axis=(1, 2)) / total
    settled = np.zeros(len(total), dtype=bool) if enough is None else (least >= enough) | (most < enough)
    unknown = ~(full | settled[:, None, None])
    blocked = leaves <= 0
    blocked.reshape(tiles.shape)[...] |= full[:, :, None, :, None]
    for on_tiles in found:
        on_tiles.block_cells(unknown, grid, leaves, blocked)
    shares: Array = (~blocked).sum(axis=1) / total
    return shares


def _exit_depths(X_CB: Array, corners_B: Array, grid: _Grid) -> Array:
    """Optical z at which each direction leaves the box, shape (l, GRID**2).

    0 where it misses it (slab test in the box's axes).
    """
    X_BC = inverse(X_CB)
    low, high = corners_B.min(axis=0), corners_B.max(axis=0)
    enters, leaves = np.zeros_like(grid.u), np.full_like(grid.u, np.inf)
    for axis in range(3):
        R = X_BC[:, axis, :3, None]
        slope = R[:, 0] * grid.u + R[:, 1] * grid.v + R[:, 2]
        slope = np.where(np.abs(slope) < 1e-15, 1e-15, slope)
        eye = X_BC[:, axis, 3, None]
        first, second = (low[axis] - eye) / slope, (high[axis] - eye) / slope
        enters = np.maximum(enters, np.minimum(first, second))
        leaves = np.minimum(leaves, np.maximum(first, second))
    return np.where(enters <= leaves, leaves, 0.0)


@dataclass(frozen=True, eq=False)
class _OnTiles:
    """Triangles of a solid that may block some, but not all, directions of tiles.

    triangle: index of each pair's triangle. tile: its sight line and place of its tile along u and v. full: tiles of
    which some triangle blocks every direction, likewise.
    """

    triangles: _Triangles
    triangle: NDArray[np.int64]
    tile: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
    full: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]

    def block_cells(self, unknown: NDArray[np.bool_], grid: _Grid, leaves: Array, blocked: NDArray[np.bool_]) -> None:
        """Mark in `blocked` (l, GRID**2) the directions that the triangles block in the tiles that are unknown."""
        left = np.flatnonzero(unknown[self.tile])
        line, tile_u, tile_v = (index[left] for index in self.tile)
        origin = line * GRID**2 + (tile_u * GRID + tile_v) * _TILE
        for start in range(0, len(left), _BATCH):
            batch = slice(start, start + _BATCH)
            cells = origin[batch, None] + _CELLS_OF_TILE
            u, v, leave = (values.reshape(-1)[cells] for values in (grid.u, grid.v, leaves))
            blocked.reshape(-1)[cells[self.triangles.before(self.triangle[left[batch]], u, v, leave)]] = True


def _on_tiles(
    lines: NDArray[np.int64], X_CP: Array, solid: Solid, grid: _Grid, depths: tuple[Array, Array]
) -> _OnTiles:
    """What of a solid is before which tiles of the sight lines `lines`.

    depths: least and greatest depth at which the directions of each tile leave the box, shape (l, TILES, TILES).

    Only triangles and tiles whose bounding rectangles in the image overlap are compared; triangles that reach behind
    the camera have no bounded image and are compared with every tile. Arrays are kept per component: reductions over an
    axis of two or three are slow.
    """
    x, y, z = np.ascontiguousarray(np.moveaxis(transform(X_CP, solid.vertices), -1, 0))
    ahead = z > 1e-9
    safe = np.where(ahead, z, 1.0)
    corner = solid.triangles.T
    bounds = []
    for coordinate, axis in ((x, 0), (y, 1)):
        cell = (coordinate / safe - grid.low[lines, axis, None]) / grid.step[lines, axis, None]
        least, most = _extremes(np.where(ahead, cell, -1.0), corner)
        bounds.append((least, np.where(ahead[:, corner].all(axis=1), most, GRID)))
    nearest, farthest = _extremes(z, corner)
    reaches = (nearest < depths[1][lines].max(axis=(1, 2))[:, None]) & (farthest > 0)
    for least, most in bounds:
        reaches &= (most >= 0) & (least < GRID)
    row, face = np.nonzero(reaches)
    triangles = _Triangles.of([np.stack([axis[row, corner[k, face]] for axis in (x, y, z)]) for k in range(3)])
    first_u, first_v = (np.clip(least[row, face], 0, GRID - 1).astype(np.int64) // _TILE for least, _ in bounds)
    last_u, last_v = (np.clip(most[row, face], 0, GRID - 1).astype(np.int64) // _TILE for _, most in bounds)
    across = last_v - first_v + 1
    counts = (last_u - first_u + 1) * across
    triangle = np.repeat(np.arange(len(row)), counts)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
    step_u, step_v = np.divmod(within, across[triangle])
    tile = (lines[row][triangle], first_u[triangle] + step_u, first_v[triangle] + step_v)
    some, whole = triangles.over_tiles(triangle, grid, tile, depths)
    kept, full = np.flatnonzero(some & ~whole), np.flatnonzero(whole)
    line, tile_u, tile_v = tile
    return _OnTiles(
        triangles, triangle[kept], (line[kept], tile_u[kept], tile_v[kept]), (line[full], tile_u[full], tile_v[full])
    )


@dataclass(frozen=True, eq=False)
class _Triangles:
    """n triangles in an optical frame as homogeneous edge functions a u + b v + c, all positive inside.

    edges: a, b and c of each of the three edges, shape (3, 3, n). volume: by which the sum of the edge functions is to
    be divided to get 1 / z, shape (n,).
    """

    edges: Array
    volume: Array

    @classmethod
    def of(cls, corners: list[Array]) -> _Triangles:
        """Triangles of three corners, shape (3, n) each."""
        p = [corner.T for corner in corners]
        edges = np.stack([cross(p[k], p[(k + 1) % 3]).T for k in range(3)])
        volume = np.einsum("tn,tn->n", corners[2], edges[0])
        sign = np.where(volume < 0, -1.0, 1.0)
        return cls(edges * sign, volume * sign)

    def over_tiles(
        self,
        triangle: NDArray[np.int64],
        grid: _Grid,
        tile: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
        depths: tuple[Array, Array],
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """For each pair of a triangle and a tile, whether the triangle may block some directions and does block all."""
        line, tile_u, tile_v = tile
        half_u, half_v = (0.5 * _TILE * grid.step[line, axis] for axis in (0, 1))
        u = grid.low[line, 0] + (2 * tile_u + 1) * half_u
        v = grid.low[line, 1] + (2 * tile_v + 1) * half_v
        soonest, latest = (depth[tile] for depth in depths)
        some, whole = latest > 0, np.ones(len(line), dtype=bool)
        least, most = np.zeros(len(line)), np.zeros(len(line))
        for a, b, c in self.edges[:, :, triangle]:
            middle, reach = a * u + b * v + c, _SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
            some &= middle >= -reach
            whole &= middle > reach
            least += middle - reach
            most += middle + reach
        volume = self.volume[triangle]
        some &= volume <= most * latest
        whole &= some & (volume > 0) & (volume < least * soonest)
        return some, whole

    def before(self, triangle: NDArray[np.int64], u: Array, v: Array, leaves: Array) -> NDArray[np.bool_]:
        """Whether each triangle lies on its directions (u, v, 1), shape (n, k) each, before they leave the box.

        By homogeneous edge functions (Olano and Greer 1997). leaves: depths, shape (n, k).
        """
        inside, total = np.ones(u.shape, dtype=bool), np.zeros(u.shape)
        for a, b, c in self.edges[:, :, triangle, None]:
            side = a * u + b * v + c
            inside &= side >= 0
            total += side
        depth = self.volume[triangle, None] / np.where(total > 0, total, np.inf)
        return inside & (depth > 0) & (depth < leaves)


def _extremes(values: Array, corner: NDArray[np.int64]) -> tuple[Array, Array]:
    """Least and greatest of a value (l, V) over the corners (3, F) of each triangle, shape (l, F) each."""
    a, b, c = (values[:, corner[k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
