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
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, begins_run, inverse, transform
from sqrp_cli.programming.sensing.limits import cut_by_image
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.visibility import silhouette
from sqrp_cli.programming.sensing.visibility.seen_boxes import BEFORE, SeenBoxes, SeenSolids, SeenTriangles, in_all

_CHUNK = 1024
"""Most sight lines to sample together."""

_MEMORY = 2_000_000
"""Most triangles, counted for each sight line, to test together, to bound the memory."""


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
    solids: SeenSolids
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
        yield _Views(view, hull, SeenSolids.of(view, hull, poses, here, state[here.line]), named[chunk])


class RaysAround(NamedTuple):
    """The rays to the boxes of l sight lines, and around them."""

    line: Indices
    """Index of each sight line, shape (l,)."""
    view: SeenBoxes
    """The h views of the lines."""
    rays: SeenRays


def rays_around(lines: SightLines, poses: SolidPoses, pairs: Pairs, margin: Array) -> Iterator[RaysAround]:
    """The rays to the boxes of the sight lines in the pairs, some lines at a time, and which of them are blocked.

    margin: how far the rays of each of h view hulls reach beyond the box's image in the plane z = 1, shape (h,).
    """
    for view, hull, solids, named in _views(lines, poses, pairs, margin):
        rays = _rays(view, hull, poses, solids, np.full(len(hull), np.nan))
        yield RaysAround(named, view, rays)


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


def _rays(view: SeenBoxes, hull: Indices, poses: SolidPoses, seen: SeenSolids, enough: Array) -> SeenRays:
    """The rays of l sight lines behind solids; hull: which of the views each has, shape (l,).

    enough: as in `visible_shares`, shape (l,). Triangles that reach through the far side come last, and only where what
    is wholly before it leaves enough.
    """
    hulls, lines = len(view.eyes), len(hull)
    sides = silhouette.beyond_sides(seen.maps, np.abs(seen.corners).max())
    eyes_P, reaching, crossing = seen.eyes_P, seen.reach_through(view), []
    # One layer for each silhouette, then one for the occluders of each line.
    bends, layers = [view.bends()], np.concatenate([np.arange(hulls), hulls + seen.line])
    for index in np.flatnonzero(np.bincount(seen.solid)).tolist():
        rows = np.flatnonzero(seen.solid == index)
        surface = silhouette.Triangulation.of(poses.solids[index])
        turned = silhouette.facing(surface, eyes_P.take(rows, axis=1))
        doubtful = np.flatnonzero(reaching[rows])
        if len(doubtful):
            points = seen.points(view, rows[doubtful], surface.vertices)
            regions = in_all(points.regions, surface.triangles)
            through = SeenTriangles.of(rows[doubtful], surface, points, regions == 0, turned[:-1, doubtful])
            crossing.append(through)
            turned[:-1, doubtful] *= ((regions & BEFORE) != 0).T
        bends.append(silhouette.Bends.of(surface, turned, sides.take(rows, axis=2), hulls + rows))
    maps = np.concatenate([view.maps, seen.maps], axis=2)
    inside = silhouette.Silhouette.of(bends, maps, layers).inside(hulls + lines)
    found = SeenRays(hull, inside[:, :hulls], inside[:, hulls:])
    if not crossing:
        return found
    open_ones = ~(found.shares < enough)
    for some in (triangles.of_pairs(open_ones[seen.line]) for triangles in crossing):
        rays = view.blocked(seen.hull[some.pair], some.corners_C)
        found.blocked[rays.column, seen.line[some.pair[rays.shape]], rays.row] = True
    return found


def count_rays(rays: Mask) -> Array:
    """How many rays of each sight line are marked, shape (l,)."""
    # First over the columns, in small numbers: an ordinary sum is several times slower.
    count: Array = np.add.reduce(rays.view(np.uint8), axis=0, dtype=np.uint8).sum(axis=1, dtype=float)
    return count


def cut_shares(watched: WatchedBoxes, lines: SightLines, camera: Indices) -> Array:
    """The share of the box of each sight line that the image's edge cuts, 0 where it must not cut any, shape (v,).

    camera: of each line, by index, shape (v,).
    """
    judged = np.array([entry.limits.judges_rest for entry in watched.boxes])[lines.box]
    eye, found = camera[begins_run(lines.hull)], np.zeros(len(lines.box))
    for number in np.unique(eye[judged]).tolist():
        some = judged & (eye == number)
        corners_C = transform(inverse(lines.X_WC[some]), lines.corners[some]).transpose(2, 1, 0)
        found[some] = cut_by_image(watched.projections[number], corners_C)
    return found[lines.hull]


def shares_within(watched: WatchedBoxes, lines: SightLines, pairs: Pairs, camera: Indices) -> VisibleShares:
    """The shares of the boxes of the sight lines in the pairs that are visible and within the image.

    pairs: as in `visible_shares`. camera: of each line, by index, shape (v,).
    """
    line, share = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for around in rays_around(lines, watched.solid_poses, pairs, np.zeros(len(lines.box))):
        rays, hull = around.rays, lines.hull[around.line]
        directions_C = around.view.directions[:, rays.hull] @ lines.X_WC[hull, :3, :3]
        free = rays.silhouette & ~rays.blocked
        for number in np.unique(camera[around.line]).tolist():
            own = camera[around.line] == number
            free[:, own] &= watched.projections[number].shows(directions_C[:, own])
        line.append(around.line)
        share.append(count_rays(free) / np.maximum(count_rays(rays.silhouette), 1.0))
    return VisibleShares(np.concatenate(line), np.concatenate(share))
