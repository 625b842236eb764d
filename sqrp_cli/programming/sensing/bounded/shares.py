"""Visible shares for every pose of the camera within bounds.

What a camera's turn changes in an image, it changes for the box and what hides it alike. What its centre moves is
looked at in the plane through the box's centre that is parallel to the image: from a centre that has moved by less than
t across the direction to the box, a point at the depth z, seen in a direction s times as long as it is deep, appears
there to have moved by less than t s |D - z| / (z - t), if the plane's depth is D; by as much along that direction, by
no more than the tangent of the box's image instead of s. So the blocked area changes by no more than its outline
sweeps.

Where that leaves open whether enough is visible, the possible centres are cut into columns: branch and bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, inverse, ranges, transform
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds, axes_to_boxes
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines
from sqrp_cli.programming.sensing.visibility.hull_spaces import BOX_FACES, clipped_polygons
from sqrp_cli.programming.sensing.visibility.silhouette import SHIFT, RayGrid
from sqrp_cli.programming.sensing.visibility.visible_share import count_rays, rays_around

_QUARTERS = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]])
"""Middles of the quarters of a square, in halves of its side."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Upright square columns that hold the possible centres of cameras, one for each of n sight lines.

    They stand along the direction to a box: across it the parallax of what hides the box changes much faster than along
    it, so only that is cut.
    """

    line: Indices
    """Index of the sight line, shape (n,)."""
    middle: Array
    """Of each column, across the direction to the box, from where the camera should be, shape (n, 2) [m]."""
    half: Array
    """Half the side of each, shape (n,) [m]."""
    bounds: PoseBounds

    @classmethod
    def whole(cls, line: Indices, bounds: PoseBounds) -> Columns:
        """One column for each sight line."""
        return cls(line, np.zeros((len(line), 2)), np.full(len(line), bounds.reach), bounds)

    @property
    def turn(self) -> float:
        """By how much the cameras may be turned [rad]."""
        return self.bounds.turn

    @property
    def aside(self) -> Array:
        """Radius of each around its middle, however it is turned about that, shape (n,) [m]."""
        return self._at_most_ball(np.sqrt(2.0) * self.half)

    @property
    def along(self) -> Array:
        """Half the length of each that lies in the ball of centres, shape (n,) [m]."""
        nearest = np.maximum(np.hypot(*self.middle.T) - self.aside, 0.0)
        found: Array = np.sqrt(np.maximum(self.bounds.reach**2 - nearest**2, 0.0))
        return found

    @property
    def reach(self) -> Array:
        """Distance from the middle of each column within which its centres lie, shape (n,) [m]."""
        return self._at_most_ball(np.hypot(self.aside, self.along))

    def _at_most_ball(self, radius: Array) -> Array:
        """Radii around the middles, of which one in the middle of the ball need not be larger than that."""
        return np.where(self.middle.any(axis=1), radius, np.minimum(radius, self.bounds.reach))

    def some(self, which: Mask) -> Columns:
        """Some of the columns."""
        return Columns(self.line[which], self.middle[which], self.half[which], self.bounds)

    def split(self) -> Columns:
        """Each cut into its quarters that reach into the ball of centres."""
        middle, half = quarters(self.middle, self.half)
        found = Columns(np.repeat(self.line, 4), middle, half, self.bounds)
        return found.some(in_ball(middle, half, self.bounds))


def quarters(middle: Array, half: Array) -> tuple[Array, Array]:
    """The middles (4 n, 2) and halves of sides (4 n,) of the quarters of squares (n) [m]."""
    return (middle[:, None] + half[:, None, None] * _QUARTERS).reshape(-1, 2), np.repeat(0.5 * half, 4)


def in_ball(middle: Array, half: Array, bounds: PoseBounds) -> Mask:
    """Which square columns (n) reach into the ball of centres."""
    nearest = np.maximum(np.abs(middle) - half[:, None], 0.0)
    found: Mask = np.hypot(*nearest.T) < bounds.reach
    return found


ACCURACY = 0.005
"""Accuracy of visible shares, which are counted on rays."""

_STRIDE = 3
"""Rows between rays that stand nearly above each other."""

_ASLANT = (SHIFT[_STRIDE] + 0.5) % 1.0 - 0.5
"""By how much, as a share of a column."""

_HALVINGS = 3
"""How often the columns of centres are halved where that may decide."""


def visible_enough(
    lines: SightLines, poses: SolidPoses, pairs: Pairs, needed: Array, bounds: PoseBounds, *, surely: bool
) -> Mask:
    """Of the v sight lines in pairs, along which surely, or possibly, as much of the box as needed (v,) is visible.

    Lines in no pair are surely free, and not said to be possibly so. What is left undecided after all halvings counts
    as not sure, and as possible; so does what no halving can decide.
    """
    shown = np.zeros(len(lines.state), dtype=bool)
    columns, near = Columns.whole(np.unique(pairs.line), bounds), NearSolids.of(lines, poses, pairs, bounds.reach)
    for _ in range(_HALVINGS + 1):
        looks = from_columns(lines, columns)
        found = share_bounds(looks, poses, near.of_lines(columns.line), columns)
        least = needed[columns.line]
        if surely:
            doubtful, hopeless = found.low < least, found.middle - found.error < least
        else:
            doubtful, hopeless = found.high >= least, found.middle + found.error >= least
        shown[columns.line[hopeless]] = True
        columns = columns.some(doubtful & ~shown[columns.line])
        if not len(columns.line):
            return ~shown if surely else shown
        left, columns = columns.line, columns.split()
    shown[left] = True
    return ~shown if surely else shown


def from_columns(lines: SightLines, columns: Columns) -> SightLines:
    """A sight line from the middle of each column, with a hull of its own."""
    hull = lines.hull[columns.line]
    _, aside, over = axes_to_boxes(lines)[:, hull]
    X_WC = lines.X_WC[hull]
    X_WC[:, :3, 3] += columns.middle[:, :1] * aside + columns.middle[:, 1:] * over
    return replace(
        lines,
        state=lines.state[columns.line],
        hull=np.arange(len(hull)),
        box=lines.box[hull],
        X_WC=X_WC,
        X_WB=lines.X_WB[hull],
        half_size=lines.half_size[hull],
        offset=lines.offset[hull],
    )


class ShareBounds(NamedTuple):
    """Between what the visible shares of the boxes of n sight lines lie, from anywhere in a column each."""

    low: Array
    """Shape (n,)."""
    high: Array
    """Shape (n,)."""
    middle: Array
    """From the middle of each column, NaN where it was not looked at, shape (n,)."""
    error: Array
    """By how much the bounds stay away from that, however thin the column, shape (n,)."""


def share_bounds(lines: SightLines, poses: SolidPoses, near: NearSolids, columns: Columns) -> ShareBounds:
    """Between what the visible shares of the boxes of sight lines with a hull each lie.

    near: all solids that may be in the way, from any centre. The boxes and cameras must be somewhere, and the corners
    of the boxes in front of the cameras.
    """
    hulls, number = _Hulls.of(lines), len(lines.state)
    sweep = np.zeros(number)
    np.maximum.at(sweep, near.pairs.line, hulls.sweep(near.pairs.line, near.depth, columns))
    # Where anything may sweep across all of the box, nothing is known.
    wide = sweep > hulls.sides.sum(axis=1)
    low, high, error = np.where(wide, 0.0, 1.0), np.ones(number), ACCURACY + hulls.uneven(columns.turn)
    middle = np.where(wide, np.nan, 1.0)
    for line, view, rays in rays_around(lines, poses, near.pairs.of_lines(~wide), np.where(wide, 0.0, sweep)):
        box, cells = rays.silhouette, _Cells.of(view.grid, rays.hull)
        every, free = count_rays(box), count_rays(box & ~rays.blocked)
        changed = cells.swept(rays.blocked, cells.around(box, sweep[line]), sweep[line])
        edge = cells.along(2.0 * hulls.sides[line].sum(axis=1), hulls.sweep(line, hulls.nearest[line], columns))
        low[line] = (free - changed - edge) / np.maximum(every + edge, 1.0) - error[line]
        high[line] = (free + changed + edge) / np.maximum(every - edge, 1.0) + error[line]
        middle[line] = free / np.maximum(every, 1.0)
    return ShareBounds(low, high, middle, error)


class NearSolids(NamedTuple):
    """Solids that may reach into the view hull of any centre of the camera."""

    pairs: Pairs
    """n of them, with sight lines."""
    depth: Array
    """The least at which they may, from any centre, shape (n,) [m]."""

    @classmethod
    def of(cls, lines: SightLines, poses: SolidPoses, pairs: Pairs, reach: float) -> NearSolids:
        """Those of pairs, with centres up to `reach` [m] away."""
        depth = _least_depths(lines, _Hulls.of(lines), poses, pairs, reach)
        some = np.isfinite(depth)
        return cls(pairs.some(some), np.maximum(depth[some] - reach, 0.0))

    def of_lines(self, line: Indices) -> NearSolids:
        """Those of sight lines by index, any of which may come several times, counted anew."""
        first, last = (np.searchsorted(self.pairs.line, line, side=side) for side in ("left", "right"))
        new, at = ranges(first, last)
        return NearSolids(Pairs(new, self.pairs.solid[at]), self.depth[at])


@dataclass(frozen=True, eq=False)
class _Hulls:
    """The boxes of h view hulls in the optical frames."""

    X_CW: Array
    """The world in the optical frames, shape (h, 4, 4)."""
    depth: Array
    """Of the boxes' centres, shape (h,) [m]."""
    nearest: Array
    """Least depth of the boxes' corners, shape (h,) [m]."""
    farthest: Array
    """The greatest, shape (h,) [m]."""
    low: Array
    """Least x / z and y / z of the corners, shape (h, 2)."""
    high: Array
    """The greatest, shape (h, 2)."""
    center: Array
    """Those of the boxes' centres, shape (h, 2)."""

    @classmethod
    def of(cls, lines: SightLines) -> _Hulls:
        X_CW = inverse(lines.X_WC)
        corners = transform(X_CW, lines.corners)
        z = corners[..., 2]
        image = corners[..., :2] / z[..., None]
        x, y, depth = corners.mean(axis=1).T
        return cls(
            X_CW=X_CW,
            depth=depth,
            nearest=z.min(axis=1),
            farthest=z.max(axis=1),
            low=image.min(axis=1),
            high=image.max(axis=1),
            center=np.stack([x, y], axis=1) / depth[:, None],
        )

    @property
    def sides(self) -> Array:
        """Those of the rectangles around the boxes in the plane z = 1, shape (h, 2)."""
        return self.high - self.low

    @property
    def slant(self) -> Array:
        """How much longer the directions to the boxes are than deep, at most, shape (h,)."""
        outermost = np.maximum(np.abs(self.low), np.abs(self.high))
        slant: Array = np.sqrt(1.0 + (outermost * outermost).sum(axis=1))
        return slant

    def sweep(self, hull: Indices, depth: Array, columns: Columns) -> Array:
        """How far points from depths (n,) on may move over a box, in the plane z = 1, up to its far side; (n,)."""
        reach, middle, slant = columns.reach[hull], self.depth[hull], self.slant[hull]
        beside = slant * (1.0 + 2.0 * reach / np.maximum(depth, 1e-300))  # of directions to points beside the box

        def moved(z: Array) -> Array:
            return np.where(z > reach, np.abs(middle - z) / np.maximum(z - reach, 1e-300), np.inf)

        farthest = np.maximum(moved(depth), moved(self.farthest[hull])) / middle
        # From the axis of the column, which its middle is beside, to as far beside the box as what moves may come from.
        aside = np.hypot(*columns.middle[hull].T) / middle
        side = np.maximum(self.high - self.center, self.center - self.low)[hull]
        across = np.hypot(*side.T) + (aside + reach * farthest) * beside
        found: Array = (columns.aside[hull] * beside + columns.along[hull] * across) * farthest
        return found

    def uneven(self, turn: float) -> Array:
        """By how much the weights of areas in the image change across a box if the camera turns, as a share, (h,).

        An area counts with 1 / z^3 of its unit direction, and a turn by a changes z by -a to a times the slope.
        """
        least = np.cos(turn) - np.sin(turn) * self.slant
        across = np.sin(turn) * np.hypot(*self.sides.T)
        return np.where(least > 0, 3.0 * across / np.maximum(least, 1e-300), np.inf)


