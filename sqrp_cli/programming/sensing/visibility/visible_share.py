"""How much of a box a camera sees: the share of its silhouette, by area in the undistorted image.

Rays run on a grid over the silhouette (`RayGrid`). A ray is blocked if a triangle lies on it before it leaves the box.
Triangles wholly in front of the box's far side block the rays that their common outline winds around: connected
triangles need not be tested one by one, and of a closed mesh only the edges between front and back matter. Only
triangles that reach through the far side are compared with single rays.

The error is that of counting rays: at most half a row, 0.8 points, for an edge along the rows across the whole
silhouette; far less for others, which every row measures at another place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import BOX_SIGNS, Array, Indices, Mask, begins_run, cross, inverse, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import BOX_FACES
from sqrp_cli.programming.sensing.visibility.silhouette import (
    AHEAD,
    ROWS,
    Bends,
    MetRays,
    RayGrid,
    Silhouette,
    beyond_sides,
    facing,
    signs,
    turns,
)
from sqrp_cli.programming.sensing.visibility.triangulation import Triangulation
from sqrp_cli.shapes import BOX_TRIANGLES

_CHUNK = 1024
"""Most sight lines to sample together."""

_MEMORY = 2_000_000
"""Most triangles, counted for each sight line, to test together, to bound the memory."""

_ROUNDING = 1e-9
"""Share by which the area of an image may be too large."""

BEFORE = np.uint16(0b11)
"""Bits of the regions before a box, see `SeenBoxes.regions`."""

_BOX = Triangulation.of_triangles(BOX_SIGNS, BOX_TRIANGLES)


class VisibleShares(NamedTuple):
    """The visible shares of the boxes of n sight lines."""

    line: Indices
    """Index of the sight line, shape (n,)."""
    share: Array
    """Visible share of the box's silhouette, in 0..1, shape (n,)."""


def visible_shares(lines: SightLines, poses: SolidPoses, pairs: Pairs, *, enough: Array | None = None) -> VisibleShares:
    """The visible shares of the boxes of the sight lines in the pairs.

    pairs: of solids that may reach into the view hulls; no other solid can block. All corners of the boxes must lie in
    front of the camera. The share is 0 if the pose of box or camera is not finite. enough: for each of the v sight
    lines, what the share is compared with, where it need not be exact: if it is that much, it may be 1 instead; if it
    is less, any other share that is less too.
    """
    named = pairs.line[begins_run(pairs.line)]
    finite, shares = lines.finite[lines.hull[named]], np.zeros(len(named))
    pairs = pairs.some(lines.finite[lines.hull[pairs.line]])
    shares[finite] = _measured(lines, poses, pairs, np.full(len(lines.state), np.nan) if enough is None else enough)
    return VisibleShares(named, shares)


def _measured(lines: SightLines, poses: SolidPoses, pairs: Pairs, enough: Array) -> Array:
    """The visible shares of the boxes of the sight lines in the pairs, shape (n,)."""
    start, shares = 0, np.ones(np.count_nonzero(begins_run(pairs.line)))
    for view, hull, solids, named in _views(lines, poses, pairs):
        least = enough[named]
        doubtful = ~view.surely_seen(hull, solids, least)
        if not doubtful.all():
            used, hull = np.unique(hull[doubtful], return_inverse=True)
            view, solids = view.some(used), solids.of_lines(doubtful, hull)
        if doubtful.any():
            shares[start + np.flatnonzero(doubtful)] = _rays(view, hull, poses, solids, least[doubtful]).shares
        start += len(named)
    return shares


class _Views(NamedTuple):
    """Some sight lines with all that may block their rays."""

    view: SeenBoxes
    hull: Indices
    """Which of the views each line has, shape (l,)."""
    solids: _SeenSolids
    line: Indices
    """Index of each line, shape (l,)."""


