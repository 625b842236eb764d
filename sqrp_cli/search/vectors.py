"""Vectors of changes: how far and how finely they are searched, and grids of them, nearer ones first."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array

FINE = 16  # The fine grid has at most so many steps to every side
COARSE = {2: 12, 3: 4}  # Steps of the grid of each shell to every side, by the dimension


class Bounds(NamedTuple):
    """How far and how finely changes of a kind are searched."""

    dimension: int  # of the vectors
    step: float  # of the fine grid, in the unit of the vectors; lengths are found to a tenth of it
    reaches: tuple[float, ...]  # lengths up to which it is searched, one after the other, until something is found
    fine: bool  # whether a fine grid below the least change that was found is searched, too
    rounds: int = 0  # how often directions around that of the change that was found are tried
    directions: int = 0  # how many of them each time
    shares: tuple[float, ...] = ()  # of the length so far, at which each direction is tried
    margins: tuple[float, ...] = ()
    """By how much longer changes are looked at for the margin; none: all lengths up to `MOST_MORE` beyond."""


def fine_grid(bounds: Bounds, length: float) -> Array:
    """Vectors (p, d) of a fine grid up to a length, coarser than asked for beyond `FINE` of its steps."""
    points = grid(bounds.dimension, FINE) * max(bounds.step, length / FINE)
    lengths = np.linalg.norm(points, axis=1)
    near: Array = points[(lengths > 0) & (lengths <= length * (1 + 1e-9))]
    return near


def shells(dimension: int, step: float, reach: float) -> Iterator[Array]:
    """Vectors (p, d) on grids around zero, nearer ones first: the farther out, the coarser."""
    inner = step
    while inner < reach:
        outer = min(2.0 * inner, reach)
        points = grid(dimension, COARSE[dimension]) * (2.0 * inner / COARSE[dimension])
        lengths = np.linalg.norm(points, axis=1)
        yield points[(lengths > inner * (1 + 1e-9)) & (lengths <= outer * (1 + 1e-9))]
        inner = outer


@cache
def grid(dimension: int, most: int) -> Array:
    """Whole-numbered vectors up to a length, shortest first; equal ones in the order of their coordinates."""
    points = np.array(list(product(range(-most, most + 1), repeat=dimension)), dtype=float)
    lengths = np.linalg.norm(points, axis=1)
    near: Array = points[lengths <= most * (1 + 1e-9)]
    return near[np.argsort(np.linalg.norm(near, axis=1), kind="stable")]
