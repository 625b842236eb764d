"""Low bodies proven to stay off a box, against random small motions of all their vertices."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import axis_rotation, inverse, pose, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.motion.collision.low_bodies import LowBodies
from sqrp_cli.programming.motion.collision.motion_bound import MotionBound
from sqrp_cli.programming.sensing.solids import load_solid

HALF = np.array([1.0, 1.0, 0.02])
MARGIN = 1.5e-3


@pytest.mark.parametrize("X_WB", [pose(position=(0, 0, -0.02)), pose(axis_rotation(0, 0.4), (0, 0.1, -0.12))])
def test_what_is_proven_off_a_box_keeps_its_margin_wherever_its_joints_are(ur5: RobotModel, X_WB: np.ndarray) -> None:
    solids, bound, rng = [load_solid(part) for part in ur5.parts], MotionBound(ur5), np.random.default_rng(0)
    low = LowBodies(ur5, bound, [Body.of(solid) for solid in solids])
    assert [solid.part.parent for solid, row in zip(solids, low.row, strict=True) if row >= 0] == [
        "shoulder_link",
        "upper_arm_link",
    ]
    proven = 0
    for _ in range(60):
        q, variation = rng.uniform(-3, 3, 6), rng.uniform(0, 0.15, 6)
        X_WF = ur5.frame_poses(q[None])
        moved = ur5.link_poses(q + rng.choice([-1.0, 0.5, 1.0], (40, 6)) * variation)
        for solid, row in zip(solids, low.row, strict=True):
            box = X_WB[None], HALF[None], np.array([MARGIN])
            if row < 0 or not low.stay_off(X_WF, variation[None], np.array([row]), *box)[0]:
                continue
            proven += 1
            in_box = transform(inverse(X_WB) @ moved[solid.part.parent], solid.vertices)
            beyond = np.abs(in_box) - HALF
            assert beyond.max(axis=2).min() > MARGIN
    assert proven > 30