def _views(lines: SightLines, poses: SolidPoses, pairs: Pairs, margin: Array | None = None) -> Iterator[_Views]:
    """The sight lines in the pairs, as many at a time as fit the memory; margin: see `rays_around`."""
    begins = begins_run(pairs.line)
    named, number = pairs.line[begins], np.cumsum(begins) - 1
    largest = max((len(poses.solids[index].triangles) for index in set(pairs.solid.tolist())), default=0)
    size = max(1, min(_CHUNK, _MEMORY // max(1, largest)))
    for start in range(0, len(named), size):
        chunk = slice(start, start + size)
        within = slice(*np.searchsorted(number, (start, start + size)).tolist())
        hull, state = lines.hull[named[chunk]], lines.state[named[chunk]]
        begins = begins_run(hull)
        view, hull = SeenBoxes.of(lines, hull[begins], margin), np.cumsum(begins) - 1
        here = Pairs(number[within] - start, pairs.solid[within])
        yield _Views(view, hull, _SeenSolids.of(view, hull, poses, here, state[here.line]), named[chunk])


class RaysAround(NamedTuple):
    """The rays to the boxes of l sight lines, and around them."""

    line: Indices
    """Index of each sight line, shape (l,)."""
    grid: RayGrid
    """Of the h views of the lines."""
    rays: SeenRays


def rays_around(lines: SightLines, poses: SolidPoses, pairs: Pairs, margin: Array) -> Iterator[RaysAround]:
    """The rays to the boxes of the sight lines in the pairs, some lines at a time, and which of them are blocked.

    margin: how far the rays of each of h view hulls reach beyond the box's image in the plane z = 1, shape (h,).
    """
    for view, hull, solids, named in _views(lines, poses, pairs, margin):
        rays = _rays(view, hull, poses, solids, np.full(len(hull), np.nan))
        yield RaysAround(named, view.grid, rays)


@dataclass(frozen=True, eq=False)
class _SeenSolids:
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
    def of(cls, view: SeenBoxes, hull: Indices, poses: SolidPoses, pairs: Pairs, state: Indices) -> _SeenSolids:
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

    def of_lines(self, wanted: Mask, hull: Indices) -> _SeenSolids:
        """Those of some of the lines, which are counted anew; hull: the new index of the view of each of these."""
        kept = wanted[self.line]
        line = (np.cumsum(wanted) - 1)[self.line[kept]]
        return _SeenSolids(
            line=line,
            hull=hull[line],
            solid=self.solid[kept],
            X_WP=self.X_WP[kept],
            X_CP=self.X_CP[kept],
            maps=self.maps[:, :, kept],
            corners=self.corners[kept],
        )


class SeenRays(NamedTuple):
    """The rays of the grids of l sight lines."""

    hull: Indices
    """Which of the h views each line has, shape (l,)."""
    outline: Mask
    """Which rays run to the box, shape (COLUMNS, h, ROWS)."""
    blocked: Mask
    """Which rays meet something before the box's far side, shape (COLUMNS, l, ROWS)."""

    @property
    def silhouette(self) -> Mask:
        """Which rays run to the box, shape (COLUMNS, l, ROWS)."""
        return self.outline[:, self.hull]

    @property
    def shares(self) -> Array:
        """The visible shares of the boxes, shape (l,)."""
        every, free = count_rays(self.outline)[self.hull], count_rays(self.silhouette & ~self.blocked)
        return np.where(every > 0, free / np.maximum(every, 1), 1.0)  # without area in the image, nothing hides


def _rays(view: SeenBoxes, hull: Indices, poses: SolidPoses, seen: _SeenSolids, enough: Array) -> SeenRays:
    """The rays of l sight lines behind solids; hull: which of the views each has, shape (l,).

    enough: as in `visible_shares`, shape (l,). Triangles that reach through the far side come last, and only where what
    is wholly before it leaves enough.
    """
    line, at, which, X_WP, X_CP, maps = seen.line, seen.hull, seen.solid, seen.X_WP, seen.X_CP, seen.maps
    hulls, lines, bounds_P = len(view.eyes), len(hull), seen.corners
    eyes_P, sides = inverse(X_CP)[:, :, 3].T.astype(np.float32), beyond_sides(maps, np.abs(bounds_P).max())
    depth = (bounds_P @ X_CP[:, 2, :3, None])[..., 0] + X_CP[:, 2, 3, None]
    reaching: Mask = np.any((depth <= AHEAD) | (depth >= view.nearest[at, None]), axis=1)
    if reaching.any():
        rows = np.flatnonzero(reaching)
        bounds_B = transform(view.X_BW[at[rows]] @ X_WP[rows], bounds_P[rows])
        regions = view.regions(at[rows], bounds_B, transform(X_CP[rows], bounds_P[rows]))
        reaching[rows] = (np.bitwise_and.reduce(regions, axis=1) & BEFORE) == 0

    # One layer for each silhouette, then one for the occluders of each line.
    bends, crossing, layers = [view.bends()], [], np.concatenate([np.arange(hulls), hulls + line])
    for index in np.flatnonzero(np.bincount(which)).tolist():
        rows = np.flatnonzero(which == index)
        surface = Triangulation.of(poses.solids[index])
        turned = facing(surface, eyes_P.take(rows, axis=1))
        doubtful = np.flatnonzero(reaching[rows])
        if len(doubtful):
            of = rows[doubtful]
            points_B = transform(view.X_BW[at[of]] @ X_WP[of], surface.vertices)
            points_C = transform(X_CP[of], surface.vertices)
            regions = in_all(view.regions(at[of], points_B, points_C), surface.triangles)
            through = regions == 0
            if surface.is_convex:  # a ray that meets its back has met its front, unless the camera is inside
                front = turned[:-1, doubtful].T > 0
                through &= front | ~front.any(axis=1, keepdims=True)
            turned[:-1, doubtful] *= ((regions & BEFORE) != 0).T
            row, triangle = np.nonzero(through)
            crossing.append(
                _Crossing(pairs=of, row=row, triangle=triangle, points=points_C, triangles=surface.triangles)
            )
        bends.append(Bends.of(surface, turned, sides.take(rows, axis=2), hulls + rows))
    inside = Silhouette.of(bends, np.concatenate([view.maps, maps], axis=2), layers).inside(hulls + lines)
    found = SeenRays(hull, inside[:, :hulls], inside[:, hulls:])
    if not crossing:
        return found
    open_ones = ~(found.shares < enough)
    for some in (triangles.of(open_ones[line]) for triangles in crossing):
        pair = some.pairs[some.row]
        rays = view.blocked(at[pair], some.corners_C)
        found.blocked[rays.column, line[pair[rays.shape]], rays.row] = True
    return found


class _Crossing(NamedTuple):
    """Triangles of a solid that reach through the far sides of boxes: n of them, in k pairs of sight line and solid."""

    pairs: Indices
    """Index of each pair, shape (k,)."""
    row: Indices
    """Place of each one's pair among these, shape (n,)."""
    triangle: Indices
    """Index of each, shape (n,)."""
    points: Array
    """The solid's in the optical frames, shape (k, V, 3) [m]."""
    triangles: Indices
    """The points of all triangles of the solid, by index, shape (F, 3)."""

    def of(self, wanted: Mask) -> _Crossing:
        """Those of some of all pairs."""
        kept = wanted[self.pairs[self.row]]
        return self._replace(row=self.row[kept], triangle=self.triangle[kept])

    @property
    def corners_C(self) -> Array:
        """Of each triangle, in the optical frame, coordinate first, shape (3, 3, n) [m]."""
        return np.moveaxis(self.points[self.row[:, None], self.triangles[self.triangle]], (2, 1), (0, 1))


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
    grid: RayGrid
    """The rays to each box."""
    areas: Array
    """Of the box's image, in cells of the grid, shape (h,)."""

    @classmethod
    def of(cls, lines: SightLines, hulls: Indices, margin: Array | None = None) -> SeenBoxes:
        """The views of some of the hulls of sight lines; margin: see `rays_around`."""
        X_WC, corners_W = lines.X_WC[hulls], lines.corners[hulls]
        X_CW = inverse(X_WC)
        corners_C = transform(X_CW, corners_W).transpose(2, 0, 1)
        X_CW = turns(corners_C[:2] / corners_C[2]) @ X_CW
        corners_C = transform(X_CW, corners_W).transpose(2, 0, 1)
        image = corners_C[:2] / corners_C[2]
        X_BW = inverse(lines.X_WB[hulls])
        half, middle = lines.half_size[hulls], lines.offset[hulls]
        beyond = 0.0 if margin is None else margin[hulls]
        grid = RayGrid.over(image.min(axis=-1) - beyond, image.max(axis=-1) + beyond)
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
        return replace(self, **arrays, grid=RayGrid(self.grid.low[:, hulls], self.grid.step[:, hulls]))

    @cached_property
    def maps(self) -> Array:
        """From the frames of the boxes, stretched to be from -1 to 1, into the grids, shape (3, 4, h)."""
        half, middle = 0.5 * (self.high - self.low), 0.5 * (self.high + self.low)
        X_BU = np.zeros_like(self.X_CB)
        X_BU[:, range(3), range(3)], X_BU[:, :3, 3], X_BU[:, 3, 3] = half, middle, 1.0
        return self.grid.maps(np.arange(len(half)), self.X_CB @ X_BU)

    def bends(self) -> Bends:
        """The silhouettes of the boxes, each stretched to be from -1 to 1."""
        sides = np.stack([self.eyes < self.low, self.eyes > self.high], axis=-1).reshape(-1, 6).T
        turned = signs(np.repeat(sides, 2, axis=0))
        return Bends.of(_BOX, turned, beyond_sides(self.maps, 1.0), np.arange(len(self.eyes)))

    def surely_seen(self, hull: Indices, solids: _SeenSolids, enough: Array) -> Mask:
        """Whether so little may block the rays of each of l lines that it sees enough; a no means nothing, shape (l,).

        hull: which of the views each line has, enough: the share that it must see, shape (l,).
        """
        if not (enough < 1.0).any():
            return np.zeros(len(hull), dtype=bool)
        # A row across a width of w cells holds at least w - 1 rays, and the widths add up to the area at least.
        least = self.areas[hull] - ROWS
        blocked = np.bincount(solids.line, self.grid.most_rays(solids.maps, solids.corners), minlength=len(hull))
        return blocked < (1.0 - enough) * least * (1.0 - _ROUNDING)

    def regions(self, hull: Indices, points_B: Array, points_C: Array) -> NDArray[np.uint16]:
        """The convex regions in which points seen in k of the views lie, one bit each, shape (k, n).

        A triangle wholly in one of the first two, of the bits `BEFORE`, blocks the rays that it meets; wholly in any
        other region, it blocks none. points_B, points_C: in the frames of box and camera, shape (k, n, 3).
        """
        eyes, low, high = self.eyes[hull], self.low[hull], self.high[hull]
        depth = points_C[..., 2]
        ahead = depth > AHEAD
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

    def blocked(self, hull: Indices, corners: Array) -> MetRays:
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


def count_rays(rays: Mask) -> Array:
    """How many rays of each sight line are marked, shape (l,)."""
    # First over the columns, in small numbers: an ordinary sum is several times slower.
    count: Array = np.add.reduce(rays.view(np.uint8), axis=0, dtype=np.uint8).sum(axis=1, dtype=float)
    return count
