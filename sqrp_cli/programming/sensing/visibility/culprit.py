"""The culprit: the solid that is named as hiding a box, of several.

If the whole box must be seen, any solid in its view hull hides it, and the nearest is named: the first that the ray to
the box's centre meets or, if it meets none, the one with the nearest point inside the hull. If a share of the box is
enough, the solid that hides the largest share is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.geometry import Array, Indices, begins_run, cross, inverse, norms, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import TOUCH, Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import HullSpaces
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester
from sqrp_cli.programming.sensing.visibility.silhouette import Triangulation
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.solids import Solid

_PRODUCTS = 50_000
"""Pairs of ray and triangle to compare at once: about the size of the cache."""

_CORNERS = 10_000_000
"""Most corners of triangles to compare with half spaces at once, to bound the memory."""

_CLIPPED = 100_000
"""Most triangles to clip at once, to bound the memory."""


class Hidden(NamedTuple):
    """Which of v sight lines are hidden, of boxes that must be seen whole."""

    culprit: Indices
    """Index of the solid that is named as hiding the box, -1 where none does, shape (v,)."""
    pairs: Pairs
    """The hidden lines with every solid that reaches into their view hulls, and perhaps others."""


def find_hidden(lines: SightLines, poses: SolidPoses, pairs: Pairs, tester: HullTester) -> Hidden:
    """Which sight lines are hidden, and by what; pairs: of all solids that may reach into the view hulls.

    The culprit is the solid with the nearest hit along the ray from the camera to the box's centre or, if none meets
    that ray, the one with a point inside the view hull closest to the camera. What the ray meets reaches into the hull;
    of the lines of these solids no pair needs a test.
    """
    along = _along_rays(lines, poses, pairs)
    struck = np.zeros(len(lines.state), dtype=bool)
    struck[pairs.line[along <= 1.0]] = True
    struck &= (lines.offset == 0.0).all(axis=1)[lines.hull]  # a thin box moves: the centre may lie outside the hull
    met = tester.met(lines, poses, pairs.of_lines(~struck), first_only=False)
    culprits = np.full(len(lines.state), -1, dtype=np.int64)
    culprits[met.line] = met.solid
    _name_least(culprits, pairs.of_lines(struck), along[struck[pairs.line]])
    rivals = met.some(np.bincount(met.line, minlength=len(culprits))[met.line] > 1)
    _name_rivals(culprits, lines, poses, rivals)
    return Hidden(culprits, met.joined(pairs.of_lines(struck)))


def _name_rivals(culprits: Indices, lines: SightLines, poses: SolidPoses, rivals: Pairs) -> None:
    """Name the culprits of lines with several solids in their hulls; only boxes that move have rays that meet one."""
    moved = (lines.offset != 0.0).any(axis=1)[lines.hull[rivals.line]]
    along = np.full(len(rivals), np.inf)
    along[moved] = _along_rays(lines, poses, rivals.some(moved))
    _name_least(culprits, rivals, along)
    missed = rivals.some(_least_of_lines(rivals.line, along) > 1.0)
    if len(missed):
        _name_least(culprits, missed, nearest_inside(lines, poses, missed))


def find_largest(lines: SightLines, poses: SolidPoses, pairs: Pairs, part: Indices) -> Indices:
    """Index of a solid of the part that hides the largest share of each sight line's box, shape (v,).

    -1 where no pair names the sight line. Each part counts all directions in which it lies in front of the box's far
    side, other parts ignored, on the rays that decide whether the box is visible. Of equals the first part is named.

    pairs: of solids that reach into the view hulls. part: of each solid, by rank, shape (s,).
    """
    largest = np.full(len(lines.state), -1, dtype=np.int64)
    largest[pairs.line] = pairs.solid
    pairs = pairs.some(np.lexsort((part[pairs.solid], pairs.line)))
    begins = begins_run(pairs.line) | begins_run(part[pairs.solid])
    several = np.bincount(pairs.line[begins], minlength=len(largest))[pairs.line] > 1
    pairs, begins = pairs.some(several), begins[several]
    # Each part by itself, as if it were alone in front of the box.
    of_part = pairs.some(begins)
    alone = replace(lines, state=lines.state[of_part.line], hull=lines.hull[of_part.line])
    seen = visible_shares(alone, poses, Pairs(np.cumsum(begins) - 1, pairs.solid))
    _name_least(largest, of_part, seen.share)
    return largest


def nearest_inside(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Least distance from the eye to the part of each pair's solid inside the view hull, shape (pairs,) [m].

    It may be too large where another solid of the same line is nearer.
    """
    hulls = HullSpaces.of(lines, poses, pairs)
    nearest, pieces = np.full(len(pairs), np.inf), []
    for solid, rows in _by_solid(poses, pairs.solid, hulls.spaces.shape[1]):
        facets, outside = Facets.of(solid), hulls.outside(rows, solid.vertices)
        vertex, at = np.nonzero(outside == 0)
        np.minimum.at(nearest, rows[at], norms(solid.vertices[vertex] - hulls.eyes[rows[at]]))
        a, b, c = (outside[corner] for corner in solid.triangles.T)
        within = (a & b & c) == 0
        if Triangulation.of(solid).is_convex:  # the eye is nearest to its front, unless inside
            front = facets.normals @ hulls.eyes[rows].T > facets.offsets[:, None]
            within &= front | ~front.any(axis=0)
        facet, at = np.nonzero(within)
        # Spheres around the triangles, and where their planes cut the hulls, spare most of the exact distances.
        least = _least_of_lines(pairs.line, nearest)
        near = norms(facets.middles[facet] - hulls.eyes[rows[at]]) - facets.radii[facet]
        kept = np.flatnonzero(near < least[rows[at]])
        facet, row = facet[kept], rows[at[kept]]
        near = np.maximum(near[kept], hulls.least_depths(row, facets.normals[facet], facets.offsets[facet]))
        kept = np.flatnonzero(near < least[row])
        facet, row = facet[kept], row[kept]
        pieces.append(_Pieces(row, near[kept], facets.points[facet], facets.normals[facet]))
    _settle(nearest, pairs.line, hulls, pieces)
    return nearest