def _least_depths(lines: SightLines, hulls: _Hulls, poses: SolidPoses, pairs: Pairs, reach: float) -> Array:
    """Least depth at which the solids of pairs may reach into the view hull of any centre [m], shape (pairs,).

    Infinite where the box around the solid does not. It is clipped at the four sides of the hull, each moved out by as
    much as the eye may be.
    """
    hull, state = lines.hull[pairs.line], lines.state[pairs.line]
    X_CP = hulls.X_CW[hull] @ poses.at(pairs.solid, state)
    faces = transform(X_CP, poses.solids.corners[pairs.solid])[:, BOX_FACES].reshape(-1, 4, 3)
    counts = np.full(len(faces), 4)
    for axis in range(2):
        for sign, slopes in ((1.0, hulls.high), (-1.0, hulls.low)):
            slope = np.repeat(slopes[hull, axis], 6)[:, None]
            heights = sign * (faces[..., axis] - slope * faces[..., 2]) - reach * np.sqrt(1.0 + slope * slope)
            faces, counts = clipped_polygons(faces, counts, heights)
    present = np.arange(faces.shape[1]) < counts[:, None]
    depth = np.where(present, faces[..., 2], np.inf).min(axis=1).reshape(-1, 6).min(axis=1)
    # Nothing is between the eye and a box that it is in.
    axes = (X_CP @ poses.solids.boxes[pairs.solid])[:, :3]
    eyes = (axes[..., 3:] * axes[..., :3]).sum(axis=1)
    inside: Mask = (np.abs(eyes) <= (axes[..., :3] ** 2).sum(axis=1)).all(axis=1)
    return np.where(inside, 0.0, np.where(depth > 0, depth, np.where(np.isfinite(depth), 0.0, np.inf)))


