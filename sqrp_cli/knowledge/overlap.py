"""How deep two oriented boxes are in each other."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, cross


def box_penetration(X_WA: Array, size_A: Array, X_WB: Array, size_B: Array) -> float:
    """How far [m] two oriented boxes must be moved apart at least until they only touch; 0 or less if they are apart.

    X_WA, X_WB: poses of the boxes' centres, shape (4, 4); size_A, size_B: full extents [m], shape (3,).

    Exact for boxes: the separating-axis theorem over the 3 + 3 face normals and the 9 cross products of edges
    (Gottschalk et al., OBBTree, SIGGRAPH 1996); the shortest way out of a convex body lies along one of these axes.
    """
    axes_A, axes_B = X_WA[:3, :3].T, X_WB[:3, :3].T
    crosses = cross(axes_A[:, None, :], axes_B[None, :, :]).reshape(-1, 3)
    lengths = np.linalg.norm(crosses, axis=1)
    crosses = crosses[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    directions = np.concatenate([axes_A, axes_B, crosses])
    reach_A = np.abs(directions @ axes_A.T) @ (0.5 * size_A)
    reach_B = np.abs(directions @ axes_B.T) @ (0.5 * size_B)
    gap = np.abs(directions @ (X_WA[:3, 3] - X_WB[:3, 3]))
    return float((reach_A + reach_B - gap).min())
