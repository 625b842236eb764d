"""Bounds of motion, against random small motions."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import axis_rotation, inverse, pose, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.motion.collision.motion_bound import LowBodies, MotionBound
from sqrp_cli.programming.solids import load_solid


def test_depth_counts_the_joints_that_move_a_link(ur5: RobotModel) -> None:
    depth = MotionBound(ur5).depth
    chain = [
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "suction_tip",
    ]
    assert [depth[link] for link in chain] == list(range(7))


@pytest.mark.parametrize("size", [0.01, 0.3, 1.5])
def test_no_point_moves_further_than_its_bound_against_the_world_or_against_any_link(
    ur5: RobotModel, size: float
) -> None:
    bound, rng = MotionBound(ur5), np.random.default_rng(0)
    links, radius, tightest = ["forearm_link", "wrist_2_link", "suction_tip"], 0.1, 0.0
    depth = np.array([bound.depth[link] for link in links])
    for _ in range(40):
        q, variation = rng.uniform(-3, 3, 6), rng.uniform(0, size, 6)
        poses = ur5.link_poses(q[None])
        centers = np.stack([poses[link][:, :3, 3] for link in links], axis=1)
        motion = bound.between(ur5.frame_poses(q[None]), variation[None], centers, np.full(3, radius), depth)[0]
        moved = ur5.link_poses(q + rng.choice([-1.0, 1.0], (50, 6)) * variation)
        directions = rng.normal(size=(30, 3))
        points = radius * directions / np.linalg.norm(directions, axis=1)[:, None]
        for i, link in enumerate(links):
            for other in ("base_link", "upper_arm_link", "wrist_1_link"):
                if bound.depth[other] <= depth[i]:
                    before = transform(inverse(poses[other]) @ poses[link], points)
                    after = transform(inverse(moved[other]) @ moved[link], points)
                    distance = np.linalg.norm(after - before, axis=-1).max()
                    assert distance <= motion[i, bound.depth[other]] + 1e-12
                    tightest = max(tightest, distance / max(motion[i, bound.depth[other]], 1e-12))
    assert tightest > (0.5 if size < 1 else 0.2)


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
