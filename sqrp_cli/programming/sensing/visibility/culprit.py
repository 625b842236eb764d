"""Which of several solids to name as the one that hides a box.

Where the whole box must be seen, anything that reaches into its view hull hides it, and the nearest is named. Where a
share of it does, what hides the largest share is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sqrp_cli.geometry import Array, Indices, begins_run, cross, inverse, transform
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.nearest_inside import nearest_inside
from sqrp_cli.programming.sensing.visibility.triangulation import Facets, box_is_met
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares

_PRODUCTS = 50_000
"""Pairs of ray and triangle that are compared at once: about what fits the cache."""


def find_culprits(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> Indices:
    """Index of the solid that hides each sight line's box, shape (v,); -1 where no pair names the sight line.

    It is the solid whose first hit along the ray from the camera to the box's centre (v, 3) is nearest or, if none
    meets that ray, the one whose nearest point inside the view hull is closest to the camera. pairs: (sight line,
    solid) inside the view hulls, ordered by sight line.
    """
    culprits = np.full(len(lines.state), -1, dtype=np.int64)
    line, solid = pairs
    culprits[line] = solid
    several = np.bincount(line, minlength=len(culprits))[line] > 1
    line, solid = line[several], solid[several]
    along = _along_rays(lines, center, poses, (line, solid))
    met = np.full(len(culprits), np.inf)
    np.minimum.at(met, line, along)
    _name_least(culprits, (line, solid), along)
    missed = met[line] > 1.0
    if missed.any():
        line, solid = line[missed], solid[missed]
        _name_least(culprits, (line, solid), nearest_inside(lines, poses, (line, solid)))
    return culprits


def find_largest(lines: SightLines, poses: SolidPoses, pairs: Pairs, part: Indices) -> Indices:
    """Index of a solid of the part that hides the largest share of each sight line's box, shape (v,).

    -1 where no pair names the sight line. Each part counts all directions in which it lies before the box's far side,
    whatever else lies there too, on the rays that decide whether the box is visible. Of equals the first part is named.

    pairs: (sight line, solid) inside the view hulls, ordered by sight line. part: of each solid, by rank, shape (s,).
    """
    largest = np.full(len(lines.state), -1, dtype=np.int64)
    line, solid = pairs
    largest[line] = solid
    order = np.lexsort((part[solid], line))
    line, solid = line[order], solid[order]
    of_part = part[solid]
    begins = begins_run(line) | begins_run(of_part)
    several = np.bincount(line[begins], minlength=len(largest))[line] > 1
    line, solid, begins = line[several], solid[several], begins[several]
    # Each part by itself, as if it were alone before the box.
    of = line[begins]
    alone = replace(lines, state=lines.state[of], hull=lines.hull[of])
    _, visible = visible_shares(alone, poses, (np.cumsum(begins) - 1, solid))
    _name_least(largest, (of, solid[begins]), visible)
    return largest


def _name_least(culprits: Indices, pairs: Pairs, values: Array) -> None:
    """Make the solid with the least value among the pairs of a line its culprit; the first of equals."""
    order = np.lexsort((values, pairs[0]))
    named, first = np.unique(pairs[0][order], return_index=True)
    culprits[named] = pairs[1][order][first]


def _along_rays(lines: SightLines, center: Array, poses: SolidPoses, pairs: Pairs) -> Array:
    """Smallest factor of the ray from the eye to the centre at which it meets the solid of each pair, shape (pairs,).

    It is infinite if it meets none of the solid's triangles, perhaps also if it meets one beyond the centre only. Rays
    and edges are compared by their Plücker coordinates.
    """
    line, solid = pairs
    factors = np.full(len(line), np.inf)
    X_PW = inverse(poses.at(solid, lines.state[line]))
    eye, ray = transform(X_PW, np.stack([lines.eyes[lines.hull[line]], center[line]], axis=1)).swapaxes(0, 1)
    ray = ray - eye
    for index in np.flatnonzero(np.bincount(solid)).tolist():
        here = np.flatnonzero(solid == index)
        here = here[box_is_met(poses.solids[index], eye[here], ray[here])]
        factors[here] = _first_hits(eye[here], ray[here], Facets.of(poses.solids[index]))
    return factors


def _first_hits(eye: Array, ray: Array, facets: Facets) -> Array:
    """Smallest factor of each ray (n, 3) from its eye (n, 3) at which it meets one of the facets; shape (n,)."""
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
