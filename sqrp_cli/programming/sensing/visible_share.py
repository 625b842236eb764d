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

from sqrp_cli.geometry import Array, inverse, transform
from sqrp_cli.programming.sensing.contour import VertexImage, contour_tiles
from sqrp_cli.programming.sensing.directions import (
    CELLS_OF_TILE,
    GRID,
    TILE,
    TILES,
    DirectionGrid,
    Tile,
    exit_depths,
    take,
    tiles_of,
)
from sqrp_cli.programming.sensing.image_triangles import ImageTriangles
from sqrp_cli.programming.sensing.occlusion import Pairs, SolidPoses
from sqrp_cli.programming.solids import Solid

_FAR = 1e9
"""Depth that stands for no depth at all [m]."""

_BATCH = 2048
"""Pairs of triangle and tile whose cells are compared together: about what fits the cache."""

_CHUNK = 64
"""Sight lines that are sampled together, to bound the memory."""


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
    grid = DirectionGrid.over(image.min(axis=1), image.max(axis=1))
    leaves = exit_depths(X_CB, corners_B, grid)
    tiles = leaves.reshape(-1, TILES, TILE, TILES, TILE)
    count = (tiles > 0).sum(axis=(2, 4))
    depths = (np.where(tiles > 0, tiles, _FAR).min(axis=(2, 4)), tiles.max(axis=(2, 4)))
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


@dataclass(frozen=True, eq=False)
class _OnTiles:
    """What of a solid is before tiles.

    triangle, tile: pairs of a triangle and a tile of which it may block some directions. full: tiles of which the solid
    blocks every direction.
    """

    triangles: ImageTriangles
    triangle: NDArray[np.int64]
    tile: Tile
    full: Tile

    def block_cells(
        self, unknown: NDArray[np.bool_], grid: DirectionGrid, leaves: Array, blocked: NDArray[np.bool_]
    ) -> None:
        """Mark in `blocked` (l, GRID**2) the directions that the triangles block in the tiles that are unknown."""
        left = np.flatnonzero(unknown[self.tile])
        line, tile_u, tile_v = (index[left] for index in self.tile)
        origin = line * GRID**2 + (tile_u * GRID + tile_v) * TILE
        for start in range(0, len(left), _BATCH):
            batch = slice(start, start + _BATCH)
            cells = origin[batch, None] + CELLS_OF_TILE
            u, v, leave = (values.reshape(-1)[cells] for values in (grid.u, grid.v, leaves))
            blocked.reshape(-1)[cells[self.triangles.before(self.triangle[left[batch]], u, v, leave)]] = True


def _on_tiles(
    lines: NDArray[np.int64], X_CP: Array, solid: Solid, grid: DirectionGrid, depths: tuple[Array, Array]
) -> _OnTiles:
    """What of a solid is before which tiles of the sight lines `lines`.

    depths: least and greatest depth at which the directions of each tile leave the box, shape (l, TILES, TILES).

    Only triangles and tiles whose bounding rectangles in the image overlap are compared. In a tile that no contour of
    the solid crosses, as many layers of triangles lie on every direction, so that one direction tells of all. Arrays
    are kept per component: reductions over an axis of two or three are slow.
    """
    image = VertexImage.of(lines, X_CP, solid, grid)
    deepest = depths[1][lines].max(axis=(1, 2))
    row, face, rectangle = image.near(solid.triangles.T, deepest)
    triangles = ImageTriangles.of([image.points[:, row, solid.triangles[face, k]] for k in range(3)])
    triangle, tile = tiles_of(lines[row], rectangle)
    pairs = triangles.over_tiles(triangle, grid, tile, depths)

    crossed = np.zeros(depths[0].shape, dtype=bool)
    crossed[take(tile, pairs.some & ~pairs.in_front)] = True
    crossed[contour_tiles(image, solid, X_CP, grid, deepest)] = True
    quiet = ~crossed[tile]
    kept = np.flatnonzero(pairs.some & ~quiet)
    return _OnTiles(triangles, triangle[kept], take(tile, kept), take(tile, quiet & pairs.some & pairs.in_middle))
