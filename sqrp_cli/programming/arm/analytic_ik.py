"""Closed-form inverse kinematics by EAIK, an optional library that this module alone knows.

EAIK: D. Ostermeier, J. Kuelz, M. Althoff, Automatic Geometric Decomposition for Analytical Inverse Kinematics, 2025.
What it finds seeds a search on the exact model; whoever calls it must not depend on it being complete.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from sqrp_cli.geometry import Array, inverse
from sqrp_cli.programming.arm.kinematics import RobotModel

NOMINAL_ANGLE = 2e-2
"""Axes of a calibrated arm are taken as along those of its root where they are within this angle [rad]."""

NOMINAL_OFFSET = 2e-3
"""Offsets between the axes of a calibrated arm are taken as zero below this [m]."""


def is_installed() -> bool:
    """Whether EAIK can be imported."""
    return find_spec("eaik") is not None


def approximate_solutions(model: RobotModel, X_WT: Array) -> Array:
    """Joint positions near the solutions for a tool pose X_WT (4, 4), shape (k, n), some near none.

    None at all if EAIK is missing or cannot decompose the arm: it takes six turning joints that move one by one.
    """
    solver = _solver(model) if is_installed() else None
    if solver is None:
        return np.empty((0, len(model.arm)))
    return np.array(solver.decomposition.IK(solver.X_BW @ X_WT @ solver.X_TE).Q).reshape(-1, len(model.arm))


class _Solver:
    """EAIK's decomposition of an arm. X_BW: world in the arm's root frame. X_TE: turns the tool frame into EAIK's."""

    def __init__(self, decomposition: Any, X_BW: Array, X_TE: Array) -> None:  # noqa: ANN401
        self.decomposition, self.X_BW, self.X_TE = decomposition, X_BW, X_TE


@lru_cache(maxsize=8)
def _solver(model: RobotModel) -> _Solver | None:
    """The decomposition of the arm itself, or else that of the nominal arm that it was calibrated from."""
    from eaik.IK_HP import HPRobot

    zero = np.zeros(len(model.arm))
    if len(zero) != 6 or not model.turns.all() or not model.joints_move_alone:
        return None
    X_BW = inverse(model.link_poses(zero[None])[model.links[0]][0])
    X_BT = X_BW @ model.tool_pose(zero)
    linear, directions = ((X_BW[:3, :3] @ rows).T for rows in np.split(model.jacobian(zero), 2))
    points = X_BT[:3, 3] + np.cross(directions, linear)
    offsets = np.diff(np.concatenate([np.zeros((1, 3)), points, X_BT[None, :3, 3]]), axis=0)
    X_TE = np.eye(4)
    X_TE[:3, :3] = X_BT[:3, :3].T
    along = np.abs(directions).max(axis=1, keepdims=True) > np.cos(NOMINAL_ANGLE)
    nominal_directions = np.where(along, np.round(directions), directions)
    nominal_offsets = np.where(np.abs(offsets) < NOMINAL_OFFSET, 0.0, offsets)
    for axes in ((directions, offsets), (nominal_directions, nominal_offsets)):
        decomposition = HPRobot(*axes)
        if decomposition.hasKnownDecomposition():
            return _Solver(decomposition, X_BW, X_TE)
    return None
