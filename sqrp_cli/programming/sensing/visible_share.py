"""How much of a box a camera sees: the share of its silhouette, by area in the undistorted image.

Directions are sampled on a grid of `GRID` x `GRID` cells over the silhouette's bounding rectangle in the plane z = 1,
one direction at a fixed pseudo-random place in each cell. A direction is blocked if a triangle lies on it before it
leaves the box. The error is about the standard deviation of the cells that an edge cuts, below 0.5 points typically and
2 points at worst.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

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

_FAR = 1e9
"""Depth that stands for no depth at all [m]."""

_BATCH = 2048
"""Pairs of triangle and tile whose cells are compared together: about what fits the cache."""

_CHUNK = 64
"""Sight lines that are sampled together, to bound the memory."""

Tile = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
"""Sight line and place along u and v of tiles, by index."""

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

    def tile(self, tile: Tile) -> tuple[Array, Array, Array, Array]:
        """Middle (u, v) and half the size along u and v of tiles, shape (n,) each."""
        line, tile_u, tile_v = tile
        half_u, half_v = (0.5 * _TILE * self.step[line, axis] for axis in (0, 1))
        u, v = self.low[line, 0] + (2 * tile_u + 1) * half_u, self.low[line, 1] + (2 * tile_v + 1) * half_v
        return u, v, half_u, half_v


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
    """What of a solid is before tiles.

    triangle, tile: pairs of a triangle and a tile of which it may block some directions. full: tiles of which the solid
    blocks every direction.
    """

    triangles: _Triangles
    triangle: NDArray[np.int64]
    tile: Tile
    full: Tile

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

    Only triangles and tiles whose bounding rectangles in the image overlap are compared. In a tile that no contour of
    the solid crosses, as many layers of triangles lie on every direction, so that one direction tells of all. Arrays
    are kept per component: reductions over an axis of two or three are slow.
    """
    image = _Image.of(lines, X_CP, solid, grid)
    deepest = depths[1][lines].max(axis=(1, 2))
    row, face, rectangle = image.near(solid.triangles.T, deepest)
    triangles = _Triangles.of([image.points[:, row, solid.triangles[face, k]] for k in range(3)])
    triangle, tile = _spread(lines[row], rectangle)
    pairs = triangles.over_tiles(triangle, grid, tile, depths)

    crossed = np.zeros(depths[0].shape, dtype=bool)
    crossed[_take(tile, pairs.some & ~pairs.in_front)] = True
    crossed[_contour_tiles(image, solid, X_CP, grid, deepest)] = True
    quiet = ~crossed[tile]
    kept = np.flatnonzero(pairs.some & ~quiet)
    return _OnTiles(triangles, triangle[kept], _take(tile, kept), _take(tile, quiet & pairs.some & pairs.in_middle))


