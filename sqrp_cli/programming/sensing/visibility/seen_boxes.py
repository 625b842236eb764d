"""Boxes as cameras see them: their silhouettes, and what lies before their far sides."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, Indices, Mask, cross, inverse, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility import silhouette
from sqrp_cli.programming.sensing.visibility.hull_spaces import BOX_FACES
from sqrp_cli.shapes import BOX_TRIANGLES

_ROUNDING = 1e-9
"""Share by which the area of an image may be too large."""


BEFORE = np.uint16(0b11)
"""Bits of the regions before a box, see `SeenBoxes.regions`."""


_BOX = silhouette.Triangulation.of_triangles(BOX_SIGNS, BOX_TRIANGLES)


@dataclass(frozen=True, eq=False)
class SeenBoxes:
    """Boxes as cameras see them, one for each of h view hulls; optical frames are turned as the ray grids are."""

    X_CW: Array
    """The world in the optical frame, shape (h, 4, 4)."""
    X_BW: Array
    """The world in the box's frame, shape (h, 4, 4)."""
    X_CB: Array
    """The box in the optical frame, shape (h, 4, 4)."""
    eyes: Array
    """Camera centres in the boxes' frames, shape (h, 3) [m]."""
    nearest: Array
    """Least depth of each box, shape (h,) [m]."""
    low: Array
    """Least coordinates of each box in its own frame, shape (h, 3) [m]."""
    high: Array
    """Greatest coordinates of each box in its own frame, shape (h, 3) [m]."""
    grid: silhouette.RayGrid
    """The rays to each box."""
    areas: Array
    """Of the box's image, in cells of the grid, shape (h,)."""

    @classmethod
    def of(cls, lines: SightLines, hulls: Indices, margin: Array | None = None) -> SeenBoxes:
        """The views of some of the hulls of sight lines; margin: see `rays_around`."""
        X_WC, corners_W = lines.X_WC[hulls], lines.corners[hulls]
        X_CW = inverse(X_WC)
        corners_C = transform(X_CW, corners_W).transpose(2, 0, 1)
        X_CW = silhouette.turns(corners_C[:2] / corners_C[2]) @ X_CW
        corners_C = transform(X_CW, corners_W).transpose(2, 0, 1)
        image = corners_C[:2] / corners_C[2]
        X_BW = inverse(lines.X_WB[hulls])
        half, middle = lines.half_size[hulls], lines.offset[hulls]
        beyond = 0.0 if margin is None else margin[hulls]
        grid = silhouette.RayGrid.over(image.min(axis=-1) - beyond, image.max(axis=-1) + beyond)
        return cls(
            X_CW=X_CW,
            X_BW=X_BW,
            X_CB=X_CW @ lines.X_WB[hulls],
            eyes=transform(X_BW, X_WC[:, None, :3, 3])[:, 0],
            nearest=corners_C[2].min(axis=-1),
            low=middle - half,
            high=middle + half,
            grid=grid,
            areas=_image_areas(image / grid.step[..., None]),
        )

    def some(self, hulls: Indices) -> SeenBoxes:
        """Some of the views, by index."""
        arrays = {part.name: getattr(self, part.name)[hulls] for part in fields(self) if part.name != "grid"}
        return replace(self, **arrays, grid=silhouette.RayGrid(self.grid.low[:, hulls], self.grid.step[:, hulls]))

    @cached_property
    def maps(self) -> Array:
        """From the frames of the boxes, stretched to be from -1 to 1, into the grids, shape (3, 4, h)."""
        half, middle = 0.5 * (self.high - self.low), 0.5 * (self.high + self.low)
        X_BU = np.zeros_like(self.X_CB)
        X_BU[:, range(3), range(3)], X_BU[:, :3, 3], X_BU[:, 3, 3] = half, middle, 1.0
        return self.grid.maps(np.arange(len(half)), self.X_CB @ X_BU)

    @property
    def directions(self) -> Array:
        """Of the rays of the grids in the world, of any length, shape (COLUMNS, h, ROWS, 3)."""
        low, step = self.grid.low[..., None], self.grid.step[..., None]
        u = low[0] + step[0] * (np.arange(silhouette.COLUMNS)[:, None, None] + silhouette.SHIFT)
        v = np.broadcast_to(low[1] + step[1] * (np.arange(silhouette.ROWS) + 0.5), u.shape)
        return np.stack([u, v, np.ones_like(u)], axis=-1) @ self.X_CW[:, :3, :3]

    def bends(self) -> silhouette.Bends:
        """The silhouettes of the boxes, each stretched to be from -1 to 1."""
        sides = np.stack([self.eyes < self.low, self.eyes > self.high], axis=-1).reshape(-1, 6).T
        turned = silhouette.signs(np.repeat(sides, 2, axis=0))
        return silhouette.Bends.of(_BOX, turned, silhouette.beyond_sides(self.maps, 1.0), np.arange(len(self.eyes)))

    def surely_seen(self, hull: Indices, solids: SeenSolids, enough: Array) -> Mask:
        """Whether so little may block the rays of each of l lines that it sees enough; a no means nothing, shape (l,).

        hull: which of the views each line has, enough: the share that it must see, shape (l,).
        """
        if not (enough < 1.0).any():
            return np.zeros(len(hull), dtype=bool)
        # A row across a width of w cells holds at least w - 1 rays, and the widths add up to the area at least.
        least = self.areas[hull] - silhouette.ROWS
        blocked = np.bincount(solids.line, self.grid.most_rays(solids.maps, solids.corners), minlength=len(hull))
        return blocked < (1.0 - enough) * least * (1.0 - _ROUNDING)

    def regions(self, hull: Indices, points_B: Array, points_C: Array) -> NDArray[np.uint16]:
        """The convex regions in which points seen in k of the views lie, one bit each, shape (k, n).

        A triangle wholly in one of the first two, of the bits `BEFORE`, blocks the rays that it meets; wholly in any
        other region, it blocks none. points_B, points_C: in the frames of box and camera, shape (k, n, 3).
        """
        eyes, low, high = self.eyes[hull], self.low[hull], self.high[hull]
        depth = points_C[..., 2]
        ahead = depth > silhouette.AHEAD
        # Where the far faces lie on the axes; nothing is beyond a face that looks to the camera.
        low, high = np.where(eyes > low, low, -np.inf), np.where(eyes < high, high, np.inf)
        beyond = [points_B[..., axis] <= low[:, axis, None] for axis in range(3)]
        beyond += [points_B[..., axis] >= high[:, axis, None] for axis in range(3)]
        before = ahead & ~np.logical_or.reduce(beyond)
        beside = self.grid.beside(hull, points_C)
        masks = [ahead & (depth < self.nearest[hull, None]), before, ~ahead, *beyond, *beside]
        regions = np.zeros(depth.shape, dtype=np.uint16)
        for bit, mask in enumerate(masks):
            regions |= mask.astype(np.uint16) << np.uint16(bit)
        return regions

    def blocked(self, hull: Indices, corners: Array) -> silhouette.MetRays:
        """The rays that n triangles block before the far sides.

        By homogeneous edge functions a u + b v + c, all positive inside (M. Olano, T. Greer, 1997).

        hull: in which view each triangle is looked at, shape (n,). corners: in its optical frame, shape (3, 3, n),
        coordinate first.
        """
        edges = np.stack([cross(corners[:, k].T, corners[:, (k + 1) % 3].T).T for k in range(3)])
        volume = np.einsum("in,in->n", corners[:, 2], edges[0])
        edges, volume = edges * np.where(volume < 0, -1.0, 1.0), np.abs(volume)
        ahead = (corners[2] > 0).all(axis=0)
        v = corners[1] / np.where(ahead, corners[2], 1.0)
        v = np.where(ahead, (v.min(axis=0), v.max(axis=0)), [[-np.inf], [np.inf]])
        v = np.where(volume > 0, v, 0.0)  # a triangle seen edge-on blocks nothing
        return self.grid.inside(hull, v, np.concatenate([edges, self._before(hull, edges, volume)]))

    def _before(self, hull: Indices, edges: Array, volume: Array) -> Array:
        """Where the planes of n triangles are met before the far sides: functions a u + b v + c, positive there.

        The depth at which a ray meets a plane is `volume`, shape (n,), divided by the sum of the edge functions, shape
        (3, 3, n). Shape (3, 3, n), or (6, 3, n) where an eye lies between two sides, which then are both far ones;
        functions of sides that are none are positive everywhere.
        """
        eyes, low, high = self.eyes[hull].T[:, None], self.low[hull].T[:, None], self.high[hull].T[:, None]
        total, along = edges.sum(axis=0), volume * self.X_CB[hull, :3, :3].transpose(2, 1, 0)
        before_low, before_high = (eyes - low) * total + along, (high - eyes) * total - along
        one: Array = np.where(eyes > low, before_low, before_high)
        both = (eyes > low) & (eyes < high)
        if not both.any():
            return one
        return np.concatenate([one, np.where(both, before_high, np.array([[0.0], [0.0], [1.0]]))])


