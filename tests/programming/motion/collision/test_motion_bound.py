"""Bounds of motion, against random small motions."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import inverse, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.motion_bound import MotionBound


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
