"""Which part hides how much of a box: every ray that is blocked belongs to the part that it meets first.

The rays are those of `visible_shares`, so what the parts hide adds up to what is not visible. Unlike there, the order
of the parts along each ray counts, so every triangle is compared with the rays that it blocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, begins_run, cross
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility import silhouette
from sqrp_cli.programming.sensing.visibility.seen_boxes import BEFORE, SeenBoxes, SeenSolids, SeenTriangles, in_all

_TRIANGLES = 400_000
"""Triangles to compare with rays at once, counted for each sight line, to bound the memory."""

_RAYS = silhouette.ROWS * silhouette.COLUMNS


class PartShares(NamedTuple):
    """What single parts hide from sight lines: n pairs of line and part, ordered by line, then by part."""

    line: Indices
    """Index of the sight line, shape (n,)."""
    part: Indices
    """Of the part, shape (n,)."""
    share: Array
    """Share of the box's silhouette that no other part hides before it, in 0..1, shape (n,)."""
    alone: Array
    """Share of it that no other part hides at all: what would be seen without it, in 0..1, shape (n,)."""


def part_shares(lines: SightLines, poses: SolidPoses, pairs: Pairs, part: Indices) -> PartShares:
    """What each part hides from the sight lines in the pairs; parts that hide nothing are left out.

    pairs: of solids that may reach into the view hulls, of finite poses. part: of each solid, shape (s,). All corners
    of the boxes must lie in front of the camera. Of parts at the same place on a ray the first owns it.
    """
    pieces = [_of_some(lines, poses, some, part) for some in _in_portions(poses, pairs)]
    if not pieces:
        return PartShares(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))
    return PartShares(*map(np.concatenate, zip(*pieces, strict=True)))


def _in_portions(poses: SolidPoses, pairs: Pairs) -> Iterator[Pairs]:
    """The pairs in portions of whole lines that fit the memory."""
    sizes = np.array([len(solid.triangles) for solid in poses.solids], dtype=np.int64)
    begins = np.flatnonzero(begins_run(pairs.line))
    before = np.concatenate([[0], np.cumsum(sizes[pairs.solid])])[begins]
    starts = begins[begins_run(before // _TRIANGLES)].tolist()
    for start, end in pairwise([*starts, len(pairs)]):
        yield pairs.some(np.arange(start, end))


class _Blocked(NamedTuple):
    """Rays that solids block, n in all."""

    ray: Indices
    """Index among those of all lines, shape (n,)."""
    depth: Array
    """At which the ray meets the solid [m], shape (n,)."""


def _of_some(lines: SightLines, poses: SolidPoses, pairs: Pairs, part: Indices) -> PartShares:
    begins = begins_run(pairs.line)
    named, number = pairs.line[begins], np.cumsum(begins) - 1
    hulls, hull = np.unique(lines.hull[named], return_inverse=True)
    boxes = _Boxes.of(lines, hulls, hull)
    owner = np.full(len(named) * _RAYS, -1, dtype=np.int64)
    nearest, blocking = np.full(len(owner), np.inf), np.zeros(len(owner), dtype=np.int64)
    ranks = np.unique(part[pairs.solid])
    for rank in ranks.tolist():
        rows = np.flatnonzero(part[pairs.solid] == rank)
        found = boxes.blocked(poses, Pairs(number[rows], pairs.solid[rows]), lines.state[named][number[rows]])
        depth = np.full(len(owner), np.inf)
        np.minimum.at(depth, found.ray, found.depth)
        blocking += depth < np.inf
        owner[depth < nearest] = rank
        np.minimum(nearest, depth, out=nearest)
    size, line = (len(named), int(ranks.max()) + 1), np.arange(len(owner)) // _RAYS

    def counted(rays: Mask) -> Array:
        """Of each line and part, shape (lines, parts)."""
        which = np.flatnonzero(rays)
        return (
            np.bincount(line[which] * size[1] + owner[which], minlength=size[0] * size[1]).reshape(size).astype(float)
        )

    owned, alone = counted(blocking > 0), counted(blocking == 1)
    of, which = np.nonzero(owned)
    all_rays = np.maximum(boxes.silhouettes.sum(axis=(0, 2))[hull], 1)[of]
    return PartShares(line=named[of], part=which, share=owned[of, which] / all_rays, alone=alone[of, which] / all_rays)


@dataclass(frozen=True, eq=False)
class _Boxes:
    """The boxes of l sight lines with their rays."""

    view: SeenBoxes
    hull: Indices
    """Which of the views each line has, shape (l,)."""
    silhouettes: Mask
    """The rays that run to each view's box, shape (COLUMNS, views, ROWS)."""

    @classmethod
    def of(cls, lines: SightLines, hulls: Indices, hull: Indices) -> _Boxes:
        """Those of some of the hulls of sight lines."""
        view = SeenBoxes.of(lines, hulls)
        return cls(
            view, hull, silhouette.Silhouette.of([view.bends()], view.maps, np.arange(len(hulls))).inside(len(hulls))
        )

    def blocked(self, poses: SolidPoses, pairs: Pairs, state: Indices) -> _Blocked:
        """Where the rays to the boxes meet solids before they leave the boxes; state: of each pair, by index."""
        view, found = self.view, []
        seen = SeenSolids.of(view, self.hull, poses, pairs, state)
        eyes_P = seen.eyes_P
        for index in np.flatnonzero(np.bincount(pairs.solid)).tolist():
            rows, surface = np.flatnonzero(pairs.solid == index), silhouette.Triangulation.of(poses.solids[index])
            points = seen.points(view, rows, surface.vertices)
            near = (in_all(points.regions, surface.triangles) & ~BEFORE) == 0  # others lie beyond one side of the rays
            turned = silhouette.facing(surface, eyes_P.take(rows, axis=1))[:-1]
            triangles = SeenTriangles.of(rows, surface, points, near, turned)
            pair, corners = triangles.pair, triangles.corners_C
            hull, met = seen.hull[pair], view.blocked(seen.hull[pair], corners)
            inside = self.silhouettes[met.column, hull[met.shape], met.row]
            met = silhouette.MetRays(*(values[inside] for values in met))
            ray = (pairs.line[pair[met.shape]] * silhouette.COLUMNS + met.column) * silhouette.ROWS + met.row
            found.append(_Blocked(ray, _depths(view, hull, met, corners)))
        return _Blocked(*map(np.concatenate, zip(*found, strict=True)))


def _depths(view: SeenBoxes, hull: Indices, met: silhouette.MetRays, corners: Array) -> Array:
    """Depths at which n rays meet the planes of triangles (3, 3, k), coordinate first, seen in views (k,); (n,) [m]."""
    a, b, c = corners.transpose(1, 2, 0)
    normal = cross(b - a, c - a)
    offset = np.einsum("ki,ki->k", normal, a)
    (low_u, low_v), (step_u, step_v) = view.grid.low[:, hull], view.grid.step[:, hull]
    # n . (u, v, 1) as a function of column and row
    along, down = normal[:, 0] * step_u, normal[:, 1] * step_v
    rest = normal[:, 0] * low_u + normal[:, 1] * (low_v + 0.5 * step_v) + normal[:, 2]
    column = met.column + silhouette.SHIFT[met.row]
    slope = along[met.shape] * column + down[met.shape] * met.row + rest[met.shape]
    depth: Array = offset[met.shape] / np.where(slope == 0.0, np.inf, slope)
    return depth
