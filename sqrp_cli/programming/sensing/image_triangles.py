"""Triangles as a camera sees them, compared with tiles and with single directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, cross
from sqrp_cli.programming.sensing.directions import DirectionGrid, Tile

SLACK = 1 + 1e-6
"""Factor on the size of tiles, far above the rounding of what is compared with their edges."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Pairs of a triangle and a tile, shape (n,) each.

    some: whether the triangle may block any direction of the tile. in_front: whether its plane, over the whole tile, is
    nearer than where any direction leaves the box. in_middle: whether it lies on the direction of the tile's middle.
    """

    some: NDArray[np.bool_]
    in_front: NDArray[np.bool_]
    in_middle: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ImageTriangles:
    """n triangles in an optical frame as homogeneous edge functions a u + b v + c, all positive inside.

    edges: a, b and c of each of the three edges, shape (3, 3, n). volume: by which the sum of the edge functions is to
    be divided to get 1 / z, shape (n,).
    """

    edges: Array
    volume: Array

    @classmethod
    def of(cls, corners: list[Array]) -> ImageTriangles:
        """Triangles of three corners, shape (3, n) each."""
        p = [corner.T for corner in corners]
        edges = np.stack([cross(p[k], p[(k + 1) % 3]).T for k in range(3)])
        volume = np.einsum("tn,tn->n", corners[2], edges[0])
        sign = np.where(volume < 0, -1.0, 1.0)
        return cls(edges * sign, volume * sign)

    def over_tiles(
        self, triangle: NDArray[np.int64], grid: DirectionGrid, tile: Tile, depths: tuple[Array, Array]
    ) -> Overlaps:
        """How each pair of a triangle and a tile lie to each other."""
        u, v, half_u, half_v = grid.tile(tile)
        soonest, latest = (depth[tile] for depth in depths)
        some, in_middle = latest > 0, np.ones(len(u), dtype=bool)
        for a, b, c in self.edges[:, :, triangle]:
            middle, reach = a * u + b * v + c, SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
            some &= middle >= -reach
            in_middle &= middle >= 0
        a, b, c = self.edges.sum(axis=0)[:, triangle]
        middle, reach = a * u + b * v + c, SLACK * (np.abs(a) * half_u + np.abs(b) * half_v)
        volume = self.volume[triangle]
        some &= volume <= (middle + reach) * latest
        return Overlaps(some, (volume > 0) & (volume < (middle - reach) * soonest), in_middle)

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
