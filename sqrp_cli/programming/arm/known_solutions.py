"""The latest answers of inverse kinematics, kept: candidates that differ in speed or branch share their poses."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.arm.inverse_kinematics import IkResult, all_solutions
from sqrp_cli.programming.arm.kinematics import RobotModel

MOST_KEPT = 64
"""Answers that are kept of each robot."""

Question = tuple[bytes, int, int]

_answers: WeakKeyDictionary[RobotModel, dict[Question, IkResult]] = WeakKeyDictionary()
"""Of robots that are still in use, the oldest answer first."""


def known_solutions(model: RobotModel, X_WT: Array, seed: int, redundancy_samples: int) -> IkResult:
    """What `all_solutions` says of a pose X_WT, shape (4, 4); read-only."""
    known = _answers.setdefault(model, {})
    question = (np.ascontiguousarray(X_WT, dtype=float).tobytes(), seed, redundancy_samples)
    if question not in known:
        if len(known) == MOST_KEPT:
            known.pop(next(iter(known)))
        known[question] = all_solutions(model, X_WT, seed, redundancy_samples)
    return known[question]
