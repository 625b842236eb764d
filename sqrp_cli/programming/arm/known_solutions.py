"""The latest answers of inverse kinematics, kept: candidates that differ in speed or branch share their poses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.arm.inverse_kinematics import IkResult, all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel

MOST_KEPT = 64
"""Answers that are kept, of all robots together."""


def known_solutions(model: RobotModel, X_WT: Array, seed: int, redundancy_samples: int) -> IkResult:
    """What `all_solutions` says of a pose X_WT, shape (4, 4); read-only."""
    return _kept(model, np.ascontiguousarray(X_WT, dtype=float).tobytes(), seed, redundancy_samples)


@lru_cache(maxsize=MOST_KEPT)
def _kept(model: RobotModel, pose_bytes: bytes, seed: int, redundancy_samples: int) -> IkResult:
    return all_solutions(model, np.frombuffer(pose_bytes).reshape(4, 4), seed, redundancy_samples)
