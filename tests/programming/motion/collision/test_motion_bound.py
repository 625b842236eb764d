"""Bounds of motion, against random small motions."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.geometry import axis_rotation, inverse, pose, transform
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision import CollisionScene
from sqrp_cli.programming.motion.collision.collision_body import Body
from sqrp_cli.programming.motion.collision.motion_bound import LowBodies, MotionBound
from sqrp_cli.programming.solids import load_solid
from sqrp_cli.trajectory import JointPath
from tests.programming.motion.collision.test_collision import thing, world
from tests.programming.robots import LINKAGES, robot, written_urdf


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


@pytest.mark.parametrize("linkage", LINKAGES)
def test_no_two_points_of_a_linkage_come_closer_than_the_bounds_of_both_say(linkage: str, tmp_path: Path) -> None:
    model = RobotModel.load(robot(written_urdf(tmp_path / "arm.urdf", *LINKAGES[linkage]), "tool0"))
    bound, rng, radius = MotionBound(model), np.random.default_rng(0), 0.1
    names, n = [link for link in model.links if link != "base"], len(model.arm)
    depth = np.array([bound.depth[link] for link in names])
    rods = [(k, bound.rods[link]) for k, link in enumerate(names) if link in bound.rods]
    tightest = 0.0
    for _ in range(30):
        q, variation = rng.uniform(-1, 1, n), rng.uniform(0, 0.2, n)
        poses = model.link_poses(q[None])
        centers = np.stack([poses[link][:, :3, 3] for link in names], axis=1)
        spheres = centers, np.full(len(names), radius), depth
        motion = bound.between(model.frame_poses(q[None]), variation[None], *spheres, rods)[0]
        moved = model.link_poses(q + rng.choice([-1.0, 1.0], (40, n)) * variation)
        directions = rng.normal(size=(20, 3))
        points = radius * directions / np.linalg.norm(directions, axis=1)[:, None]
        for outer, inner in combinations(range(len(names)), 2):
            if depth[inner] > depth[outer]:
                outer, inner = inner, outer
            most = motion[outer, depth[inner]] + motion[inner, -1]
            before, after = (
                np.linalg.norm(transform(X[names[outer]], points) - transform(X[names[inner]], points[::-1]), axis=-1)
                for X in (poses, moved)
            )
            change = np.abs(after - before).max()
            assert change <= most + 1e-12, (names[outer], names[inner])
            tightest = max(tightest, change / max(most, 1e-12))
    assert tightest > 0.5


def test_rods_of_a_linkage_hit_things_as_a_fine_step_says(tmp_path: Path) -> None:
    """A rod that reaches out behind the arm, and a post there; the contact is where the first fine step finds it."""
    urdf = written_urdf(tmp_path / "arm.urdf", *LINKAGES["rods beside the arm"])
    box = '<collision><origin xyz="-0.3 0 0"/><geometry><box size="0.5 0.04 0.04"/></geometry></collision>'
    urdf.write_text(urdf.read_text().replace('<link name="rod"/>', f'<link name="rod">{box}</link>'))
    model = RobotModel.load(robot(urdf, "tool0"))
    start, end = np.zeros(6), np.array([0.0, 0.9, -0.9, 0, 0, 0])
    middle = model.link_poses((start + 0.6 * (end - start))[None])["rod"][0] @ pose(position=(-0.5, 0, 0))
    post = thing("post", (0.05, 0.05, 0.05), middle)
    placed = CollisionScene(model, [post]).placed(world([post]))
    contact = placed.check_path(JointPath.line(start, end))
    steps = np.linspace(0, 1, 2001)
    touching = [found is not None for found in placed.check_all(start + steps[:, None] * (end - start))]
    assert contact is not None
    assert {contact.first, contact.second} == {"rod", "post"}
    assert contact.s == pytest.approx(steps[touching.index(True)], abs=2e-3)


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