@dataclass(frozen=True, eq=False)
class SeenSolids:
    """Solids that may block the rays of sight lines: n pairs; optical frames as in `SeenBoxes`."""

    line: Indices
    """Of each, shape (n,)."""
    hull: Indices
    """Index of the line's view, shape (n,)."""
    solid: Indices
    """By index, shape (n,)."""
    X_WP: Array
    """Pose of the solid's parent in the world, shape (n, 4, 4)."""
    X_CP: Array
    """The same in the optical frame, shape (n, 4, 4)."""
    maps: Array
    """From the parent's frame into the grid, see `RayGrid.maps`, shape (3, 4, n)."""
    corners: Array
    """Corners of the box around the solid in its parent's frame, shape (n, 8, 3) [m]."""

    @classmethod
    def of(cls, view: SeenBoxes, hull: Indices, poses: SolidPoses, pairs: Pairs, state: Indices) -> SeenSolids:
        """The solids of pairs; hull: which of the views each line has, state: index of each pair's state."""
        at = hull[pairs.line]
        X_WP = poses.at(pairs.solid, state)
        X_CP = view.X_CW[at] @ X_WP
        return cls(
            line=pairs.line,
            hull=at,
            solid=pairs.solid,
            X_WP=X_WP,
            X_CP=X_CP,
            maps=view.grid.maps(at, X_CP),
            corners=poses.solids.corners[pairs.solid],
        )

    def of_lines(self, wanted: Mask, hull: Indices) -> SeenSolids:
        """Those of some of the lines, which are counted anew; hull: the new index of the view of each of these."""
        kept = wanted[self.line]
        line = (np.cumsum(wanted) - 1)[self.line[kept]]
        rest = {name: getattr(self, name)[kept] for name in ("solid", "X_WP", "X_CP", "corners")}
        return replace(self, line=line, hull=hull[line], maps=self.maps[:, :, kept], **rest)

    @property
    def eyes_P(self) -> NDArray[np.float32]:
        """Camera centres in the parents' frames, as `silhouette.facing` wants them, shape (4, n) [m]."""
        return inverse(self.X_CP)[:, :, 3].T.astype(np.float32)

    def reach_through(self, view: SeenBoxes) -> Mask:
        """Whether each may have triangles that reach through the far side of its box, shape (n,)."""
        depth = (self.corners @ self.X_CP[:, 2, :3, None])[..., 0] + self.X_CP[:, 2, 3, None]
        found: Mask = np.any((depth <= silhouette.AHEAD) | (depth >= view.nearest[self.hull, None]), axis=1)
        if found.any():
            rows = np.flatnonzero(found)
            regions = self.points(view, rows, self.corners[rows]).regions
            found[rows] = (np.bitwise_and.reduce(regions, axis=1) & BEFORE) == 0
        return found

    def points(self, view: SeenBoxes, rows: Indices, points_P: Array) -> SeenPoints:
        """Where m points of each of k solids are, by index; points_P: in the parents' frames, (m, 3) or (k, m, 3)."""
        hull, points_C = self.hull[rows], transform(self.X_CP[rows], points_P)
        points_B = transform(view.X_BW[hull] @ self.X_WP[rows], points_P)
        return SeenPoints(points_C, view.regions(hull, points_B, points_C))


