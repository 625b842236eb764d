"""The boxes around solids, as seen from points: how far they are, and whether rays meet them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, norms
from sqrp_cli.programming.sensing.sight_lines import TOUCH
from sqrp_cli.programming.sensing.solids import Solid


def box_distances(solid: Solid, points: Array) -> tuple[Array, Array]:
    """Least and greatest distances of points (n, 3), in the parent's frame, from the box around a solid; (n,) [m]."""
    axes, lengths = _axes(solid)
    along = np.abs((points - solid.center) @ axes.T)
    return norms(np.maximum(along - lengths, 0.0)), norms(along + lengths)


def box_is_met(solid: Solid, points: Array, rays: Array) -> NDArray[np.bool_]:
    """Whether the way from each point (n, 3) to where its ray (n, 3) ends may touch the box around a solid; (n,).

    Both in the parent's frame. The box is met between where the ray enters the last of its three slabs and leaves the
    first (T. L. Kay, J. T. Kajiya, 1986).
    """
    axes, lengths = _axes(solid)
    start, step = (points - solid.center) @ axes.T, rays @ axes.T
    reach = lengths + TOUCH
    step = np.where(step == 0.0, 1e-300, step)
    with np.errstate(over="ignore"):
        one, other = (-reach - start) / step, (reach - start) / step
    enters, leaves = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    met: NDArray[np.bool_] = (enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)
    return met


def _axes(solid: Solid) -> tuple[Array, Array]:
    """Directions of a solid's box, one a row, shape (3, 3), and half its extents along them, (3,) [m]."""
    # The half axes are orthogonal; where the box is flat, one of them is zero and the factorization finds a direction.
    directions, lengths = np.linalg.qr(solid.half_axes.T)
    return directions.T, np.abs(np.diag(lengths))