@dataclass(frozen=True, eq=False)
class _Cells:
    """The cells of the grids of l sight lines, with a ray in each."""

    across: Array
    """Their size along a row, shape (l,)."""
    down: Array
    """From row to row, shape (l,)."""

    @classmethod
    def of(cls, grid: RayGrid, hull: Indices) -> _Cells:
        across, down = grid.step[:, hull]
        return cls(across, down)

    def along(self, length: Array, radius: Array) -> Array:
        """How many rays there may be within a distance of a line, or of a point at least, on one side of it; (l,)."""
        return (length * radius + np.pi * radius * radius) / (self.across * self.down)

    def around(self, rays: Mask, radius: Array) -> Mask:
        """The rays within a rectangle of twice the size of `radius` (l,), or a little more, around those given."""
        for axis, size in ((0, self.across), (2, self.down)):
            rays = _spread(rays, np.ceil(radius / size).astype(np.int64) + 1, axis)
        return rays

    def swept(self, rays: Mask, near: Mask, radius: Array) -> Array:
        """How many rays the outline of given rays may sweep if each of its points moves by up to `radius`, shape (l,).

        near: where it matters. A shift along the vector from one ray to another changes as many rays as there are such
        pairs of which one is given and one is not; any other shift is a sum of two of these.
        """
        nearby = near[1:] | near[:-1]
        beside = count_rays((rays[1:] != rays[:-1]) & nearby)
        first, second = rays[1:, :, :-_STRIDE], _below(rays)
        below = count_rays((first != second) & (near[1:, :, :-_STRIDE] | _below(near))) / _STRIDE
        # Per unit along the rows and across them, in rays.
        along, over = beside / self.across, (below + abs(_ASLANT) / _STRIDE * beside) / self.down
        found: Array = radius * np.hypot(along, over)
        return found + self.along(np.zeros_like(radius), radius)


def _below(rays: Mask) -> Mask:
    """The rays `_STRIDE` rows further that are the least aside, from the second column on."""
    return np.where(SHIFT[_STRIDE:] > SHIFT[:-_STRIDE], rays[:-1, :, _STRIDE:], rays[1:, :, _STRIDE:])


def _spread(rays: Mask, count: Indices, axis: int) -> Mask:
    """The rays with up to `count` (l,) to the next given one along an axis."""
    length = rays.shape[axis]
    total = np.cumsum(np.insert(rays, 0, False, axis=axis), axis=axis, dtype=np.int16)
    at = np.arange(length)[:, None]
    last, first = np.minimum(at + 1 + count, length), np.maximum(at - count, 0)
    if axis == 0:
        last, first = last[..., None], first[..., None]
    else:
        last, first = last.T[None], first.T[None]
    return np.take_along_axis(total, last, axis) > np.take_along_axis(total, first, axis)