class SeenPoints(NamedTuple):
    """m points of each of k solids, as seen."""

    optical: Array
    """In the optical frame, shape (k, m, 3) [m]."""
    regions: NDArray[np.uint16]
    """See `SeenBoxes.regions`, shape (k, m)."""


class SeenTriangles(NamedTuple):
    """Some triangles of a solid in k pairs of sight line and solid: n of them."""

    pair: Indices
    """Index of each one's pair, shape (n,)."""
    row: Indices
    """Its place among the k, shape (n,)."""
    triangle: Indices
    """Index of each, shape (n,)."""
    points: Array
    """The solid's in the optical frames, shape (k, V, 3) [m]."""
    triangles: Indices
    """The points of all triangles of the solid, by index, shape (F, 3)."""

    @classmethod
    def of(
        cls, pairs: Indices, surface: silhouette.Triangulation, seen: SeenPoints, may: Mask, turned: NDArray[np.int8]
    ) -> SeenTriangles:
        """Those that rays may meet first of the triangles that `may` block them, (k, F), in some pairs, by index, (k,).

        seen: the solid's points. turned: see `silhouette.facing`, without the last, (F, k).
        """
        if surface.is_convex:  # a ray that meets its back has met its front, unless the camera is inside
            front = turned.T > 0
            may = may & (front | ~front.any(axis=1, keepdims=True))
        row, triangle = np.nonzero(may)
        return cls(pair=pairs[row], row=row, triangle=triangle, points=seen.optical, triangles=surface.triangles)

    def of_pairs(self, wanted: Mask) -> SeenTriangles:
        """Those of some of all pairs."""
        kept = wanted[self.pair]
        return self._replace(pair=self.pair[kept], row=self.row[kept], triangle=self.triangle[kept])

    @property
    def corners_C(self) -> Array:
        """Of each, in the optical frame, coordinate first, shape (3, 3, n) [m]."""
        return np.moveaxis(self.points[self.row[:, None], self.triangles[self.triangle]], (2, 1), (0, 1))


def in_all(regions: NDArray[np.uint16], triangles: Indices) -> NDArray[np.uint16]:
    """The regions in which triangles (F, 3) lie wholly, from those of their corners (k, n), one bit each; (k, F)."""
    a, b, c = triangles.T
    return regions[:, a] & regions[:, b] & regions[:, c]


def _image_areas(image: Array) -> Array:
    """Areas of the images of boxes with these corners, shape (2, h, 8); shape (h,).

    Each ray through a box meets two of its faces.
    """
    first, second, third, fourth = (image[:, :, BOX_FACES[:, k]] for k in range(4))
    u, v = third - first, fourth - second
    areas: Array = 0.25 * np.abs(u[0] * v[1] - u[1] * v[0]).sum(axis=-1)
    return areas
