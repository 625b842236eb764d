"""The directions in which a camera looks at a box, in cells and tiles of the plane z = 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, inverse

GRID = 40
"""Cells along each side of the silhouette's bounding rectangle."""

TILES = 5
"""Tiles along each side of it; a triangle is compared with whole tiles before it is with the cells in them."""

TILE = GRID // TILES
"""Cells along each side of a tile."""

CELLS_OF_TILE = (np.arange(TILE)[:, None] * GRID + np.arange(TILE)).reshape(-1)
"""Indices of a tile's cells, from that of its first."""

_JITTER = np.random.default_rng(2021).random((2, GRID, GRID))

Tile = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
"""Sight line and place along u and v of tiles, by index."""


@dataclass(frozen=True, eq=False)
class DirectionGrid:
    """Sampled directions (u, v, 1) in the optical frames of l sight lines; cell (i, j) has index i * GRID + j.

    low: least u and v, shape (l, 2). step: size of a cell, shape (l, 2). u, v: shape (l, GRID**2).
    """

    low: Array
    step: Array
    u: Array
    v: Array

    @classmethod
    def over(cls, low: Array, high: Array) -> DirectionGrid:
        """The grid over rectangles from `low` to `high`, shape (l, 2) each."""
        step = (high - low) / GRID
        cells = np.arange(GRID)
        u = low[:, :1] + step[:, :1] * (cells[:, None] + _JITTER[0]).reshape(-1)
        v = low[:, 1:] + step[:, 1:] * (cells[None, :] + _JITTER[1]).reshape(-1)
        return cls(low, step, u, v)

    def tile(self, tile: Tile) -> tuple[Array, Array, Array, Array]:
        """Middle (u, v) and half the size along u and v of tiles, shape (n,) each."""
        line, tile_u, tile_v = tile
        half_u, half_v = (0.5 * TILE * self.step[line, axis] for axis in (0, 1))
        u, v = self.low[line, 0] + (2 * tile_u + 1) * half_u, self.low[line, 1] + (2 * tile_v + 1) * half_v
        return u, v, half_u, half_v


def exit_depths(X_CB: Array, corners_B: Array, grid: DirectionGrid) -> Array:
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


def tiles_of(line: NDArray[np.int64], rectangle: NDArray[np.int64]) -> tuple[NDArray[np.int64], Tile]:
    """Every tile of the rectangles (4, n): index of the rectangle, and line and place of the tile."""
    first_u, first_v, last_u, last_v = rectangle
    across = last_v - first_v + 1
    counts = (last_u - first_u + 1) * across
    shape = np.repeat(np.arange(len(line)), counts)
    within = np.arange(len(shape)) - np.repeat(np.cumsum(counts) - counts, counts)
    step_u, step_v = np.divmod(within, across[shape])
    return shape, (line[shape], first_u[shape] + step_u, first_v[shape] + step_v)


def take(tile: Tile, chosen: NDArray[Any]) -> Tile:
    """Some of the tiles."""
    line, tile_u, tile_v = tile
    return line[chosen], tile_u[chosen], tile_v[chosen]
