"""Which of several equally good variants has the most margin: how far its values may be off until something changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array

Mask = NDArray[np.bool_]


def middle_of_grid(equal: Mask) -> int:
    """The index, in row-major order, of the middle of the largest block of equals on a grid, shape one axis per value.

    A block is connected by steps of one in one value. Its middle is the point of most margin, which is the number of
    steps that all values may be off at once, either way, without leaving the block; beyond the ends of the grid nothing
    is known, so that leaves it too. Of points with as much margin it is the one nearest the mean of the block, and of
    blocks and points that are alike the first.
    """
    block = _largest_block(equal)
    margin = _margins(block)
    points = np.argwhere(margin == margin.max())
    distances = np.linalg.norm(points - np.argwhere(block).mean(axis=0), axis=1).round(9)
    return int(np.ravel_multi_index(tuple(points[np.argmin(distances)]), equal.shape))


def middle_of_draws(equal: Mask, points: Array) -> int:
    """The index of the equal whose nearest draw that is no equal is farthest away; the first of those that are alike.

    equal: shape (n,). points: of all draws, as shares of the range of each value, shape (n, values). Where all draws
    are equals it is the one nearest the middle of the ranges.
    """
    others = points[~equal] if not equal.all() else np.full((1, points.shape[1]), 0.5)
    nearest = np.array([np.linalg.norm(others - point, axis=1).min() for point in points])
    worth = nearest if not equal.all() else -nearest
    return int(np.argmax(np.where(equal, worth, -np.inf)))


def _largest_block(equal: Mask) -> Mask:
    largest = np.zeros_like(equal)
    left = set(map(tuple, np.argwhere(equal).tolist()))
    for start in map(tuple, np.argwhere(equal).tolist()):
        if start in left:
            found = _block(start, left)
            if len(found) > largest.sum():
                largest = np.zeros_like(equal)
                largest[tuple(np.array(found).T)] = True
    return largest


def _block(start: Sequence[int], left: set[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Everything that is connected with a point, which is taken out of what is left."""
    found = [tuple(start)]
    left.remove(found[0])
    for point in found:  # grows on the way
        for axis, step in np.ndindex(len(point), 2):
            neighbour = (*point[:axis], point[axis] + 2 * step - 1, *point[axis + 1 :])
            if neighbour in left:
                left.remove(neighbour)
                found.append(neighbour)
    return found


def _margins(block: Mask) -> NDArray[np.int_]:
    """How many steps from leaving the block each point is, 0 outside; values that are not varied cannot be off."""
    margins = np.zeros(block.shape, dtype=int)
    while block.any() and margins.max() < max(block.shape):
        margins += block
        for axis, count in enumerate(block.shape):
            if count > 1:
                wide = np.pad(block, [(1, 1) if other == axis else (0, 0) for other in range(block.ndim)])
                low, high = (np.take(wide, range(first, first + count), axis) for first in (0, 2))
                block = block & low & high
    return margins
