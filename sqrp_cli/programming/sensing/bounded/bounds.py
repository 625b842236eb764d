"""How far the pose of each camera may be from where the workspace says, and view hulls for every pose within that.

All hulls that share a box and differ in the eye, which is anywhere in a ball, make up the convex hull of ball and box:
what meets none of them does not meet that. What they have in common is convex, too, and contains the hull of the box
and any of its own points: what meets that meets all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, cross
from sqrp_cli.programming.sensing.sight_lines import SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import half_spaces
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester

_ROUNDING = 1e-9
"""Added to bounds, so that rounding decides nothing [m and rad]."""


@dataclass(frozen=True)
class PoseBounds:
    """Bounds on the error of each camera's optical frame; the errors of cameras have nothing to do with each other."""

    position: float
    """Longest distance of its centre from where it should be, in any direction [m]."""
    rotation: float
    """Largest angle by which it is turned, about any axis [rad]."""

    @property
    def reach(self) -> float:
        """`position`, and what rounding may add [m]."""
        return self.position + _ROUNDING

    @property
    def turn(self) -> float:
        """`rotation`, and what rounding may add [rad]."""
        return self.rotation + _ROUNDING

    def angles(self, distances: Array) -> Array:
        """By how much the direction from a camera to points changes at most, by their distances [m]; the same shape.

        The camera's turn, and the angle under which the ball of its centres is seen from the point.
        """
        return self.turn + self.parallax(distances)

    def parallax(self, distances: Array) -> Array:
        """The angles under which the ball of a camera's centres is seen from points at distances [m]."""
        found: Array = np.where(
            distances > self.reach, np.arcsin(np.clip(self.reach / np.maximum(distances, 1e-300), 0.0, 1.0)), np.pi
        )
        return found


_SIDES = 12
"""Sides of the prism around the ball of a camera's centres, which is 3.5 % wider."""

_STEPS, _HALVINGS = np.geomspace(1e-6, 0.99, 14), 5
"""Where to look for the first point that all hulls have in common, as shares of the way from the eye to the box's
centre, and how often to halve the way before it."""


class AnyHullTester(HullTester):
    """Tests whether a solid reaches into any of the view hulls of a box, wherever in a ball the eye is."""

    def __init__(self, bounds: PoseBounds) -> None:
        super().__init__(8 + 2 * _SIDES)
        self._reach = bounds.reach

    def hulls(self, lines: SightLines) -> Array:
        """The corners of each box and of a prism around the ball, shape (h, 32, 3) [m]."""
        ahead, aside, over = axes_to_boxes(lines)
        turns = np.arange(_SIDES) * (2 * np.pi / _SIDES)
        wide = self._reach / np.cos(np.pi / _SIDES)
        ring = wide * (np.cos(turns)[:, None] * aside[:, None] + np.sin(turns)[:, None] * over[:, None])
        ends = [lines.eyes[:, None] + ring + sign * self._reach * ahead[:, None] for sign in (-1.0, 1.0)]
        return np.concatenate([lines.corners, *ends], axis=1)


class CommonHulls(NamedTuple):
    """What the view hulls of each box have in common, wherever in a ball the eye is."""

    lines: SightLines
    """The same lines with an eye so much nearer to the box that its hull lies in all of them."""
    known: Mask
    """Whether there is such an eye, shape (h,)."""


def common_hulls(lines: SightLines, bounds: PoseBounds, wanted: Mask) -> CommonHulls:
    """View hulls that lie in those of all eyes of a ball, of those wanted (h,).

    A point a lies in the hull of an eye if a line from there through a meets the box: if the eye lies in the cone from
    a away from the box. So a ball of eyes does if it is that far inside of all of the cone's faces.
    """
    to_center = lines.corners.mean(axis=1) - lines.eyes
    # Behind a point that lies in all hulls all points do, up to the box.
    low, high = np.zeros(len(to_center)), np.full(len(to_center), np.inf)
    for step in _STEPS.tolist():
        left = np.flatnonzero(np.isinf(high) & lines.finite & wanted)
        found = _in_all(lines, bounds, left, np.full(len(left), step))
        high[left[found]], low[left[~found]] = step, step
    known = np.isfinite(high)
    some = np.flatnonzero(known)
    for _ in range(_HALVINGS):
        middle = np.sqrt(np.maximum(low[some], 0.1 * _STEPS[0]) * high[some])
        found = _in_all(lines, bounds, some, middle)
        high[some[found]], low[some[~found]] = middle[found], middle[~found]
    X_WC = lines.X_WC.copy()
    X_WC[:, :3, 3] += np.where(known, high, 0.0)[:, None] * to_center
    return CommonHulls(replace(lines, X_WC=X_WC), known)


def _in_all(lines: SightLines, bounds: PoseBounds, hulls: Indices, share: Array) -> Mask:
    """Whether the points at shares (n,) of the way to the boxes of hulls (n,) lie in the hulls of all eyes."""
    if not len(hulls):
        return np.zeros(0, dtype=bool)
    way = share[:, None] * (lines.corners[hulls].mean(axis=1) - lines.eyes[hulls])
    spaces = half_spaces(lines.corners[hulls] - (lines.eyes[hulls] + way)[:, None])
    normals, through_apex = spaces[..., :3], (spaces[..., 3] == 0.0) & (spaces != 0.0).any(axis=2)
    depth = -(normals @ way[..., None])[..., 0]
    deep = (depth >= bounds.reach * np.sqrt(np.einsum("hki,hki->hk", normals, normals))) | ~through_apex
    # From inside the box nothing is known.
    outside = (spaces[..., 3] > 0.0).any(axis=1) & through_apex.any(axis=1)
    found: Mask = deep.all(axis=1) & outside
    return found


def axes_to_boxes(lines: SightLines) -> Array:
    """Unit vectors in the world: to the centre of the box of each hull, and two across, shape (3, h, 3)."""
    ahead = _directions(lines.corners.mean(axis=1) - lines.eyes)
    aside = _directions(cross(ahead, np.eye(3)[np.abs(ahead).argmin(axis=1)]))
    return np.stack([ahead, aside, cross(ahead, aside)])


def _directions(vectors: Array) -> Array:
    """Vectors (n, 3) with the length 1."""
    length = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    found: Array = vectors / np.maximum(length, 1e-300)[:, None]
    return found
