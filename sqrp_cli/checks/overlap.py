"""How deep two oriented boxes are in each other, and how far apart seen from above."""

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


def gap_from_above(X_WA: Array, size_A: Array, X_WB: Array, size_B: Array) -> float:
    """How far [m] two oriented boxes are apart at least where heights do not count; 0 or less if one is over the other.

    X_WA, X_WB: poses of the boxes' centres, z up, shape (4, 4); size_A, size_B: full extents [m], shape (3,).

    The separating-axis theorem for their shadows on the floor, whose edges are those of the boxes.
    """
    axes_A, axes_B = X_WA[:3, :3].T, X_WB[:3, :3].T
    normals = cross(np.concatenate([axes_A, axes_B]), np.array([0.0, 0.0, 1.0]))
    lengths = np.linalg.norm(normals, axis=1)
    directions = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    reach_A = np.abs(directions @ axes_A.T) @ (0.5 * size_A)
    reach_B = np.abs(directions @ axes_B.T) @ (0.5 * size_B)
    between = np.abs(directions @ (X_WA[:3, 3] - X_WB[:3, 3]))
    return float((between - reach_A - reach_B).max())