class _Pieces(NamedTuple):
    """n triangles that may reach into the hulls of pairs."""

    row: Indices
    """Index of the pair, shape (n,)."""
    near: Array
    """No larger than the distance from the eye, shape (n,) [m]."""
    points: Array
    """Corners, in the frame of the solid's parent, shape (n, 3, 3) [m]."""
    normals: Array
    """As of `Facets`, shape (n, 3)."""


def _settle(nearest: Array, line: Indices, hulls: HullSpaces, pieces: Sequence[_Pieces]) -> None:
    """Lower the distance of pairs, shape (pairs,), to that of the parts of triangles inside their hulls.

    line: of the pairs. Only as far as needed: the nearest pair of a line may stay too large, and others too.
    """
    if not pieces:
        return
    row, near, points, normals = map(np.concatenate, zip(*pieces, strict=True))

    def lower(all_asked: Indices) -> None:
        for some in np.array_split(all_asked, 1 + len(all_asked) // _CLIPPED):
            least = _least_of_lines(line, nearest)[row[some]]
            np.minimum.at(nearest, row[some], hulls.distances(row[some], points[some], normals[some], least))

    # Triangles that are likely to be nearest, then those of each line's rivals until the nearest has none.
    lower(np.unique(_nearest_of_lines(line[row], near)))
    waiting = np.ones(len(row), dtype=bool)
    while True:
        rival = _nearest_of_lines(line, nearest)[row] != row
        asked = np.flatnonzero(waiting & rival & (near < _least_of_lines(line, nearest)[row]))
        if not len(asked):
            return
        lower(asked)
        waiting[asked] = False


def _name_least(culprits: Indices, pairs: Pairs, values: Array) -> None:
    """Make the solid with the least value among the pairs of a line its culprit; the first of equals."""
    order = np.lexsort((values, pairs.line))
    named, first = np.unique(pairs.line[order], return_index=True)
    culprits[named] = pairs.solid[order][first]


def _least_of_lines(line: Indices, values: Array) -> Array:
    """The least value of all pairs of the same line, for each pair, shape (pairs,)."""
    least = np.full(int(line.max(initial=-1)) + 1, np.inf)
    np.minimum.at(least, line, values)
    return least[line]


def _nearest_of_lines(line: Indices, values: Array) -> Indices:
    """Index of the pair with the least value of all pairs of the same line, the first of equals, shape (pairs,)."""
    order = np.lexsort((values, line))
    lines, first = np.unique(line[order], return_index=True)
    return order[first][np.searchsorted(lines, line)]


def _along_rays(lines: SightLines, poses: SolidPoses, pairs: Pairs) -> Array:
    """Smallest factor of the ray from the eye to the box's centre at which it meets each pair's solid, shape (pairs,).

    Infinite if it meets none of the solid's triangles.
    """
    factors = np.full(len(pairs), np.inf)
    hull = lines.hull[pairs.line]
    X_PW = inverse(poses.at(pairs.solid, lines.state[pairs.line]))
    ends = np.stack([lines.eyes[hull], lines.X_WB[hull, :3, 3]], axis=1)
    eye, center = transform(X_PW, ends).swapaxes(0, 1)
    ray, solids = center - eye, poses.solids
    away = norms(cross(solids.boxes[pairs.solid, :3, 3] - eye, ray))
    meets_ball = away <= (solids.radii[pairs.solid] + TOUCH) * norms(ray)
    for solid, rows in _by_solid(poses, pairs.solid):
        rows = rows[meets_ball[rows]]
        factors[rows] = first_hits(eye[rows], ray[rows], Facets.of(solid))
    return factors


def first_hits(eye: Array, ray: Array, facets: Facets) -> Array:
    """Smallest factor of each ray (n, 3) from its eye (n, 3) at which it meets one of the facets; shape (n,).

    A line meets a triangle if its Plücker products with all three edges have one sign (K. Shoemake, 1998).
    """
    normal, offset = facets.normals, facets.offsets
    lines = np.concatenate([ray, cross(eye, ray)], axis=1)
    factors = np.full(len(eye), np.inf)
    for chunk in np.array_split(np.arange(len(eye)), 1 + len(eye) * len(offset) // _PRODUCTS):
        sides = [lines[chunk] @ edge for edge in facets.edges]
        inside = ((sides[0] >= 0) & (sides[1] >= 0) & (sides[2] >= 0)) | (
            (sides[0] <= 0) & (sides[1] <= 0) & (sides[2] <= 0)
        )
        row, face = np.nonzero(inside)
        at = chunk[row]
        slope = np.einsum("ni,ni->n", normal[face], ray[at])
        height = offset[face] - np.einsum("ni,ni->n", normal[face], eye[at])
        factor = height / np.where(slope == 0, np.inf, slope)
        np.minimum.at(factors, at, np.where(factor > 0, factor, np.inf))
    return factors


@dataclass(frozen=True, eq=False)
class Facets:
    """The F triangles of a solid, in its parent's frame, prepared for comparison with rays and view hulls."""

    points: Array
    """Their corners, shape (F, 3, 3) [m]."""
    normals: Array
    """n of n . p = o for the points p of each one's plane, not of length 1, shape (F, 3)."""
    offsets: Array
    """o of the same, shape (F,)."""
    middles: Array
    """Centre of a sphere around each, shape (F, 3) [m]."""
    radii: Array
    """Its radius, shape (F,) [m]."""
    edges: tuple[Array, Array, Array]
    """Plücker coordinates of the line along each of the three edges, moment before direction, shape (6, F) each."""

    @staticmethod
    def of(solid: Solid) -> Facets:
        """The facets of a solid; made once."""
        if solid not in _facets:
            points = solid.vertices[solid.triangles]
            a, b, c = points.swapaxes(0, 1)
            normals = cross(b - a, c - a)
            middles = points.mean(axis=1)
            reach = points - middles[:, None]
            _facets[solid] = Facets(
                points=points,
                normals=normals,
                offsets=np.einsum("fi,fi->f", normals, a),
                middles=middles,
                radii=np.sqrt(np.einsum("fki,fki->fk", reach, reach).max(axis=1, initial=0.0)),
                edges=(_line(a, b), _line(b, c), _line(c, a)),
            )
        return _facets[solid]


def _line(start: Array, end: Array) -> Array:
    """Plücker coordinates of lines through points (F, 3), shape (6, F)."""
    return np.ascontiguousarray(np.concatenate([cross(start, end), end - start], axis=1).T)


_facets: WeakKeyDictionary[Solid, Facets] = WeakKeyDictionary()
"""Cached results for solids still in use."""


def _by_solid(poses: SolidPoses, solids: Indices, spaces: int = 0) -> Iterator[tuple[Solid, Indices]]:
    """Each solid with its pairs, as many at once as fit the memory with that number of half spaces."""
    for index in np.flatnonzero(np.bincount(solids)).tolist():
        solid, rows = poses.solids[index], np.flatnonzero(solids == index)
        for some in np.array_split(rows, 1 + len(rows) * spaces * len(solid.triangles) // _CORNERS):
            yield solid, some
