"""What a camera sees from parts of the ball that holds its centre: branch and bound over its one pose.

At each instant another pose may be the worst, but a camera has only one. So the ball is cut into columns along the mean
direction to what it watches; what holds from a column at one instant and at another holds of the same poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, cross
from sqrp_cli.programming.sensing.bounded import shares
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds, axes_to_boxes
from sqrp_cli.programming.sensing.scene_states import SolidPoses
from sqrp_cli.programming.sensing.sight_lines import SightLines


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewedBoxes:
    """The boxes of a target, of each of which a part must be visible to one camera, in m states."""

    within: Mask
    """The states in which all boxes are within the camera's limits from every pose, shape (m,)."""
    lines: SightLines
    """To the boxes in these states, state by state, v of them."""
    poses: SolidPoses
    near: shares.NearSolids
    """That may be in the way of the lines."""
    surely: Array
    """The share of each line's box that is surely enough, shape (v,)."""
    possibly: Array
    """The share that may be enough, shape (v,)."""
    bounds: PoseBounds

    @cached_property
    def axes(self) -> Array:
        """Axes to the boxes in the camera's frame: to their centres, and two across, shape (3, lines, 3)."""
        hull = self.lines.hull
        found: Array = np.einsum("aki,kij->akj", axes_to_boxes(self.lines)[:, hull], self.lines.X_WC[hull, :3, :3])
        return found

    @cached_property
    def sides(self) -> Array:
        """Two axes across the mean direction to the boxes in the camera's frame, shape (2, 3)."""
        ahead = self.axes[0].sum(axis=0)
        aside = cross(ahead, np.eye(3)[np.abs(ahead).argmin()])
        return np.stack([one / np.linalg.norm(one) for one in (aside, cross(ahead, aside))])


class CentreParts(NamedTuple):
    """Square columns that together hold all possible centres of a camera, p of them, and what is seen in m states."""

    middle: Array
    """Across the mean direction, shape (p, 2) [m]."""
    half: Array
    """Half the side of each, shape (p,) [m]."""
    sure: Mask
    """Whether all boxes are seen from every centre in the column, shape (p, m)."""
    possible: Mask
    """Whether they may be seen from some, shape (p, m)."""

    @classmethod
    def whole(cls, states: int, bounds: PoseBounds) -> CentreParts:
        """One column, from which nothing is known."""
        nothing = np.zeros((1, states), dtype=bool)
        return cls(np.zeros((1, 2)), np.full(1, bounds.reach), nothing, ~nothing)

    def split(self, which: Indices, seen: ViewedBoxes, asked: Mask) -> CentreParts:
        """The same with some cut into their quarters, looked at in the states asked for (m,)."""
        middle, half = shares.quarters(self.middle[which], self.half[which])
        parent = np.repeat(which, 4)
        known = CentreParts(middle, half, self.sure[parent], self.possible[parent])
        known = known._some(shares.in_ball(middle, half, seen.bounds))
        new = known._looked(seen, known.possible & ~known.sure & asked)
        rest = self._some(np.setdiff1d(np.arange(len(self.half)), which))
        return CentreParts(*(np.concatenate(parts) for parts in zip(rest, new, strict=True)))

    def _some(self, which: Mask | Indices) -> CentreParts:
        return CentreParts(self.middle[which], self.half[which], self.sure[which], self.possible[which])

    def _looked(self, seen: ViewedBoxes, asked: Mask) -> CentreParts:
        """With what is seen from parts in states, where asked (p, m)."""
        part, state = np.nonzero(asked)
        if not len(part):
            return self
        count = len(seen.surely) // np.count_nonzero(seen.within)  # of boxes
        first = count * (np.cumsum(seen.within) - 1)
        line = (first[state, None] + np.arange(count)).reshape(-1)
        columns = self._columns(np.repeat(part, count), line, seen)
        found = shares.share_bounds(
            shares.from_columns(seen.lines, columns), seen.poses, seen.near.of_lines(line), columns
        )
        sure, possible = self.sure.copy(), self.possible.copy()
        sure[part, state] = (found.low >= seen.surely[line]).reshape(-1, count).all(axis=1)
        possible[part, state] = (found.high >= seen.possibly[line]).reshape(-1, count).all(axis=1)
        return self._replace(sure=sure, possible=possible)

    def _columns(self, part: Indices, line: Indices, seen: ViewedBoxes) -> shares.Columns:
        """Columns along the directions of lines (n,) that hold parts (n,)."""
        across = seen.axes[1:, line]
        middle = np.einsum("aki,ki->ka", across, self.middle[part] @ seen.sides)
        # Where the part stands aslant, it is as much wider.
        tilt = np.linalg.norm(across @ cross(*seen.sides), axis=0)
        return shares.Columns(line, middle, self.half[part] + np.sqrt(0.5) * tilt * seen.bounds.reach, seen.bounds)