@dataclass(frozen=True, eq=False)
class _Image:
    """The vertices of a solid as l sight lines see them.

    lines: index of each sight line in the grid. points: in the optical frames, shape (3, l, V). ahead: whether in front
    of the camera, shape (l, V). cells: image coordinates in cells of the grid, shape (2, l, V).
    """

    lines: NDArray[np.int64]
    points: Array
    ahead: NDArray[np.bool_]
    cells: Array

    @classmethod
    def of(cls, lines: NDArray[np.int64], X_CP: Array, solid: Solid, grid: _Grid) -> _Image:
        """The image of a solid whose parent is at X_CP (l, 4, 4) in the optical frames."""
        points = np.ascontiguousarray(np.moveaxis(transform(X_CP, solid.vertices), -1, 0))
        ahead = points[2] > 1e-9
        plane = points[:2] / np.where(ahead, points[2], 1.0)
        low, step = grid.low[lines].T[..., None], grid.step[lines].T[..., None]
        return cls(lines, points, ahead, np.where(ahead, (plane - low) / step, -1.0))

    def near(
        self, corner: NDArray[np.int64], deepest: Array
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Sight line and shape of the pairs of which the bounding rectangle overlaps the grid, and that rectangle.

        corner: vertices of triangles or edges, shape (3 or 2, n). deepest: depth beyond which nothing matters, shape
        (l,). The rectangle is that of the tiles from (u, v) to (u, v), shape (4, pairs); it is everything for shapes
        that reach behind the camera, which have no bounded image.
        """
        nearest, farthest = _extremes(self.points[2], corner)
        close = (nearest < deepest[:, None]) & (farthest > 0)
        ahead = np.logical_and.reduce([self.ahead[:, vertices] for vertices in corner])
        bounds = []
        for cells in self.cells:
            least, most = _extremes(cells, corner)
            most = np.where(ahead, most, GRID)
            close &= (most >= 0) & (least < GRID)
            bounds.append((least, most))
        row, shape = np.nonzero(close)
        edges = np.stack([bounds[axis][end][row, shape] for end in (0, 1) for axis in (0, 1)])
        return row, shape, np.clip(edges, 0, GRID - 1).astype(np.int64) // _TILE


def _spread(line: NDArray[np.int64], rectangle: NDArray[np.int64]) -> tuple[NDArray[np.int64], Tile]:
    """Every tile of the rectangles (4, n): index of the rectangle, and line and place of the tile."""
    first_u, first_v, last_u, last_v = rectangle
    across = last_v - first_v + 1
    counts = (last_u - first_u + 1) * across
    shape = np.repeat(np.arange(len(line)), counts)
    within = np.arange(len(shape)) - np.repeat(np.cumsum(counts) - counts, counts)
    step_u, step_v = np.divmod(within, across[shape])
    return shape, (line[shape], first_u[shape] + step_u, first_v[shape] + step_v)


def _take(tile: Tile, chosen: NDArray[Any]) -> Tile:
    line, tile_u, tile_v = tile
    return line[chosen], tile_u[chosen], tile_v[chosen]


def _contour_tiles(image: _Image, solid: Solid, X_CP: Array, grid: _Grid, deepest: Array) -> Tile:
    """Tiles that a contour edge may cross: one whose triangles face different ways, or that has not just two."""
    surface = _Surface.of(solid)
    eye_P = inverse(X_CP)[:, :3, 3]
    facing = eye_P @ surface.normals.T > surface.offsets
    bends = facing[:, surface.faces[0]] != facing[:, surface.faces[1]]
    line, edge = np.nonzero(bends | surface.open)
    # One row per sight line and contour edge from here on.
    ends = surface.ends[:, edge]
    here = _Image(
        image.lines[line],
        np.stack([image.points[:, line, end] for end in ends], axis=-1),
        np.stack([image.ahead[line, end] for end in ends], axis=-1),
        np.stack([image.cells[:, line, end] for end in ends], axis=-1),
    )
    row, _, rectangle = here.near(np.array([[0], [1]]), deepest[line])
    shape, tile = _spread(here.lines[row], rectangle)
    a, b, c = cross(here.points[:, row, 0].T, here.points[:, row, 1].T)[shape].T
    u, v, half_u, half_v = grid.tile(tile)
    touches = np.abs(a * u + b * v + c) <= _SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
    return _take(tile, touches)


@dataclass(frozen=True, eq=False)
class _Surface:
    """How the triangles of a solid hang together.

    normals, offsets: n . p > o for points p in front of each triangle, shapes (F, 3) and (F,). ends: vertices of each
    edge, shape (2, E). faces: the two triangles at each edge, shape (2, E). open: edges that do not join just two
    triangles of like orientation, shape (E,).
    """

    normals: Array
    offsets: Array
    ends: NDArray[np.int64]
    faces: NDArray[np.int64]
    open: NDArray[np.bool_]

    @staticmethod
    @cache
    def of(solid: Solid) -> _Surface:
        """The surface of a solid; vertices in the same place count as one."""
        vertices, triangles = solid.vertices, solid.triangles
        rounded = np.round(vertices, 9)
        order = np.lexsort(rounded.T)
        place = np.empty(len(vertices), dtype=np.int64)
        place[order] = np.cumsum(np.any(np.diff(rounded[order], axis=0, prepend=np.nan) != 0, axis=1))
        start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
        first, second = place[start], place[end]
        key = np.minimum(first, second) * (len(vertices) + 1) + np.maximum(first, second)
        order = np.argsort(key, kind="stable")
        _, begin, count = np.unique(key[order], return_index=True, return_counts=True)
        one, other = order[begin], order[begin + count - 1]
        p = [vertices[triangles[:, k]] for k in range(3)]
        normals = cross(p[1] - p[0], p[2] - p[0])
        return _Surface(
            normals,
            np.einsum("fi,fi->f", normals, p[0]),
            np.stack([start[one], end[one]]),
            np.stack([one // 3, other // 3]),
            (count != 2) | (first[one] == first[other]),
        )


@dataclass(frozen=True, eq=False)
class _Overlaps:
    """Pairs of a triangle and a tile, shape (n,) each.

    some: whether the triangle may block any direction of the tile. in_front: whether its plane, over the whole tile, is
    nearer than where any direction leaves the box. in_middle: whether it lies on the direction of the tile's middle.
    """

    some: NDArray[np.bool_]
    in_front: NDArray[np.bool_]
    in_middle: NDArray[np.bool_]


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
        self, triangle: NDArray[np.int64], grid: _Grid, tile: Tile, depths: tuple[Array, Array]
    ) -> _Overlaps:
        """How each pair of a triangle and a tile lie to each other."""
        u, v, half_u, half_v = grid.tile(tile)
        soonest, latest = (depth[tile] for depth in depths)
        some, in_middle = latest > 0, np.ones(len(u), dtype=bool)
        for a, b, c in self.edges[:, :, triangle]:
            middle, reach = a * u + b * v + c, _SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
            some &= middle >= -reach
            in_middle &= middle >= 0
        a, b, c = self.edges.sum(axis=0)[:, triangle]
        middle, reach = a * u + b * v + c, _SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
        volume = self.volume[triangle]
        some &= volume <= (middle + reach) * latest
        return _Overlaps(some, (volume > 0) & (volume < (middle - reach) * soonest), in_middle)

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
    """Least and greatest of a value (l, V) over the corners (k, n) of each shape, shape (l, n) each."""
    found = [values[:, vertices] for vertices in corner]
    return np.minimum.reduce(found), np.maximum.reduce(found)
